"""Joint-wise recurrent units, each of which moves only the bones that it is associated with (Diao et al. 2024)."""

import lazy_loader

# The surface stands in the stub beside this file; a name is loaded when it is first asked for: PyTorch takes seconds.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
