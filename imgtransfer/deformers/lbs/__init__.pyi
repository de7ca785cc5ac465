from .method import Lbs as Lbs
from .method import LbsConfig as LbsConfig
from .skinned import SkinnedGarment as SkinnedGarment
