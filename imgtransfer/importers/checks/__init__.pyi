from .axes import Axes as Axes
from .findings import MeshFault as MeshFault
from .meshes import check_template as check_template
from .template import load_template as load_template
from .weld import Welded as Welded
from .weld import weld_motion as weld_motion
