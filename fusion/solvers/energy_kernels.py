"""Warp kernels of `fusion.solvers.energy`; residual from it, because defining them imports Warp.

One thread works on one vertex, edge or face of one group of frames, and adds its terms to the vertices at its ends, so
that nothing is computed twice. The frames of a group lie side by side in memory, as a vector: on the CPU 8 of them pass
through the vector units at once; on CUDA a group is one frame, and neighbouring threads work on neighbouring frames. On
the CPU threads run in order and results repeat exactly; on CUDA sums are taken in any order, and repeat up to rounding.
A frame's do not depend on the frames beside it.

Arrays "of lanes" have the groups as their last axis: vertices (N, 3, G), one value a vertex (N, G).
"""

# mypy: ignore-errors
# ruff: noqa: PLR0915, PLR0917
# Kernels are written in Warp's own language: its annotations are no Python types.

from functools import cache
from threading import Lock
from types import SimpleNamespace

import warp as wp

_defining = Lock()


def kernels(bits: int, lanes: int) -> SimpleNamespace:
    """The kernels for float32 or float64 (`bits` 32 or 64) and groups of so many frames, built when first used.

    Two threads that ask at once get the same: a second definition would take the first one's place in Warp's module.
    """
    with _defining:
        return _defined(bits, lanes)


def lane_type(bits: int, lanes: int):
    """The number type, and that of one number a frame of a group."""
    real = wp.float64 if bits == 64 else wp.float32
    return real, wp.types.vector(lanes, real)


@cache
def lane_functions(bits: int, lanes: int) -> SimpleNamespace:
    """Functions on numbers by frame, for kernels of `lane_type`."""
    real, lane = lane_type(bits, lanes)
    module = wp.get_module(f"fusion.solvers.lane_functions.float{bits}x{lanes}")

    @wp.func(module=module)
    def dot(ax: lane, ay: lane, az: lane, bx: lane, by: lane, bz: lane):
        """Products of vectors, frame by frame."""
        return wp.cw_mul(ax, bx) + wp.cw_mul(ay, by) + wp.cw_mul(az, bz)

    @wp.func(module=module)
    def root(x: lane):
        """Square roots."""
        found = lane()
        for k in range(lanes):
            found[k] = wp.sqrt(x[k])
        return found

    @wp.func(module=module)
    def ratio(x: lane, y: lane):
        """x / y, and 0 where y is not above 0."""
        found = lane()
        for k in range(lanes):
            found[k] = wp.where(y[k] > real(0.0), x[k] / y[k], real(0.0))
        return found

    return SimpleNamespace(dot=dot, root=root, ratio=ratio)


@cache
def _defined(bits: int, lanes: int) -> SimpleNamespace:
    real, lane = lane_type(bits, lanes)
    functions = lane_functions(bits, lanes)
    dot, root, ratio = functions.dot, functions.root, functions.ratio
    vec3 = wp.types.vector(3, real)
    module = wp.get_module(f"fusion.solvers.energy_kernels.float{bits}x{lanes}")
    module.options["enable_backward"] = False

    @wp.kernel(module=module)
    def begin(
        busy: wp.array(dtype=wp.int32),
        vertices: wp.array3d(dtype=lane),
        anchor: wp.array3d(dtype=lane),
        vertex_weights: wp.array2d(dtype=lane),
        weight_displacement: real,
        normal_sum: wp.array3d(dtype=lane),
        normal_gradient: wp.array3d(dtype=lane),
        gradient: wp.array3d(dtype=lane),
        energy: wp.array2d(dtype=lane),
    ):
        """The displacement term; all sums that other kernels add to, put to their first value."""
        i, g = wp.tid()
        if busy[g] == 0:
            return
        weight = vertex_weights[i, g]
        total = lane()
        for axis in range(3):
            away = vertices[i, axis, g] - anchor[i, axis, g]
            total += wp.cw_mul(away, away)
            gradient[i, axis, g] = wp.cw_mul(weight, away) * (real(2.0) * weight_displacement)
            if normal_sum:
                normal_sum[i, axis, g] = lane()
                normal_gradient[i, axis, g] = lane()
        energy[i, g] = wp.cw_mul(weight, total)

    @wp.kernel(module=module)
    def face_normals(
        busy: wp.array(dtype=wp.int32),
        vertices: wp.array3d(dtype=lane),
        faces: wp.array2d(dtype=wp.int32),
        normal_sum: wp.array3d(dtype=lane),
    ):
        """Twice the area times the normal of each face, added to its corners."""
        f, g = wp.tid()
        if busy[g] == 0:
            return
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        x, y, z = vertices[a, 0, g], vertices[a, 1, g], vertices[a, 2, g]
        bx, by, bz = vertices[b, 0, g] - x, vertices[b, 1, g] - y, vertices[b, 2, g] - z
        cx, cy, cz = vertices[c, 0, g] - x, vertices[c, 1, g] - y, vertices[c, 2, g] - z
        nx = wp.cw_mul(by, cz) - wp.cw_mul(bz, cy)
        ny = wp.cw_mul(bz, cx) - wp.cw_mul(bx, cz)
        nz = wp.cw_mul(bx, cy) - wp.cw_mul(by, cx)
        for corner in range(3):
            i = faces[f, corner]
            wp.atomic_add(normal_sum, i, 0, g, nx)
            wp.atomic_add(normal_sum, i, 1, g, ny)
            wp.atomic_add(normal_sum, i, 2, g, nz)

    @wp.kernel(module=module)
    def unit_normals(
        busy: wp.array(dtype=wp.int32),
        normal_sum: wp.array3d(dtype=lane),
        inverse_length: wp.array2d(dtype=lane),
    ):
        """Unit vertex normals in place, and 1 / length before scaling; both 0 where faces have no area."""
        i, g = wp.tid()
        if busy[g] == 0:
            return
        x, y, z = normal_sum[i, 0, g], normal_sum[i, 1, g], normal_sum[i, 2, g]
        inverse = ratio(lane(real(1.0)), root(dot(x, y, z, x, y, z)))
        normal_sum[i, 0, g] = wp.cw_mul(x, inverse)
        normal_sum[i, 1, g] = wp.cw_mul(y, inverse)
        normal_sum[i, 2, g] = wp.cw_mul(z, inverse)
        inverse_length[i, g] = inverse

    @wp.kernel(module=module)
    def pixels(
        busy: wp.array(dtype=wp.int32),
        normal: wp.array3d(dtype=lane),
        faces: wp.array2d(dtype=wp.int32),
        pixel_start: wp.array(dtype=wp.int32),
        weights: wp.array(dtype=vec3),
        target: wp.array3d(dtype=lane),
        confidence: wp.array2d(dtype=lane),
        weight_rendering: real,
        normal_gradient: wp.array3d(dtype=lane),
        energy: wp.array2d(dtype=lane),
    ):
        """Sum over a face's pixels of |rendered - target|; its gradient in the normals of the face's corners."""
        f, g = wp.tid()
        if busy[g] == 0:
            return
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay, az = normal[a, 0, g], normal[a, 1, g], normal[a, 2, g]
        bx, by, bz = normal[b, 0, g], normal[b, 1, g], normal[b, 2, g]
        cx, cy, cz = normal[c, 0, g], normal[c, 1, g], normal[c, 2, g]
        pax, pay, paz = lane(), lane(), lane()
        pbx, pby, pbz = lane(), lane(), lane()
        pcx, pcy, pcz = lane(), lane(), lane()
        total = lane()
        for p in range(pixel_start[f], pixel_start[f + 1]):
            w = weights[p]
            x = ax * w[0] + bx * w[1] + cx * w[2] - target[p, 0, g]
            y = ay * w[0] + by * w[1] + cy * w[2] - target[p, 1, g]
            z = az * w[0] + bz * w[1] + cz * w[2] - target[p, 2, g]
            length = root(dot(x, y, z, x, y, z))
            trust = lane(real(1.0))
            if confidence:
                trust = confidence[p, g]
            total += wp.cw_mul(trust, length)
            pull = ratio(trust, length) * weight_rendering
            x, y, z = wp.cw_mul(x, pull), wp.cw_mul(y, pull), wp.cw_mul(z, pull)
            pax, pay, paz = pax + x * w[0], pay + y * w[0], paz + z * w[0]
            pbx, pby, pbz = pbx + x * w[1], pby + y * w[1], pbz + z * w[1]
            pcx, pcy, pcz = pcx + x * w[2], pcy + y * w[2], pcz + z * w[2]
        wp.atomic_add(normal_gradient, a, 0, g, pax)
        wp.atomic_add(normal_gradient, a, 1, g, pay)
        wp.atomic_add(normal_gradient, a, 2, g, paz)
        wp.atomic_add(normal_gradient, b, 0, g, pbx)
        wp.atomic_add(normal_gradient, b, 1, g, pby)
        wp.atomic_add(normal_gradient, b, 2, g, pbz)
        wp.atomic_add(normal_gradient, c, 0, g, pcx)
        wp.atomic_add(normal_gradient, c, 1, g, pcy)
        wp.atomic_add(normal_gradient, c, 2, g, pcz)
        energy[f, g] = total

    @wp.kernel(module=module)
    def along_edges(
        busy: wp.array(dtype=wp.int32),
        vertices: wp.array3d(dtype=lane),
        edge_start: wp.array(dtype=wp.int32),
        second: wp.array(dtype=wp.int32),
        rest_length: wp.array(dtype=real),
        weight_edge: real,
        gradient: wp.array3d(dtype=lane),
        energy: wp.array2d(dtype=lane),
    ):
        """Squared change of length. A thread works on all edges whose first end is its vertex."""
        i, g = wp.tid()
        if busy[g] == 0:
            return
        x, y, z = vertices[i, 0, g], vertices[i, 1, g], vertices[i, 2, g]
        pull_x, pull_y, pull_z = lane(), lane(), lane()
        total = lane()
        for e in range(edge_start[i], edge_start[i + 1]):
            j = second[e]
            along_x, along_y, along_z = x - vertices[j, 0, g], y - vertices[j, 1, g], z - vertices[j, 2, g]
            length = root(dot(along_x, along_y, along_z, along_x, along_y, along_z))
            change = length - lane(rest_length[e])
            total += wp.cw_mul(change, change)
            force = ratio(change, length) * (real(2.0) * weight_edge)
            force_x, force_y, force_z = (
                wp.cw_mul(along_x, force),
                wp.cw_mul(along_y, force),
                wp.cw_mul(along_z, force),
            )
            pull_x, pull_y, pull_z = pull_x + force_x, pull_y + force_y, pull_z + force_z
            wp.atomic_sub(gradient, j, 0, g, force_x)
            wp.atomic_sub(gradient, j, 1, g, force_y)
            wp.atomic_sub(gradient, j, 2, g, force_z)
        wp.atomic_add(gradient, i, 0, g, pull_x)
        wp.atomic_add(gradient, i, 1, g, pull_y)
        wp.atomic_add(gradient, i, 2, g, pull_z)
        energy[i, g] = total

    @wp.kernel(module=module)
    def between_normals(
        busy: wp.array(dtype=wp.int32),
        normal: wp.array3d(dtype=lane),
        edge_start: wp.array(dtype=wp.int32),
        second: wp.array(dtype=wp.int32),
        weight_consistency: real,
        normal_gradient: wp.array3d(dtype=lane),
        energy: wp.array2d(dtype=lane),
    ):
        """1 - cos between the normals at the ends of all edges whose first end is the thread's vertex."""
        i, g = wp.tid()
        if busy[g] == 0:
            return
        count = edge_start[i + 1] - edge_start[i]
        total = lane(real(count))
        for axis in range(3):
            own = normal[i, axis, g]
            around = lane()
            for e in range(edge_start[i], edge_start[i + 1]):
                j = second[e]
                around += normal[j, axis, g]
                wp.atomic_sub(normal_gradient, j, axis, g, own * weight_consistency)
            total -= wp.cw_mul(own, around)
            wp.atomic_sub(normal_gradient, i, axis, g, around * weight_consistency)
        energy[i, g] = total

    @wp.kernel(module=module)
    def through_normals(
        busy: wp.array(dtype=wp.int32),
        normal: wp.array3d(dtype=lane),
        inverse_length: wp.array2d(dtype=lane),
        normal_gradient: wp.array3d(dtype=lane),
    ):
        """Gradient in the unit normals to gradient in the sums of face normals, in place."""
        i, g = wp.tid()
        if busy[g] == 0:
            return
        x, y, z = normal[i, 0, g], normal[i, 1, g], normal[i, 2, g]
        tx, ty, tz = normal_gradient[i, 0, g], normal_gradient[i, 1, g], normal_gradient[i, 2, g]
        along, inverse = dot(x, y, z, tx, ty, tz), inverse_length[i, g]
        normal_gradient[i, 0, g] = wp.cw_mul(tx - wp.cw_mul(x, along), inverse)
        normal_gradient[i, 1, g] = wp.cw_mul(ty - wp.cw_mul(y, along), inverse)
        normal_gradient[i, 2, g] = wp.cw_mul(tz - wp.cw_mul(z, along), inverse)

    @wp.kernel(module=module)
    def through_faces(
        busy: wp.array(dtype=wp.int32),
        vertices: wp.array3d(dtype=lane),
        faces: wp.array2d(dtype=wp.int32),
        normal_gradient: wp.array3d(dtype=lane),
        gradient: wp.array3d(dtype=lane),
    ):
        """Gradient in the sums of face normals to gradient in the vertices."""
        f, g = wp.tid()
        if busy[g] == 0:
            return
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ux = normal_gradient[a, 0, g] + normal_gradient[b, 0, g] + normal_gradient[c, 0, g]
        uy = normal_gradient[a, 1, g] + normal_gradient[b, 1, g] + normal_gradient[c, 1, g]
        uz = normal_gradient[a, 2, g] + normal_gradient[b, 2, g] + normal_gradient[c, 2, g]
        x, y, z = vertices[a, 0, g], vertices[a, 1, g], vertices[a, 2, g]
        bx, by, bz = vertices[b, 0, g] - x, vertices[b, 1, g] - y, vertices[b, 2, g] - z
        cx, cy, cz = vertices[c, 0, g] - x, vertices[c, 1, g] - y, vertices[c, 2, g] - z
        to_bx = wp.cw_mul(cy, uz) - wp.cw_mul(cz, uy)
        to_by = wp.cw_mul(cz, ux) - wp.cw_mul(cx, uz)
        to_bz = wp.cw_mul(cx, uy) - wp.cw_mul(cy, ux)
        to_cx = wp.cw_mul(uy, bz) - wp.cw_mul(uz, by)
        to_cy = wp.cw_mul(uz, bx) - wp.cw_mul(ux, bz)
        to_cz = wp.cw_mul(ux, by) - wp.cw_mul(uy, bx)
        wp.atomic_sub(gradient, a, 0, g, to_bx + to_cx)
        wp.atomic_sub(gradient, a, 1, g, to_by + to_cy)
        wp.atomic_sub(gradient, a, 2, g, to_bz + to_cz)
        wp.atomic_add(gradient, b, 0, g, to_bx)
        wp.atomic_add(gradient, b, 1, g, to_by)
        wp.atomic_add(gradient, b, 2, g, to_bz)
        wp.atomic_add(gradient, c, 0, g, to_cx)
        wp.atomic_add(gradient, c, 1, g, to_cy)
        wp.atomic_add(gradient, c, 2, g, to_cz)

    return SimpleNamespace(
        begin=begin,
        face_normals=face_normals,
        unit_normals=unit_normals,
        pixels=pixels,
        along_edges=along_edges,
        between_normals=between_normals,
        through_normals=through_normals,
        through_faces=through_faces,
    )
