"""Warp kernels of `fusion.solvers.energy`; residual from it, because defining them imports Warp.

One thread works on one vertex, edge or face of one frame, and adds its terms to the vertices at its ends, so that
nothing is computed twice. On the CPU threads run in order and results repeat exactly; on CUDA sums are taken in any
order, and repeat up to rounding. A frame's do not depend on the frames beside it.
"""

# mypy: ignore-errors
# ruff: noqa: PLR0915, PLR0917, SIM102
# Kernels are written in Warp's own language: its annotations are no Python types.

from functools import cache
from threading import Lock
from types import SimpleNamespace

import warp as wp

# Rows of the energies' table of edges, one value an edge.
EDGE, CONSISTENCY = 0, 1

_defining = Lock()


def kernels(bits: int) -> SimpleNamespace:
    """The kernels for float32 or float64 (`bits` 32 or 64), each a module of its own that is built when first used.

    Two threads that ask at once get the same: a second definition would take the first one's place in Warp's module.
    """
    with _defining:
        return _defined(bits)


@cache
def _defined(bits: int) -> SimpleNamespace:
    real = wp.float64 if bits == 64 else wp.float32
    vec3 = wp.types.vector(3, real)
    module = wp.get_module(f"fusion.solvers.energy_kernels.float{bits}")
    module.options["enable_backward"] = False

    @wp.kernel(module=module)
    def begin(
        active: wp.array(dtype=wp.int32),
        vertices: wp.array2d(dtype=vec3),
        anchor: wp.array2d(dtype=vec3),
        vertex_weights: wp.array2d(dtype=real),
        weight_displacement: real,
        normal_sum: wp.array2d(dtype=vec3),
        normal_gradient: wp.array2d(dtype=vec3),
        gradient: wp.array2d(dtype=vec3),
        energy: wp.array2d(dtype=real),
    ):
        """The displacement term; all sums that other kernels add to, put to their first value."""
        t, i = wp.tid()
        if active[t] == 0:
            return
        away = vertices[t, i] - anchor[t, i]
        energy[t, i] = vertex_weights[t, i] * wp.dot(away, away)
        gradient[t, i] = (real(2.0) * weight_displacement * vertex_weights[t, i]) * away
        if normal_sum:
            normal_sum[t, i] = vec3()
            normal_gradient[t, i] = vec3()

    @wp.kernel(module=module)
    def face_normals(
        active: wp.array(dtype=wp.int32),
        vertices: wp.array2d(dtype=vec3),
        faces: wp.array2d(dtype=wp.int32),
        normal_sum: wp.array2d(dtype=vec3),
    ):
        """Twice the area times the normal of each face, added to its corners."""
        t, f = wp.tid()
        if active[t] == 0:
            return
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        here = vertices[t, a]
        normal = wp.cross(vertices[t, b] - here, vertices[t, c] - here)
        wp.atomic_add(normal_sum, t, a, normal)
        wp.atomic_add(normal_sum, t, b, normal)
        wp.atomic_add(normal_sum, t, c, normal)

    @wp.kernel(module=module)
    def unit_normals(
        active: wp.array(dtype=wp.int32),
        normal_sum: wp.array2d(dtype=vec3),
        inverse_length: wp.array2d(dtype=real),
    ):
        """Unit vertex normals in place, and 1 / length before scaling; both 0 where faces have no area."""
        t, i = wp.tid()
        if active[t] == 0:
            return
        total = normal_sum[t, i]
        length = wp.length(total)
        inverse = real(0.0)
        if length > real(0.0):
            inverse = real(1.0) / length
        normal_sum[t, i] = total * inverse
        inverse_length[t, i] = inverse

    @wp.kernel(module=module)
    def pixels(
        active: wp.array(dtype=wp.int32),
        normal: wp.array2d(dtype=vec3),
        faces: wp.array2d(dtype=wp.int32),
        pixel_start: wp.array(dtype=wp.int32),
        weights: wp.array(dtype=vec3),
        target: wp.array2d(dtype=vec3),
        confidence: wp.array2d(dtype=real),
        weight_rendering: real,
        normal_gradient: wp.array2d(dtype=vec3),
        energy: wp.array2d(dtype=real),
    ):
        """Sum over a face's pixels of |rendered - target|; its gradient in the normals of the face's corners."""
        t, f = wp.tid()
        if active[t] == 0:
            return
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        n0, n1, n2 = normal[t, a], normal[t, b], normal[t, c]
        g0, g1, g2 = vec3(), vec3(), vec3()
        total = real(0.0)
        for p in range(pixel_start[f], pixel_start[f + 1]):
            w = weights[p]
            residual = n0 * w[0] + n1 * w[1] + n2 * w[2] - target[t, p]
            length = wp.length(residual)
            trust = real(1.0)
            if confidence:
                trust = confidence[t, p]
            total += trust * length
            if length > real(0.0):
                unit = residual * (weight_rendering * trust / length)
                g0 += unit * w[0]
                g1 += unit * w[1]
                g2 += unit * w[2]
        wp.atomic_add(normal_gradient, t, a, g0)
        wp.atomic_add(normal_gradient, t, b, g1)
        wp.atomic_add(normal_gradient, t, c, g2)
        energy[t, f] = total

    @wp.kernel(module=module)
    def along_edges(
        active: wp.array(dtype=wp.int32),
        vertices: wp.array2d(dtype=vec3),
        edge_start: wp.array(dtype=wp.int32),
        second: wp.array(dtype=wp.int32),
        rest_length: wp.array(dtype=real),
        weight_edge: real,
        normal: wp.array2d(dtype=vec3),
        weight_consistency: real,
        normal_gradient: wp.array2d(dtype=vec3),
        gradient: wp.array2d(dtype=vec3),
        energy: wp.array3d(dtype=real),
    ):
        """The terms that live on edges: squared change of length, and 1 - cos between the normals at the ends.

        A thread works on all edges whose first end is its vertex.
        """
        t, i = wp.tid()
        if active[t] == 0:
            return
        here, pull, around = vertices[t, i], vec3(), vec3()
        own = vec3()
        if normal:
            own = normal[t, i]
        for e in range(edge_start[i], edge_start[i + 1]):
            j = second[e]
            along = here - vertices[t, j]
            length = wp.length(along)
            change = length - rest_length[e]
            energy[t, EDGE, e] = change * change
            if length > real(0.0):
                force = along * (real(2.0) * weight_edge * change / length)
                pull += force
                wp.atomic_add(gradient, t, j, -force)
            if normal:
                other = normal[t, j]
                energy[t, CONSISTENCY, e] = real(1.0) - wp.dot(own, other)
                around += other
                wp.atomic_add(normal_gradient, t, j, own * -weight_consistency)
        wp.atomic_add(gradient, t, i, pull)
        if normal:
            wp.atomic_add(normal_gradient, t, i, around * -weight_consistency)

    @wp.kernel(module=module)
    def through_normals(
        active: wp.array(dtype=wp.int32),
        normal: wp.array2d(dtype=vec3),
        inverse_length: wp.array2d(dtype=real),
        normal_gradient: wp.array2d(dtype=vec3),
    ):
        """Gradient in the unit normals to gradient in the sums of face normals, in place."""
        t, i = wp.tid()
        if active[t] == 0:
            return
        here, total = normal[t, i], normal_gradient[t, i]
        normal_gradient[t, i] = (total - here * wp.dot(here, total)) * inverse_length[t, i]

    @wp.kernel(module=module)
    def through_faces(
        active: wp.array(dtype=wp.int32),
        vertices: wp.array2d(dtype=vec3),
        faces: wp.array2d(dtype=wp.int32),
        normal_gradient: wp.array2d(dtype=vec3),
        gradient: wp.array2d(dtype=vec3),
    ):
        """Gradient in the sums of face normals to gradient in the vertices."""
        t, f = wp.tid()
        if active[t] == 0:
            return
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        upstream = normal_gradient[t, a] + normal_gradient[t, b] + normal_gradient[t, c]
        here = vertices[t, a]
        to_b = wp.cross(vertices[t, c] - here, upstream)
        to_c = wp.cross(upstream, vertices[t, b] - here)
        wp.atomic_add(gradient, t, a, -(to_b + to_c))
        wp.atomic_add(gradient, t, b, to_b)
        wp.atomic_add(gradient, t, c, to_c)

    @wp.kernel(module=module)
    def project(
        active: wp.array(dtype=wp.int32),
        vertices: wp.array2d(dtype=vec3),
        gradient: wp.array2d(dtype=vec3),
        plane: wp.array2d(dtype=vec3),
        offset: wp.array2d(dtype=real),
        loose: wp.array(dtype=wp.int32),
        touching: real,
        directions: wp.array2d(dtype=vec3),
        projected: wp.array2d(dtype=vec3),
    ):
        """Directions without what pinned vertices and those pressed against their planes cannot do."""
        t, i = wp.tid()
        if active[t] == 0:
            return
        vector = directions[t, i]
        if plane:
            normal = plane[t, i]
            gap = wp.dot(normal, vertices[t, i]) - offset[t, i]
            if gap <= touching and wp.dot(normal, gradient[t, i]) > real(0.0):
                vector -= normal * wp.dot(normal, vector)
        if loose:
            if loose[i] == 0:
                vector = vec3()
        projected[t, i] = vector

    @wp.kernel(module=module)
    def advance(
        active: wp.array(dtype=wp.int32),
        vertices: wp.array2d(dtype=vec3),
        direction: wp.array2d(dtype=vec3),
        length: wp.array(dtype=real),
        plane: wp.array2d(dtype=vec3),
        offset: wp.array2d(dtype=real),
        loose: wp.array(dtype=wp.int32),
        target: wp.array2d(dtype=vec3),
    ):
        """Vertices after a step, those that would be below their planes brought up to them."""
        t, i = wp.tid()
        if active[t] == 0:
            return
        here = vertices[t, i]
        if loose:
            if loose[i] == 0:
                target[t, i] = here
                return
        here += direction[t, i] * length[t]
        if plane:
            below = offset[t, i] - wp.dot(plane[t, i], here)
            if below > real(0.0):
                here += plane[t, i] * below
        target[t, i] = here

    return SimpleNamespace(
        begin=begin,
        face_normals=face_normals,
        unit_normals=unit_normals,
        pixels=pixels,
        along_edges=along_edges,
        through_normals=through_normals,
        through_faces=through_faces,
        project=project,
        advance=advance,
    )
