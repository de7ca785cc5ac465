"""Warp kernels of `fusion.solvers.memory`: steps and changes of gradients, and products of them.

Laid out as in `fusion.solvers.energy_kernels`. Products of whole frames are summed by blocks of vertices, a thread
each; who reads them adds up the blocks, in double precision.
"""

# mypy: ignore-errors
# ruff: noqa: PLR0915, PLR0917
# Kernels are written in Warp's own language: its annotations are no Python types.

from functools import cache
from threading import Lock
from types import SimpleNamespace

import warp as wp

from fusion.solvers.energy_kernels import lane_type

_defining = Lock()


def memory_kernels(bits: int, lanes: int) -> SimpleNamespace:
    """The kernels for float32 or float64 (`bits` 32 or 64) and groups of so many frames, built when first used."""
    with _defining:
        return _defined(bits, lanes)


@cache
def _defined(bits: int, lanes: int) -> SimpleNamespace:
    real, lane = lane_type(bits, lanes)
    exact = wp.types.vector(lanes, wp.float64)
    module = wp.get_module(f"fusion.solvers.memory_kernels.float{bits}x{lanes}")
    module.options["enable_backward"] = False

    @wp.kernel(module=module)
    def products(
        busy: wp.array(dtype=wp.int32),
        count: wp.int32,
        block: wp.int32,
        first: wp.array4d(dtype=lane),
        second: wp.array3d(dtype=lane),
        blocks: wp.array3d(dtype=lane),
    ):
        """Of each of several first ones with one second, block by block: (B, K, G)."""
        b, k, g = wp.tid()
        if busy[g] == 0:
            return
        total = lane()
        for i in range(b * block, wp.min((b + 1) * block, count)):
            for axis in range(3):
                total += wp.cw_mul(first[k, i, axis, g], second[i, axis, g])
        blocks[b, k, g] = total

    @wp.func(module=module)
    def summed(blocks: wp.array3d(dtype=lane), k: int, g: int):
        """A product (its k-th), in double precision."""
        total = exact()
        for b in range(blocks.shape[0]):
            part = blocks[b, k, g]
            for m in range(lanes):
                total[m] += wp.float64(part[m])
        return total

    @wp.kernel(module=module)
    def first_loop(
        busy: wp.array(dtype=wp.int32),
        order: wp.array(dtype=wp.int32),
        blocks: wp.array3d(dtype=lane),
        inverse: wp.array2d(dtype=exact),
        by_change: wp.array3d(dtype=exact),
        alphas: wp.array2d(dtype=exact),
        factors: wp.array2d(dtype=lane),
    ):
        """The first loop of L-BFGS, newest pair first, from the products of the steps with the gradient.

        `order` are the pairs from the oldest to the newest, -1 for those that there are not yet.
        """
        g = wp.tid()
        pairs = order.shape[0]
        for back in range(pairs):
            at = pairs - 1 - back
            k = order[at]
            if k >= 0:
                along = summed(blocks, k, g)
                for newer in range(pairs - 1, at, -1):
                    other = order[newer]
                    if other >= 0:
                        along -= wp.cw_mul(alphas[other, g], by_change[k, other, g])
                alpha = wp.cw_mul(along, inverse[k, g])
                alphas[k, g] = alpha
                factor = lane()
                for m in range(lanes):
                    factor[m] = -real(alpha[m])
                factors[k, g] = factor

    @wp.kernel(module=module)
    def second_loop(
        busy: wp.array(dtype=wp.int32),
        order: wp.array(dtype=wp.int32),
        blocks: wp.array3d(dtype=lane),
        inverse: wp.array2d(dtype=exact),
        by_change: wp.array3d(dtype=exact),
        alphas: wp.array2d(dtype=exact),
        lengths: wp.array2d(dtype=exact),
        factors: wp.array2d(dtype=lane),
    ):
        """The second loop, oldest pair first, from the products of the changes with the solution."""
        g = wp.tid()
        for at in range(order.shape[0]):
            k = order[at]
            if k >= 0:
                along = summed(blocks, k, g)
                for older in range(at):
                    other = order[older]
                    if other >= 0:
                        along += wp.cw_mul(lengths[other, g], by_change[other, k, g])
                length = alphas[k, g] - wp.cw_mul(along, inverse[k, g])
                lengths[k, g] = length
                factor = lane()
                for m in range(lanes):
                    factor[m] = -real(length[m])
                factors[k, g] = factor

    @wp.kernel(module=module)
    def judge_pair(
        busy: wp.array(dtype=wp.int32),
        place: wp.array(dtype=wp.int32),
        curvature: wp.float64,
        blocks: wp.array3d(dtype=lane),
        slope_blocks: wp.array3d(dtype=lane),
        length: wp.array(dtype=lane),
        inverse: wp.array2d(dtype=exact),
        by_change: wp.array3d(dtype=exact),
    ):
        """Keep the products of all steps with the newest change, and what they say of it: 1 / curvature, or 0 where
        the slope has not changed by the fraction `curvature` of it."""
        g = wp.tid()
        new = place[0]
        for k in range(inverse.shape[0]):
            by_change[k, new, g] = summed(blocks, k, g)
        own = by_change[new, new, g]
        slope = summed(slope_blocks, 0, g)
        step = length[g]
        found = exact()
        for m in range(lanes):
            if own[m] > curvature * wp.abs(wp.float64(step[m]) * slope[m]):
                found[m] = wp.float64(1.0) / own[m]
        inverse[new, g] = found

    @wp.kernel(module=module)
    def combine(
        busy: wp.array(dtype=wp.int32),
        base: wp.array3d(dtype=lane),
        factors: wp.array2d(dtype=lane),
        others: wp.array4d(dtype=lane),
        found: wp.array3d(dtype=lane),
    ):
        """A base plus several others, each with a factor by frame."""
        i, g = wp.tid()
        if busy[g] == 0:
            return
        for axis in range(3):
            total = base[i, axis, g]
            for k in range(factors.shape[0]):
                total += wp.cw_mul(factors[k, g], others[k, i, axis, g])
            found[i, axis, g] = total

    @wp.kernel(module=module)
    def remember(
        busy: wp.array(dtype=wp.int32),
        count: wp.int32,
        block: wp.int32,
        place: wp.array(dtype=wp.int32),
        vertices: wp.array3d(dtype=lane),
        vertices_before: wp.array3d(dtype=lane),
        gradient: wp.array3d(dtype=lane),
        gradient_before: wp.array3d(dtype=lane),
        steps: wp.array4d(dtype=lane),
        changes: wp.array4d(dtype=lane),
        blocks: wp.array3d(dtype=lane),
    ):
        """Keep the newest step and change of gradient, and, by blocks, the products of all steps with that change; what
        is now takes the place of what was before."""
        b, g = wp.tid()
        if busy[g] == 0:
            return
        new = place[0]
        last = wp.min((b + 1) * block, count)
        for i in range(b * block, last):
            for axis in range(3):
                here = vertices[i, axis, g]
                steps[new, i, axis, g] = here - vertices_before[i, axis, g]
                vertices_before[i, axis, g] = here
                slope = gradient[i, axis, g]
                changes[new, i, axis, g] = slope - gradient_before[i, axis, g]
                gradient_before[i, axis, g] = slope
        for k in range(steps.shape[0]):
            total = lane()
            for i in range(b * block, last):
                for axis in range(3):
                    total += wp.cw_mul(steps[k, i, axis, g], changes[new, i, axis, g])
            blocks[b, k, g] = total

    return SimpleNamespace(
        products=products,
        first_loop=first_loop,
        second_loop=second_loop,
        judge_pair=judge_pair,
        combine=combine,
        remember=remember,
    )
