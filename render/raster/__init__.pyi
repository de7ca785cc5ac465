from .context import GLContext as GLContext
from .context import GLUnavailableError as GLUnavailableError
from .context import open_context as open_context
from .context import probe_backends as probe_backends
from .raster import Raster as Raster
from .raster import rasterize as rasterize
from .screen import screen_faces as screen_faces
from .visibility import visible_vertices as visible_vertices
