from .dressed_body import BodyMotion as BodyMotion
from .dressed_body import DressedBody as DressedBody
from .skin import step_count as step_count
from .skinned import SkinnedBodyMotion as SkinnedBodyMotion
from .unskinned import MeshBodyMotion as MeshBodyMotion
