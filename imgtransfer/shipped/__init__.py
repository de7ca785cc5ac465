"""What the package brings along to work from a wheel: the general checkpoint, which `configs/general` describes."""

import lazy_loader

# The surface stands in the stub beside this file; a name is loaded when it is first asked for, because PyTorch
# takes seconds, for which neither `imgtransfer --help` nor an early Ctrl-C should wait.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
