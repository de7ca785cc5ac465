from .gltf import animated_glb as animated_glb
from .targets import ENDINGS as ENDINGS
from .targets import check_target as check_target
from .writing import written_animation as written_animation
