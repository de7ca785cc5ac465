from .config import JointNetConfig as JointNetConfig
from .method import JointNet as JointNet
