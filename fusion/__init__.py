"""From position and normal maps back to a mesh: section 3.3 of the paper.

`api` (arrays) and `map_files` (files) are the ways in; `inputs`, `config`, `initialise`, `losses`, `stages`,
`frame_solver`, `stream` and `report` are what happens between; `solvers` minimise, `obstacles` are what the garment
must stay outside of. Signed distances to a body or a garment (`BodySdf`, `OuterSurface`, several as `Obstacles`, their
answers `SdfQuery`) serve everyone who asks where cloth is in a body, not only the fusion.
"""

import lazy_loader

# The surface stands in the stub beside this file; a name is loaded when it is first asked for, because PyTorch
# takes seconds, for which neither `imgtransfer --help` nor an early Ctrl-C should wait.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
