"""How many threads compute, where their number would show in the result."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np  # noqa: F401 (its BLAS must be loaded to be limited, and SciPy has one of its own)
import scipy.linalg  # noqa: F401
from threadpoolctl import threadpool_limits


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Inside the block, or the function that this decorates, NumPy and SciPy do linear algebra on one thread.

    Several threads sum in another order than one: the last bits would follow the number of cores, and so would what
    starts from them, such as a simulation. Nothing here is large enough to gain from more. Torch's threads are another
    matter and stay as they are. Blocks may lie in one another. The number holds for the process: of Python threads with
    such blocks, the one that is first to begin sets it, and its end ends it.
    """
    with threadpool_limits(1, user_api="blas"):
        yield
