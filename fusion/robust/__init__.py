"""Position maps judged by themselves: pixels and regions that do not fit their neighbours.

`AutomaticConfidence` is what the fusion uses; `PixelLinks` compares neighbouring pixels, `regions` finds parts of a map
that lie off their surroundings, `ViewGaps` compares the views at the vertices, `MapFault` and `FaultLog` say what was
wrong and where.
"""

import lazy_loader

# The surface stands in the stub beside this file; a name is loaded when it is first asked for, because PyTorch
# takes seconds, for which neither `imgtransfer --help` nor an early Ctrl-C should wait.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
