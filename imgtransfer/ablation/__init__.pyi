from .config import AblationConfig as AblationConfig
from .run import run_ablations as run_ablations
