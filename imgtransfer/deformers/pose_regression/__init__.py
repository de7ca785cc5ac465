"""Kernel ridge regression from a body's pose, now and a moment ago, to what skinning lacks of a garment."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
