"""The paper's comparison without images (table 7): a point network or a graph network on the garment's vertices."""

import lazy_loader

# The surface stands in the stub beside this file; a name is loaded when it is first asked for: PyTorch takes seconds.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
