"""The Warp kernel that sums the terms of `fusion.solvers.energy`, in double precision.

Laid out as in `fusion.solvers.energy_kernels`.
"""

# mypy: ignore-errors
# Kernels are written in Warp's own language: its annotations are no Python types.

from functools import cache
from threading import Lock
from types import SimpleNamespace

import warp as wp

from fusion.solvers.energy_kernels import lane_type

# Numbers that are summed in the kernels' own precision before they are in double precision.
BLOCK = wp.constant(32)
_defining = Lock()


def sum_kernels(bits: int, lanes: int) -> SimpleNamespace:
    """The kernel for float32 or float64 (`bits` 32 or 64) and groups of so many frames, built when first used."""
    with _defining:
        return _defined(bits, lanes)


@cache
def _defined(bits: int, lanes: int) -> SimpleNamespace:
    _, lane = lane_type(bits, lanes)
    exact = wp.types.vector(lanes, wp.float64)
    module = wp.get_module(f"fusion.solvers.sum_kernels.float{bits}x{lanes}")
    module.options["enable_backward"] = False

    @wp.kernel(module=module)
    def total_terms(
        busy: wp.array(dtype=wp.int32),
        of_vertices: wp.array3d(dtype=lane),
        of_pixels: wp.array2d(dtype=lane),
        terms: wp.array2d(dtype=exact),
    ):
        """A term each thread: the sum of what vertices add to it, or, for the last one, faces with pixels."""
        term, g = wp.tid()
        if busy[g] == 0:
            return
        count = of_pixels.shape[0]
        if term < of_vertices.shape[0]:
            count = of_vertices.shape[1]
        total = exact()
        for first in range(0, count, BLOCK):
            part = lane()
            for i in range(first, wp.min(first + BLOCK, count)):
                if term < of_vertices.shape[0]:
                    part += of_vertices[term, i, g]
                else:
                    part += of_pixels[i, g]
            for k in range(lanes):
                total[k] += wp.float64(part[k])
        terms[term, g] = total

    return SimpleNamespace(total_terms=total_terms)
