"""What a garment must stay outside of: signed distances to bodies and inner garments, and the last clean-up.

`BodySdf` is the distance to a body, `OuterSurface` to an open surface, `Obstacles` to several at once; all three answer
with an `SdfQuery` (metres, negative inside), and `lift_clear` takes any of them.
"""

import lazy_loader

# The surface stands in the stub beside this file; a name is loaded when it is first asked for, because PyTorch
# takes seconds, for which neither `imgtransfer --help` nor an early Ctrl-C should wait.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
