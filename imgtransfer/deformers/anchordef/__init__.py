"""AnchorDEF (Zhao et al., Learning Anchor Transformations for 3D Garment Animation, CVPR 2023): garments on anchors."""

import lazy_loader

# The surface stands in the stub beside this file; a name is loaded when it is first asked for: PyTorch takes seconds.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
