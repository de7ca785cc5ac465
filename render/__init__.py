"""Geometry as images: meshes, rasterisation, maps, visibility and pictures."""

from render.cameras import Camera as Camera
from render.cameras import frame_cameras as frame_cameras
from render.encoding import PositionBox as PositionBox
from render.encoding import decode_normals as decode_normals
from render.encoding import encode_normals as encode_normals
from render.errors import InputError as InputError
from render.imager import TemplateImager as TemplateImager
from render.mapfile import MapFile as MapFile
from render.mapfile import load_maps as load_maps
from render.mapfile import save_maps as save_maps
from render.mesh import Mesh as Mesh
from render.mesh import vertex_normals as vertex_normals
from render.meshio import load_mesh as load_mesh
from render.operator import MapOperator as MapOperator
from render.pictures import contact_sheet as contact_sheet
from render.pictures import write_png as write_png
from render.raster import Raster as Raster
from render.raster import rasterize as rasterize
