from .live_controls import LiveControls as LiveControls
from .server import PORT as PORT
from .server import address_of as address_of
from .server import open_browser as open_browser
from .server import page_server as page_server
from .show import Show as Show
from .sources import open_sources as open_sources
