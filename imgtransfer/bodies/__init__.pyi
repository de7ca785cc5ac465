from .anny import AnnyBody as AnnyBody
from .anny import load_body as load_body
from .config import AnnyConfig as AnnyConfig
from .config import BodyConfig as BodyConfig
from .config import SmplConfig as SmplConfig
from .config import make_body as make_body
from .shape import AnnyShape as AnnyShape
from .skinned import SkinnedBody as SkinnedBody
