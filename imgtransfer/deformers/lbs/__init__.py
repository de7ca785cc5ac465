"""Linear blend skinning: the garment moved with the weights of the body beneath it."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
