"""Warp kernels of `contact`, `memory` and `system` in `fusion.solvers`: where steps of vertices may lead.

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
    dot = lane_functions(bits, lanes).dot
    module = wp.get_module(f"fusion.solvers.descent_kernels.float{bits}x{lanes}")
    module.options["enable_backward"] = False

    @wp.func(module=module)
    def pressed(
        i: int,
        g: int,
        vertices: wp.array3d(dtype=lane),
        gradient: wp.array3d(dtype=lane),
        plane: wp.array3d(dtype=lane),
        offset: wp.array2d(dtype=lane),
        touching: real,
    ):
        """1 for vertices that are pressed against their planes, else 0."""
        nx, ny, nz = plane[i, 0, g], plane[i, 1, g], plane[i, 2, g]
        gap = dot(nx, ny, nz, vertices[i, 0, g], vertices[i, 1, g], vertices[i, 2, g]) - offset[i, g]
        push = dot(nx, ny, nz, gradient[i, 0, g], gradient[i, 1, g], gradient[i, 2, g])
        held = lane()
        for k in range(lanes):
            held[k] = wp.where(gap[k] > touching or push[k] <= real(0.0), real(0.0), real(1.0))
        return held

    @wp.func(module=module)
    def project(
        i: int,
        g: int,
        vertices: wp.array3d(dtype=lane),
        gradient: wp.array3d(dtype=lane),
        plane: wp.array3d(dtype=lane),
        offset: wp.array2d(dtype=lane),
        loose: wp.array(dtype=wp.int32),
        touching: real,
        directions: wp.array3d(dtype=lane),
    ):
        """Take from directions what pinned vertices and those pressed against their planes cannot do."""
        if plane:
            nx, ny, nz = plane[i, 0, g], plane[i, 1, g], plane[i, 2, g]
            held = pressed(i, g, vertices, gradient, plane, offset, touching)
            into = wp.cw_mul(
                held, dot(nx, ny, nz, directions[i, 0, g], directions[i, 1, g], directions[i, 2, g])
            )
            for axis in range(3):
                directions[i, axis, g] = directions[i, axis, g] - wp.cw_mul(plane[i, axis, g], into)
        if loose:
            if loose[i] == 0:
                for axis in range(3):
                    directions[i, axis, g] = lane()

    @wp.kernel(module=module)
    def open_gradient(
        busy: wp.array(dtype=wp.int32),
        count: wp.int32,
        block: wp.int32,
        vertices: wp.array3d(dtype=lane),
        gradient: wp.array3d(dtype=lane),
        plane: wp.array3d(dtype=lane),
        offset: wp.array2d(dtype=lane),
        loose: wp.array(dtype=wp.int32),
        touching: real,
        steps: wp.array4d(dtype=lane),
        projected: wp.array3d(dtype=lane),
        blocks: wp.array3d(dtype=lane),
    ):
        """The gradient without what is not open to the vertices, and, by blocks, its products with several steps."""
        b, g = wp.tid()
        if busy[g] == 0:
            return
        last = wp.min((b + 1) * block, count)
        for i in range(b * block, last):
            for axis in range(3):
                projected[i, axis, g] = gradient[i, axis, g]
            project(i, g, vertices, gradient, plane, offset, loose, touching, projected)
        for k in range(steps.shape[0]):
            total = lane()
            for i in range(b * block, last):
                for axis in range(3):
                    total += wp.cw_mul(steps[k, i, axis, g], projected[i, axis, g])
            blocks[b, k, g] = total

    @wp.kernel(module=module)
    def lead(
        busy: wp.array(dtype=wp.int32),
        count: wp.int32,
        block: wp.int32,
        vertices: wp.array3d(dtype=lane),
        gradient: wp.array3d(dtype=lane),
        plane: wp.array3d(dtype=lane),
        offset: wp.array2d(dtype=lane),
        loose: wp.array(dtype=wp.int32),
        touching: real,
        solution: wp.array3d(dtype=lane),
        factors: wp.array2d(dtype=lane),
        steps: wp.array4d(dtype=lane),
        projected: wp.array3d(dtype=lane),
        direction: wp.array3d(dtype=lane),
        blocks: wp.array3d(dtype=lane),
    ):
        """The direction: minus the solution plus several steps, each with a factor by frame, of which what is not open
        has been taken away; and, by blocks, its products with the projected gradient."""
        b, g = wp.tid()
        if busy[g] == 0:
            return
        slope = lane()
        for i in range(b * block, wp.min((b + 1) * block, count)):
            for axis in range(3):
                total = -solution[i, axis, g]
                for k in range(factors.shape[0]):
                    total += wp.cw_mul(factors[k, g], steps[k, i, axis, g])
                direction[i, axis, g] = total
            project(i, g, vertices, gradient, plane, offset, loose, touching, direction)
            for axis in range(3):
                slope += wp.cw_mul(direction[i, axis, g], projected[i, axis, g])
        blocks[b, 0, g] = slope

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
        open_gradient=open_gradient,
        lead=lead,
        advance=advance,
        substitute=substitute,
    )
