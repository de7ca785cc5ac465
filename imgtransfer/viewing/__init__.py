"""Look instead of read: clips, predictions and live garments in motion, as a page in the browser."""

import lazy_loader

# The surface stands in the stub beside this file; a name is loaded when it is first asked for, because PyTorch
# takes seconds, for which neither `imgtransfer --help` nor an early Ctrl-C should wait.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
