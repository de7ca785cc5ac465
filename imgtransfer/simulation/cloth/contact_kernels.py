"""Warp kernels of a cloth's contacts: with the surface that it lies on, and with itself.

Both are planes that a vertex is pushed off with a penalty and that it rubs against. The plane of a contact with the
cloth itself goes through the nearest triangle of another part of it and moves with that triangle, whose corners get
the opposite force.
"""

# mypy: ignore-errors
# ruff: noqa: PLR0911, PLR0912, PLR0917, RUF046, UP018
# Kernels are written in Warp's own language: its annotations are no Python types, arguments go by position, and what a
# loop changes must be made a variable by its type's name.

import warp as wp

wp.set_module_options({"enable_backward": False})

_SLIP_SPEED = wp.constant(0.01)  # m/s, below which friction grows with the speed instead of being constant
MOST_ON_CORNER = 12  # contacts that one corner of triangles feels; more are not counted
_MOST = wp.constant(MOST_ON_CORNER)
# Cosine of the direction to a triangle with its normal; with less the vertex is beside it.
_STEEP = wp.constant(0.5)


@wp.struct
class Fabric:
    """Material and contact constants, as in `ClothConfig`."""

    stretch: float
    stretch_damping: float
    bending_damping: float
    contact_stiffness: float
    contact_damping: float
    friction: float
    thickness: float
    relaxation: float  # factor on every move of a vertex


@wp.struct
class Touch:
    """Where the cloth touches itself; a row a vertex."""

    apart: float  # metres that layers keep from each other; 0 lets them pass
    stiffness: float  # N/m of a vertex
    rest: wp.array(dtype=wp.vec3)  # where the vertices lie in the rest shape
    face: wp.array(dtype=int)  # the triangle that a vertex touches, -1 for none
    weights: wp.array(dtype=wp.vec3)  # barycentric, of the closest point of it
    side: wp.array(dtype=float)  # 1 or -1, of the triangle that the vertex belongs on
    normal: wp.array(dtype=wp.vec3)  # from the triangle to where the vertex belongs
    tangled: wp.array(dtype=int)  # whether an edge of the vertex passes through the cloth
    count: wp.array(dtype=int)  # number of vertices that touch the triangles around this one, and which
    others: wp.array2d(dtype=int)
    faces: wp.array(dtype=wp.vec3i)


@wp.func
def plane_contact(
    fabric: Fabric,
    stiffness: float,
    thickness: float,
    dt: float,
    x: wp.vec3,
    start: wp.vec3,
    p: wp.vec3,
    n: wp.vec3,
    v: wp.vec3,
):
    """Penalty force of a plane at p, damped on approach, with Coulomb friction against its velocity v."""
    force, hessian = wp.vec3(0.0), wp.mat33(0.0)
    depth = thickness - wp.dot(n, x - p)
    if wp.dot(n, n) > 0.0 and depth > 0.0:
        slip = x - start - dt * v
        along = wp.dot(n, slip)
        load = stiffness * depth
        k = stiffness
        force = load * n
        if along < 0.0:
            force -= fabric.contact_damping / dt * along * n
            k += fabric.contact_damping / dt
        slip = slip - along * n
        slip_length, static_slip = wp.length(slip), _SLIP_SPEED * dt
        grip = fabric.friction * load
        if slip_length > static_slip:
            grip = grip / slip_length
        else:
            grip = grip * (2.0 - slip_length / static_slip) / static_slip
        force -= grip * slip
        hessian = wp.outer(n, n) * (k - grip) + wp.identity(n=3, dtype=float) * grip
    return force, hessian


@wp.func
def closest_weights(x: wp.vec3, a: wp.vec3, b: wp.vec3, c: wp.vec3) -> wp.vec3:
    """Barycentric weights of the triangle's point that is closest to x (Ericson 2005, section 5.1.5)."""
    ab, ac, ap = b - a, c - a, x - a
    d1, d2 = wp.dot(ab, ap), wp.dot(ac, ap)
    if d1 <= 0.0 and d2 <= 0.0:
        return wp.vec3(1.0, 0.0, 0.0)
    bp = x - b
    d3, d4 = wp.dot(ab, bp), wp.dot(ac, bp)
    if d3 >= 0.0 and d4 <= d3:
        return wp.vec3(0.0, 1.0, 0.0)
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        v = d1 / (d1 - d3)
        return wp.vec3(1.0 - v, v, 0.0)
    cp = x - c
    d5, d6 = wp.dot(ab, cp), wp.dot(ac, cp)
    if d6 >= 0.0 and d5 <= d6:
        return wp.vec3(0.0, 0.0, 1.0)
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        w = d2 / (d2 - d6)
        return wp.vec3(1.0 - w, 0.0, w)
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return wp.vec3(0.0, 1.0 - w, w)
    whole = va + vb + vc
    if whole <= 0.0:
        return wp.vec3(1.0, 0.0, 0.0)
    return wp.vec3(va / whole, vb / whole, vc / whole)


@wp.func
def _has(face: wp.vec3i, i: int) -> bool:
    return face[0] == i or face[1] == i or face[2] == i


@wp.func
def _mix(weights: wp.vec3, face: wp.vec3i, of: wp.array(dtype=wp.vec3)) -> wp.vec3:
    return weights[0] * of[face[0]] + weights[1] * of[face[1]] + weights[2] * of[face[2]]


@wp.func
def _near_at_rest(touch: Touch, i: int, face: wp.vec3i) -> bool:
    """Whether the triangle lies so near the vertex in the rest shape that they would always touch."""
    x, least = touch.rest[i], 2.0 * touch.apart
    weights = closest_weights(x, touch.rest[face[0]], touch.rest[face[1]], touch.rest[face[2]])
    return wp.length(x - _mix(weights, face, touch.rest)) < least


@wp.kernel
def forget_touches(touch: Touch):
    """Nobody touches the triangles around any vertex."""
    touch.count[wp.tid()] = 0


@wp.kernel
def find_touches(touch: Touch, start: wp.array(dtype=wp.vec3), cloth: wp.uint64):
    """The nearest triangle of another part of the cloth, for every vertex that has one within reach.

    A vertex that touched this triangle or a neighbour of it a step ago belongs on the side that it belonged on then, so
    that one which has slipped through is brought back. Vertices at a place where the cloth has passed through itself
    otherwise are left alone, so that it can come out.
    """
    i = wp.tid()
    x, last = start[i], int(touch.face[i])
    reach = wp.where(last >= 0, 2.0, 1.0) * touch.apart
    nearest, nearest_face, weights = float(reach), int(-1), wp.vec3(0.0)
    query = wp.mesh_query_aabb(cloth, x - wp.vec3(reach), x + wp.vec3(reach))
    t = int(0)
    while wp.mesh_query_aabb_next(query, t):
        face = touch.faces[t]
        if not _has(face, i):
            at = closest_weights(x, start[face[0]], start[face[1]], start[face[2]])
            distance = wp.length(x - _mix(at, face, start))
            if distance < nearest and not _near_at_rest(touch, i, face):
                nearest, nearest_face, weights = distance, t, at
    touch.face[i] = -1
    if nearest_face < 0:
        return
    face = touch.faces[nearest_face]
    across = wp.cross(start[face[1]] - start[face[0]], start[face[2]] - start[face[0]])
    if wp.length(across) < 1e-10:
        return
    up = wp.normalize(across)
    offset = x - _mix(weights, face, start)
    height = wp.dot(offset, up)
    side = float(wp.where(height < 0.0, -1.0, 1.0))
    known = bool(False)
    if last >= 0:
        before = touch.faces[last]
        known = _has(face, before[0]) or _has(face, before[1]) or _has(face, before[2])
    if known:
        side = touch.side[i]
    elif nearest >= touch.apart or touch.tangled[i] > 0:
        return
    normal = wp.vec3(up * side)
    if height * side > 0.0:
        if height * side < _STEEP * nearest:
            return
        if nearest > 1e-5:
            normal = offset / nearest
    touch.face[i] = nearest_face
    touch.side[i] = side
    touch.weights[i] = weights
    touch.normal[i] = normal
    for corner in range(3):
        j = face[corner]
        place = wp.atomic_add(touch.count, j, 1)
        if place < _MOST:
            touch.others[j, place] = i


@wp.func
def _touch(
    touch: Touch,
    fabric: Fabric,
    dt: float,
    i: int,
    start: wp.array(dtype=wp.vec3),
    position: wp.array(dtype=wp.vec3),
):
    """Force and Hessian on vertex i of the triangle that it touches."""
    face = touch.faces[touch.face[i]]
    p, before = _mix(touch.weights[i], face, position), _mix(touch.weights[i], face, start)
    n, velocity = touch.normal[i], (p - before) / dt
    return plane_contact(fabric, touch.stiffness, touch.apart, dt, position[i], start[i], p, n, velocity)


@wp.func
def self_contact(
    touch: Touch,
    fabric: Fabric,
    dt: float,
    i: int,
    start: wp.array(dtype=wp.vec3),
    position: wp.array(dtype=wp.vec3),
):
    """Force and Hessian on vertex i of all contacts of the cloth with itself that it takes part in."""
    force, hessian = wp.vec3(0.0), wp.mat33(0.0)
    if touch.face[i] >= 0:
        force, hessian = _touch(touch, fabric, dt, i, start, position)
    for place in range(wp.min(touch.count[i], _MOST)):
        other = touch.others[i, place]
        face, weights = touch.faces[touch.face[other]], touch.weights[other]
        weight = weights[0]
        if face[1] == i:
            weight = weights[1]
        elif face[2] == i:
            weight = weights[2]
        f, h = _touch(touch, fabric, dt, other, start, position)
        force -= weight * f
        hessian += weight * weight * h
    return force, hessian


@wp.func
def _crosses(
    edge: wp.vec2i, faces: wp.array(dtype=wp.vec3i), cloth: wp.uint64, position: wp.array(dtype=wp.vec3)
) -> bool:
    """Whether an edge passes through a triangle that it has no corner of."""
    a, b = position[edge[0]], position[edge[1]]
    crosses = bool(False)
    query = wp.mesh_query_aabb(cloth, wp.min(a, b), wp.max(a, b))
    t = int(0)
    while wp.mesh_query_aabb_next(query, t):
        face = faces[t]
        if not _has(face, edge[0]) and not _has(face, edge[1]):
            p, q, r = position[face[0]], position[face[1]], position[face[2]]
            across = wp.cross(q - p, r - p)
            from_a, from_b = wp.dot(across, a - p), wp.dot(across, b - p)
            if from_a * from_b < 0.0:
                x = a + (b - a) * (from_a / (from_a - from_b))
                u = wp.dot(wp.cross(q - p, x - p), across)
                v = wp.dot(wp.cross(r - q, x - q), across)
                w = wp.dot(wp.cross(p - r, x - r), across)
                crosses = crosses or (u > 0.0 and v > 0.0 and w > 0.0)
    return crosses


@wp.kernel
def find_tangles(
    touch: Touch, edges: wp.array(dtype=wp.vec2i), cloth: wp.uint64, position: wp.array(dtype=wp.vec3)
):
    """Mark the ends of edges that pass through the cloth; `touch.tangled` must be 0 before."""
    edge = edges[wp.tid()]
    if _crosses(edge, touch.faces, cloth, position):
        touch.tangled[edge[0]] = 1
        touch.tangled[edge[1]] = 1
