"""Methods trained and measured on the same clips: one table, its intervals, pictures of the same frames, one page."""

import lazy_loader

# The surface stands in the stub beside this file; a name is loaded when it is first asked for, because PyTorch
# takes seconds, for which neither `imgtransfer --help` nor an early Ctrl-C should wait.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
