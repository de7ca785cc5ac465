"""Warp kernels of `fusion.solvers.contact` and `fusion.solvers.memory`: steps of vertices, and products of them.

Laid out as in `fusion.solvers.energy_kernels`. Products of whole frames are summed by blocks of vertices, a thread
each; who reads them adds up the blocks, in double precision.
"""

# mypy: ignore-errors
# ruff: noqa: PLR0915, PLR0917, SIM102
# Kernels are written in Warp's own language: its annotations are no Python types.

from functools import cache
from threading import Lock
from types import SimpleNamespace

import warp as wp

from fusion.solvers.energy_kernels import lane_functions, lane_type

_defining = Lock()


def descent_kernels(bits: int, lanes: int) -> SimpleNamespace:
    """The kernels for float32 or float64 (`bits` 32 or 64) and groups of so many frames, built when first used."""
    with _defining:
        return _defined(bits, lanes)


@cache
def _defined(bits: int, lanes: int) -> SimpleNamespace:
    real, lane = lane_type(bits, lanes)
    exact = wp.types.vector(lanes, wp.float64)
    dot = lane_functions(bits, lanes).dot
    module = wp.get_module(f"fusion.solvers.descent_kernels.float{bits}x{lanes}")
    module.options["enable_backward"] = False

    @wp.kernel(module=module)
    def project(
        busy: wp.array(dtype=wp.int32),
        vertices: wp.array3d(dtype=lane),
        gradient: wp.array3d(dtype=lane),
        plane: wp.array3d(dtype=lane),
        offset: wp.array2d(dtype=lane),
        loose: wp.array(dtype=wp.int32),
        touching: real,
        directions: wp.array3d(dtype=lane),
        projected: wp.array3d(dtype=lane),
    ):
        """Directions without what pinned vertices and those pressed against their planes cannot do."""
        i, g = wp.tid()
        if busy[g] == 0:
            return
        # One by one: names that are assigned together would be the array's own numbers.
        x = directions[i, 0, g]
        y = directions[i, 1, g]
        z = directions[i, 2, g]
        if plane:
            nx, ny, nz = plane[i, 0, g], plane[i, 1, g], plane[i, 2, g]
            gap = dot(nx, ny, nz, vertices[i, 0, g], vertices[i, 1, g], vertices[i, 2, g]) - offset[i, g]
            push = dot(nx, ny, nz, gradient[i, 0, g], gradient[i, 1, g], gradient[i, 2, g])
            into = dot(nx, ny, nz, x, y, z)
            for k in range(lanes):
                if gap[k] > touching or push[k] <= real(0.0):
                    into[k] = real(0.0)
            x -= wp.cw_mul(nx, into)
            y -= wp.cw_mul(ny, into)
            z -= wp.cw_mul(nz, into)
        if loose:
            if loose[i] == 0:
                x = lane()
                y = lane()
                z = lane()
        projected[i, 0, g] = x
        projected[i, 1, g] = y
        projected[i, 2, g] = z

    @wp.kernel(module=module)
    def advance(
        busy: wp.array(dtype=wp.int32),
        moving: wp.array(dtype=lane),
        vertices: wp.array3d(dtype=lane),
        direction: wp.array3d(dtype=lane),
        length: wp.array(dtype=lane),
        plane: wp.array3d(dtype=lane),
        offset: wp.array2d(dtype=lane),
        loose: wp.array(dtype=wp.int32),
        target: wp.array3d(dtype=lane),
    ):
        """Vertices after a step, those that would be below their planes brought up to them.

        Frames that are not moving (0) keep their target.
        """
        i, g = wp.tid()
        if busy[g] == 0:
            return
        x = vertices[i, 0, g]
        y = vertices[i, 1, g]
        z = vertices[i, 2, g]
        free = 1
        if loose:
            free = loose[i]
        if free != 0:
            step = length[g]
            x += wp.cw_mul(step, direction[i, 0, g])
            y += wp.cw_mul(step, direction[i, 1, g])
            z += wp.cw_mul(step, direction[i, 2, g])
            if plane:
                nx, ny, nz = plane[i, 0, g], plane[i, 1, g], plane[i, 2, g]
                below = offset[i, g] - dot(nx, ny, nz, x, y, z)
                for k in range(lanes):
                    below[k] = wp.max(below[k], real(0.0))
                x += wp.cw_mul(nx, below)
                y += wp.cw_mul(ny, below)
                z += wp.cw_mul(nz, below)
        live = moving[g]
        old_x, old_y, old_z = target[i, 0, g], target[i, 1, g], target[i, 2, g]
        for k in range(lanes):
            x[k] = wp.where(live[k] > real(0.0), x[k], old_x[k])
            y[k] = wp.where(live[k] > real(0.0), y[k], old_y[k])
            z[k] = wp.where(live[k] > real(0.0), z[k], old_z[k])
        target[i, 0, g] = x
        target[i, 1, g] = y
        target[i, 2, g] = z

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
        scale: real,
        base: wp.array3d(dtype=lane),
        factors: wp.array2d(dtype=lane),
        others: wp.array4d(dtype=lane),
        found: wp.array3d(dtype=lane),
    ):
        """scale · base plus several others, each with a factor by frame."""
        i, g = wp.tid()
        if busy[g] == 0:
            return
        for axis in range(3):
            total = base[i, axis, g] * scale
            for k in range(factors.shape[0]):
                total += wp.cw_mul(factors[k, g], others[k, i, axis, g])
            found[i, axis, g] = total

    @wp.kernel(module=module)
    def differ(
        busy: wp.array(dtype=wp.int32),
        place: wp.array(dtype=wp.int32),
        now: wp.array3d(dtype=lane),
        before: wp.array3d(dtype=lane),
        difference: wp.array3d(dtype=lane),
        kept: wp.array4d(dtype=lane),
    ):
        """What has changed, also among those kept; what is now takes the place of what was before."""
        i, g = wp.tid()
        if busy[g] == 0:
            return
        for axis in range(3):
            here = now[i, axis, g]
            change = here - before[i, axis, g]
            difference[i, axis, g] = change
            kept[place[0], i, axis, g] = change
            before[i, axis, g] = here

    @wp.kernel(module=module)
    def substitute(
        busy: wp.array(dtype=wp.int32),
        count: wp.int32,
        order: wp.array(dtype=wp.int32),
        row_start: wp.array(dtype=wp.int32),
        row_columns: wp.array(dtype=wp.int32),
        row_values: wp.array(dtype=real),
        inverse_diagonal: wp.array(dtype=real),
        column_start: wp.array(dtype=wp.int32),
        column_rows: wp.array(dtype=wp.int32),
        column_values: wp.array(dtype=real),
        right: wp.array3d(dtype=lane),
        work: wp.array3d(dtype=lane),
        solution: wp.array3d(dtype=lane),
    ):
        """Solution of L D Lᵀ x = right, L with ones on its diagonal, below it by rows and by columns.

        Row k belongs to vertex order[k]; work is in the order of the rows, which keeps neighbours together.
        """
        g = wp.tid()
        if busy[g] == 0:
            return
        for k in range(count):
            i = order[k]
            x = right[i, 0, g]
            y = right[i, 1, g]
            z = right[i, 2, g]
            for entry in range(row_start[k], row_start[k + 1]):
                j = row_columns[entry]
                value = row_values[entry]
                x -= work[j, 0, g] * value
                y -= work[j, 1, g] * value
                z -= work[j, 2, g] * value
            work[k, 0, g] = x
            work[k, 1, g] = y
            work[k, 2, g] = z
        for back in range(count):
            k = count - 1 - back
            i = order[k]
            scale = inverse_diagonal[k]
            x = work[k, 0, g] * scale
            y = work[k, 1, g] * scale
            z = work[k, 2, g] * scale
            for entry in range(column_start[k], column_start[k + 1]):
                j = column_rows[entry]
                value = column_values[entry]
                x -= work[j, 0, g] * value
                y -= work[j, 1, g] * value
                z -= work[j, 2, g] * value
            work[k, 0, g] = x
            work[k, 1, g] = y
            work[k, 2, g] = z
            solution[i, 0, g] = x
            solution[i, 1, g] = y
            solution[i, 2, g] = z

    return SimpleNamespace(
        project=project,
        advance=advance,
        products=products,
        first_loop=first_loop,
        second_loop=second_loop,
        judge_pair=judge_pair,
        combine=combine,
        differ=differ,
        substitute=substitute,
    )
