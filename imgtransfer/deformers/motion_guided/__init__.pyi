from .config import MotionGuidedConfig as MotionGuidedConfig
from .layers import on_garment as on_garment
from .measures import penetration_percent as penetration_percent
from .measures import rollout_errors_mm as rollout_errors_mm
from .method import MotionGuided as MotionGuided
