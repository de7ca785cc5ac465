"""Warp kernels of `fusion.energy`; apart from it, because defining them imports Warp.

One thread works on one vertex (or face) of one frame and gathers what it needs, so that nothing depends on the order of
threads: results repeat exactly, and a frame's do not depend on the frames beside it.
"""

# mypy: ignore-errors
# ruff: noqa: PLR0915, PLR0917, SIM102
# Kernels are written in Warp's own language: its annotations are no Python types.

from functools import cache
from types import SimpleNamespace

import warp as wp

# Rows of the energies' table, one value a vertex.
EDGE, DISPLACEMENT, CONSISTENCY = 0, 1, 2


@cache
def kernels(bits: int) -> SimpleNamespace:
    """The kernels for float32 or float64 (`bits` 32 or 64), each a module of its own that is built when first used."""
    real = wp.float64 if bits == 64 else wp.float32
    vec3 = wp.types.vector(3, real)
    module = wp.get_module(f"fusion.energy_kernels.float{bits}")
    module.options["enable_backward"] = False

    @wp.kernel(module=module)
    def normals(
        active: wp.array(dtype=wp.int32),
        vertices: wp.array2d(dtype=vec3),
        corner_start: wp.array(dtype=wp.int32),
        corners: wp.array2d(dtype=wp.int32),
        normal: wp.array2d(dtype=vec3),
        inverse_length: wp.array2d(dtype=real),
    ):
        """Unit vertex normals, and 1 / length before scaling; both 0 where faces have no area."""
        t, i = wp.tid()
        if active[t] == 0:
            return
        here = vertices[t, i]
        total = vec3()
        for k in range(corner_start[i], corner_start[i + 1]):
            total += wp.cross(vertices[t, corners[k, 0]] - here, vertices[t, corners[k, 1]] - here)
        length = wp.length(total)
        inverse = real(0.0)
        if length > real(0.0):
            inverse = real(1.0) / length
        normal[t, i] = total * inverse
        inverse_length[t, i] = inverse

    @wp.kernel(module=module)
    def pixels(
        active: wp.array(dtype=wp.int32),
        normal: wp.array2d(dtype=vec3),
        face_corners: wp.array2d(dtype=wp.int32),
        pixel_start: wp.array(dtype=wp.int32),
        weights: wp.array(dtype=vec3),
        target: wp.array2d(dtype=vec3),
        confidence: wp.array2d(dtype=real),
        gradient: wp.array3d(dtype=vec3),
        energy: wp.array2d(dtype=real),
    ):
        """Sum over a face's pixels of |rendered - target|, and its gradient in the normals of the face's corners."""
        t, f = wp.tid()
        if active[t] == 0:
            return
        n0 = normal[t, face_corners[f, 0]]
        n1 = normal[t, face_corners[f, 1]]
        n2 = normal[t, face_corners[f, 2]]
        g0, g1, g2 = vec3(), vec3(), vec3()
        total = real(0.0)
        for p in range(pixel_start[f], pixel_start[f + 1]):
            w = weights[p]
            apart = n0 * w[0] + n1 * w[1] + n2 * w[2] - target[t, p]
            length = wp.length(apart)
            trust = real(1.0)
            if confidence:
                trust = confidence[t, p]
            total += trust * length
            if length > real(0.0):
                unit = apart * (trust / length)
                g0 += unit * w[0]
                g1 += unit * w[1]
                g2 += unit * w[2]
        gradient[t, f, 0] = g0
        gradient[t, f, 1] = g1
        gradient[t, f, 2] = g2
        energy[t, f] = total

    @wp.kernel(module=module)
    def through_normals(
        active: wp.array(dtype=wp.int32),
        normal: wp.array2d(dtype=vec3),
        inverse_length: wp.array2d(dtype=real),
        pixel_gradient: wp.array2d(dtype=vec3),
        shown_start: wp.array(dtype=wp.int32),
        shown: wp.array(dtype=wp.int32),
        neighbour_start: wp.array(dtype=wp.int32),
        neighbours: wp.array(dtype=wp.int32),
        weight_rendering: real,
        weight_consistency: real,
        gradient: wp.array2d(dtype=vec3),
        energy: wp.array3d(dtype=real),
    ):
        """Gradient of both normal terms in the sums of face normals around each vertex."""
        t, i = wp.tid()
        if active[t] == 0:
            return
        here = normal[t, i]
        total = vec3()
        for k in range(shown_start[i], shown_start[i + 1]):
            total += pixel_gradient[t, shown[k]]
        total *= weight_rendering
        around = vec3()
        apart = real(0.0)
        for k in range(neighbour_start[i], neighbour_start[i + 1]):
            other = normal[t, neighbours[k]]
            around += other
            apart += real(0.5) * (real(1.0) - wp.dot(here, other))
        total -= weight_consistency * around
        energy[t, CONSISTENCY, i] = apart
        gradient[t, i] = (total - here * wp.dot(here, total)) * inverse_length[t, i]

    @wp.kernel(module=module)
    def gradient(
        active: wp.array(dtype=wp.int32),
        vertices: wp.array2d(dtype=vec3),
        neighbour_start: wp.array(dtype=wp.int32),
        neighbours: wp.array(dtype=wp.int32),
        rest_length: wp.array(dtype=real),
        weight_edge: real,
        anchor: wp.array2d(dtype=vec3),
        share: wp.array2d(dtype=real),
        weight_displacement: real,
        corner_start: wp.array(dtype=wp.int32),
        corners: wp.array2d(dtype=wp.int32),
        normal_gradient: wp.array2d(dtype=vec3),
        found: wp.array2d(dtype=vec3),
        energy: wp.array3d(dtype=real),
    ):
        """Gradient of the whole energy in one vertex; the energies of the terms that live on vertices and edges."""
        t, i = wp.tid()
        if active[t] == 0:
            return
        here = vertices[t, i]
        total = vec3()
        stretch = real(0.0)
        for k in range(neighbour_start[i], neighbour_start[i + 1]):
            along = here - vertices[t, neighbours[k]]
            length = wp.length(along)
            change = length - rest_length[k]
            stretch += real(0.5) * change * change
            if length > real(0.0):
                total += along * (change / length)
        total *= real(2.0) * weight_edge
        energy[t, EDGE, i] = stretch

        away = here - anchor[t, i]
        energy[t, DISPLACEMENT, i] = share[t, i] * wp.dot(away, away)
        total += (real(2.0) * weight_displacement * share[t, i]) * away

        if normal_gradient:
            own = normal_gradient[t, i]
            for k in range(corner_start[i], corner_start[i + 1]):
                a, b = corners[k, 0], corners[k, 1]
                upstream = own + normal_gradient[t, a] + normal_gradient[t, b]
                total += wp.cross(upstream, vertices[t, b] - vertices[t, a])
        found[t, i] = total

    @wp.kernel(module=module)
    def free(
        active: wp.array(dtype=wp.int32),
        vertices: wp.array2d(dtype=vec3),
        gradient: wp.array2d(dtype=vec3),
        plane: wp.array2d(dtype=vec3),
        offset: wp.array2d(dtype=real),
        loose: wp.array(dtype=wp.int32),
        touching: real,
        vectors: wp.array2d(dtype=vec3),
        found: wp.array2d(dtype=vec3),
    ):
        """Vectors without what fixed vertices and those pressed against their planes cannot do."""
        t, i = wp.tid()
        if active[t] == 0:
            return
        vector = vectors[t, i]
        if plane:
            normal = plane[t, i]
            gap = wp.dot(normal, vertices[t, i]) - offset[t, i]
            if gap <= touching and wp.dot(normal, gradient[t, i]) > real(0.0):
                vector -= normal * wp.dot(normal, vector)
        if loose:
            if loose[i] == 0:
                vector = vec3()
        found[t, i] = vector

    @wp.kernel(module=module)
    def advance(
        active: wp.array(dtype=wp.int32),
        vertices: wp.array2d(dtype=vec3),
        direction: wp.array2d(dtype=vec3),
        length: wp.array(dtype=real),
        plane: wp.array2d(dtype=vec3),
        offset: wp.array2d(dtype=real),
        loose: wp.array(dtype=wp.int32),
        found: wp.array2d(dtype=vec3),
    ):
        """Vertices after a step, those that would be below their planes brought up to them."""
        t, i = wp.tid()
        if active[t] == 0:
            return
        here = vertices[t, i]
        if loose:
            if loose[i] == 0:
                found[t, i] = here
                return
        here += direction[t, i] * length[t]
        if plane:
            below = offset[t, i] - wp.dot(plane[t, i], here)
            if below > real(0.0):
                here += plane[t, i] * below
        found[t, i] = here

    return SimpleNamespace(
        normals=normals,
        pixels=pixels,
        through_normals=through_normals,
        gradient=gradient,
        free=free,
        advance=advance,
    )
