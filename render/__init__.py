"""Geometry as images: meshes, rasterisation, maps, visibility and pictures."""

from render.errors import InputError as InputError
from render.mesh import Mesh as Mesh
from render.mesh import vertex_normals as vertex_normals
