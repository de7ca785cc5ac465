from .config import VirtualBonesConfig as VirtualBonesConfig
from .method import VirtualBones as VirtualBones
