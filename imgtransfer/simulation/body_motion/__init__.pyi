from .dressed_body import BodyMotion as BodyMotion
from .dressed_body import DressedBody as DressedBody
from .skinned import SkinnedBodyMotion as SkinnedBodyMotion
from .unskinned import MeshBodyMotion as MeshBodyMotion
