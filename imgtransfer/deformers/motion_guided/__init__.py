"""Motion guided deep dynamic 3D garments (Zhang et al., ACM Transactions on Graphics 2022): a garment's next frame from
its last ones, through a space of garments that is learned first.
"""

import lazy_loader

# The surface stands in the stub beside this file; a name is loaded when it is first asked for: PyTorch takes seconds.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
