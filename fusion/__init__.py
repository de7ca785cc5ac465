"""From position and normal maps back to a mesh: section 3.3 of the paper."""

from fusion.api import fuse as fuse
from fusion.config import FusionConfig as FusionConfig
from fusion.initialise import initial_vertices as initial_vertices
from fusion.losses import collision_loss as collision_loss
from fusion.losses import displacement_loss as displacement_loss
from fusion.losses import edge_length_loss as edge_length_loss
from fusion.losses import normal_consistency_loss as normal_consistency_loss
from fusion.losses import normal_rendering_loss as normal_rendering_loss
from fusion.map_files import fuse_maps as fuse_maps
from fusion.obstacles.clearance import Clearance as Clearance
from fusion.obstacles.clearance import clear_body as clear_body
from fusion.obstacles.clearance import lift_clear as lift_clear
from fusion.obstacles.layers import Obstacles as Obstacles
from fusion.obstacles.layers import OuterSurface as OuterSurface
from fusion.obstacles.sdf import BodySdf as BodySdf
from fusion.obstacles.sdf import Obstacle as Obstacle
from fusion.obstacles.sdf import SdfQuery as SdfQuery
from fusion.stream import FusionResult as FusionResult
from fusion.topology import Topology as Topology
