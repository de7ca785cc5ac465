"""Geometry as images: meshes, rasterisation, maps, visibility and pictures."""

import importlib
from typing import TYPE_CHECKING

from render.errors import InputError as InputError

if TYPE_CHECKING:
    from render.cameras import Camera as Camera
    from render.cameras import frame_cameras as frame_cameras
    from render.files.mesh_files import load_mesh as load_mesh
    from render.maps.coverage import Coverage as Coverage
    from render.maps.encoding import PositionBox as PositionBox
    from render.maps.encoding import decode_normals as decode_normals
    from render.maps.encoding import encode_normals as encode_normals
    from render.maps.imager import TemplateImager as TemplateImager
    from render.maps.map_file import MapFile as MapFile
    from render.maps.map_reader import load_maps as load_maps
    from render.maps.map_reader import open_maps as open_maps
    from render.maps.map_writer import save_maps as save_maps
    from render.maps.map_writer import written_maps as written_maps
    from render.maps.operator import MapOperator as MapOperator
    from render.mesh.mesh import Mesh as Mesh
    from render.mesh.mesh import vertex_normals as vertex_normals
    from render.pictures import contact_sheet as contact_sheet
    from render.pictures import write_png as write_png
    from render.raster.raster import Raster as Raster
    from render.raster.raster import rasterize as rasterize
    from render.views import View as View
    from render.views import parse_views as parse_views

# What is in the list above, by module: loaded when it is first asked for, because PyTorch takes seconds, for
# which neither `imgtransfer --help` nor an early Ctrl-C should wait.
_MODULES = {
    "cameras": (
        "Camera",
        "frame_cameras",
    ),
    "maps.coverage": ("Coverage",),
    "maps.encoding": (
        "PositionBox",
        "decode_normals",
        "encode_normals",
    ),
    "maps.imager": ("TemplateImager",),
    "maps.map_reader": (
        "load_maps",
        "open_maps",
    ),
    "maps.map_writer": (
        "save_maps",
        "written_maps",
    ),
    "maps.map_file": ("MapFile",),
    "mesh.mesh": (
        "Mesh",
        "vertex_normals",
    ),
    "files.mesh_files": ("load_mesh",),
    "maps.operator": ("MapOperator",),
    "pictures": (
        "contact_sheet",
        "write_png",
    ),
    "raster.raster": (
        "Raster",
        "rasterize",
    ),
    "views": (
        "View",
        "parse_views",
    ),
}
_HOME = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> object:
    """A name of this package, from its module; see PEP 562."""
    if name not in _HOME:
        raise AttributeError(f"module 'render' has no attribute {name!r}")
    return getattr(importlib.import_module(f"render.{_HOME[name]}"), name)
