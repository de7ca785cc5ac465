from .config import ClothConfig as ClothConfig
from .config import SimulateConfig as SimulateConfig
from .config import SolverConfig as SolverConfig
from .planning.job import simulate as simulate
from .planning.plan import plan as plan
from .quality import Quality as Quality
from .run import simulate_clip as simulate_clip
