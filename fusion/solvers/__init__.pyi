from .adam import AdamSolver as AdamSolver
from .local_global import LocalGlobalSolver as LocalGlobalSolver
from .pixel_faces import PixelFaces as PixelFaces
