"""From position and normal maps back to a mesh: section 3.3 of the paper."""

from fusion.clearance import Clearance as Clearance
from fusion.clearance import clear_body as clear_body
from fusion.clearance import lift_clear as lift_clear
from fusion.config import FusionConfig as FusionConfig
from fusion.fuse import fuse as fuse
from fusion.initialise import initial_vertices as initial_vertices
from fusion.losses import collision_loss as collision_loss
from fusion.losses import displacement_loss as displacement_loss
from fusion.losses import edge_length_loss as edge_length_loss
from fusion.losses import normal_consistency_loss as normal_consistency_loss
from fusion.losses import normal_rendering_loss as normal_rendering_loss
from fusion.obstacles import Obstacles as Obstacles
from fusion.obstacles import OuterSurface as OuterSurface
from fusion.run import fuse_maps as fuse_maps
from fusion.sdf import BodySdf as BodySdf
from fusion.sdf import Obstacle as Obstacle
from fusion.sdf import SdfQuery as SdfQuery
from fusion.stream import FusionResult as FusionResult
from fusion.topology import Topology as Topology
