"""Geometry as images: meshes, cameras, rasterisation, maps, visibility and pictures.

`mesh` (topology, normals, materials), `files` (everything that is read or written), `raster` (which face a pixel sees),
`maps` (images of positions and normals, and back); here `cameras`, `views` (where they stand), `framing`, `pictures`
(for eyes), and what all of the project shares: `errors`, `limits`, `memory`, `threads`.
"""

import lazy_loader

# The surface stands in the stub beside this file; a name is loaded when it is first asked for, because PyTorch
# takes seconds, for which neither `imgtransfer --help` nor an early Ctrl-C should wait.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
