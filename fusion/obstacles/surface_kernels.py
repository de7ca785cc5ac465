"""Warp kernels of `surface_contact`; apart from it, because defining them imports Warp."""

# mypy: ignore-errors
# ruff: noqa: UP018, RUF046, PLR0912, PLR0915, PLR0917, PLR1714
# Kernels are written in Warp's own language: its annotations are no Python types; int(0) makes a variable where 0 were
# a constant; both sides of an `and` are computed; arguments go by position.

import warp as wp

from fusion.obstacles.crossing_kernels import corner, through
from fusion.obstacles.tree_kernels import Trees, face_point, nearest_on, numbers, overlapped

wp.set_module_options({"enable_backward": False})

# No point of a triangle is farther from its nearest corner than its longest side over the root of 3.
FARTHEST_POINT = wp.constant(0.5774)
# Metres by which distances give way, a few roundings of a coordinate.
ROUNDING = wp.constant(1.0e-6)
# Rounding of a height over a plane in float32, for sides and offset of length 1: a dozen roundings, twice.
SLACK = wp.constant(2.0e-6)


@wp.func
def height(normal: wp.vec3d, point: wp.vec3d, a: wp.vec3d):
    return wp.dot(normal, a - point)


@wp.func
def note(places: wp.array3d(dtype=float), t: int, side: int, first: wp.float64, last: wp.float64):
    """Widen the interval between an edge's crossings, measured from its first vertex, by the one at which heights of
    opposite sign become 0. `side`: 2 · edge, and 1 more where the heights are in the other order."""
    edge = side / 2
    along = float(first / (first - last))
    if side % 2 == 1:
        along = 1.0 - along
    wp.atomic_min(places, 0, t, edge, along)
    wp.atomic_max(places, 1, t, edge, along)


@wp.func
def one_side(x: wp.float64, y: wp.float64, z: wp.float64):
    zero = wp.float64(0.0)
    return (x > zero and y > zero and z > zero) or (x < zero and y < zero and z < zero)


@wp.func
def roughly(point: wp.vec3, x: wp.vec3, flat: wp.vec3, slack: float):
    """Which side of a plane a point is on, 1 or -1; 0 where float32 does not tell."""
    away = point - x
    doubt = slack * (wp.abs(away[0]) + wp.abs(away[1]) + wp.abs(away[2]))
    above = wp.dot(flat, away)
    return wp.where(above > doubt, 1, wp.where(above < -doubt, -1, 0))


@wp.func
def clearly_aside(trees: Trees, pose: int, place: int, x: wp.vec3, flat: wp.vec3, slack: float):
    """Whether all of a face lies on one side of the plane through x that is normal to `flat`, beyond any rounding."""
    sides = roughly(trees.corners[pose, place, 0], x, flat, slack)
    sides += roughly(trees.corners[pose, place, 1], x, flat, slack)
    sides += roughly(trees.corners[pose, place, 2], x, flat, slack)
    return sides == 3 or sides == -3


@wp.func
def cut(x: wp.vec3, y: wp.vec3, clear: float):
    """How far the edge from x to y is clear, as a point on it."""
    span = y - x
    return x + span * wp.clamp((clear - ROUNDING) / wp.max(wp.length(span), ROUNDING), 0.0, 1.0)


@wp.kernel
def crossed(
    trees: Trees,
    frames: wp.array(dtype=int),
    side_of: wp.array2d(dtype=int),
    vertices: wp.array2d(dtype=wp.vec3),
    distance: wp.array2d(dtype=float),
    looked_at: wp.array2d(dtype=wp.int8),
    faces: wp.array2d(dtype=int),
    own_side_of: wp.array2d(dtype=int),
    own_places: wp.array3d(dtype=float),
    places: wp.array3d(dtype=float),
):
    """Edges of a cloth that pass through faces of a mesh and edges of the mesh through faces of the cloth.

    A thread has one of `frames` and a face of the cloth. `places` (2, frames, edges) become the first and the last
    crossing along an edge, which start at 2 and -1. No vertex is nearer to the mesh than its distance. `side_of` has
    for each face of the mesh the edges k from corner k to k + 1, as 2 e, or 2 e + 1 where the edge has them in the
    other order.
    """
    t, face = wp.tid()
    i, j, k = faces[face, 0], faces[face, 1], faces[face, 2]
    if looked_at[t, i] == wp.int8(0) and looked_at[t, j] == wp.int8(0) and looked_at[t, k] == wp.int8(0):
        return
    x, y, z = vertices[t, i], vertices[t, j], vertices[t, k]
    longest = wp.max(wp.max(wp.length(y - x), wp.length(z - y)), wp.length(x - z))
    nearest = wp.min(wp.min(distance[t, i], distance[t, j]), distance[t, k])
    if nearest > FARTHEST_POINT * longest:
        return
    a, b, c = wp.vec3d(x), wp.vec3d(y), wp.vec3d(z)
    normal = wp.cross(b - a, c - a)
    flat = wp.cross(y - x, z - x)
    slack = SLACK * longest * longest
    # Nothing crosses a corner nearer to its vertex than the mesh is: what is left lies between where corners end.
    dx, dy, dz = distance[t, i], distance[t, j], distance[t, k]
    xy, xz, yz = cut(x, y, dx), cut(x, z, dx), cut(y, z, dy)
    yx, zx, zy = cut(y, x, dy), cut(z, x, dz), cut(z, y, dz)
    lower = wp.min(wp.min(wp.min(xy, xz), wp.min(yz, yx)), wp.min(zx, zy))
    upper = wp.max(wp.max(wp.max(xy, xz), wp.max(yz, yx)), wp.max(zx, zy))
    pose = frames[t]
    stack = numbers()
    count = int(1)
    while count > 0:
        count -= 1
        node = stack[count]
        apart = overlapped(trees, pose, node, lower, upper)
        first = 8 * node + 1
        for child in range(trees.children):
            if apart[child] <= 0.0:
                if first < trees.inner:
                    stack[count] = first + child
                    count += 1
                else:
                    leaf = first + child - trees.inner
                    for place in range(trees.start[leaf], trees.start[leaf + 1]):
                        p, q, r = (
                            corner(trees, pose, place, 0),
                            corner(trees, pose, place, 1),
                            corner(trees, pose, place, 2),
                        )
                        hp, hq, hr = wp.float64(1.0), wp.float64(1.0), wp.float64(1.0)
                        if not clearly_aside(trees, pose, place, x, flat, slack):
                            hp, hq, hr = height(normal, a, p), height(normal, a, q), height(normal, a, r)
                        if not one_side(hp, hq, hr):
                            across = wp.cross(q - p, r - p)
                            ha, hb, hc = height(across, p, a), height(across, p, b), height(across, p, c)
                            if not one_side(ha, hb, hc):
                                other = trees.order[place]
                                u, v, w = trees.faces[other, 0], trees.faces[other, 1], trees.faces[other, 2]
                                if through(a, b, p, q, r, u, v, w):
                                    note(own_places, t, own_side_of[face, 0], ha, hb)
                                if through(b, c, p, q, r, u, v, w):
                                    note(own_places, t, own_side_of[face, 1], hb, hc)
                                if through(c, a, p, q, r, u, v, w):
                                    note(own_places, t, own_side_of[face, 2], hc, ha)
                                if through(p, q, a, b, c, i, j, k):
                                    note(places, t, side_of[other, 0], hp, hq)
                                if through(q, r, a, b, c, i, j, k):
                                    note(places, t, side_of[other, 1], hq, hr)
                                if through(r, p, a, b, c, i, j, k):
                                    note(places, t, side_of[other, 2], hr, hp)


@wp.kernel
def nearest(
    trees: Trees,
    poses: wp.array(dtype=int),
    points: wp.array(dtype=wp.vec3),
    farthest: float,
    faces: wp.array(dtype=int),
    weights: wp.array(dtype=wp.vec3),
):
    """The places on the mesh, each in its pose, closest to points: face and barycentric coordinates; face -1 where none
    is as near."""
    i = wp.tid()
    found = nearest_on(trees, poses[i], points[i], farthest)
    faces[i] = found.face
    weights[i] = wp.vec3(found.u, found.v, 1.0 - found.u - found.v)


@wp.kernel
def normals_at(
    trees: Trees,
    frames: wp.array(dtype=int),
    chosen: wp.array(dtype=int),
    face_start: wp.array(dtype=int),
    faces_around: wp.array(dtype=int),
    normals: wp.array(dtype=wp.vec3),
):
    """Sums of the faces' normals around chosen vertices, by area, as unit vectors; 0 where faces have no area.

    `faces_around` has the faces of vertex i from face_start[i] to face_start[i + 1].
    """
    k = wp.tid()
    t = frames[k]
    total = wp.vec3()
    for place in range(face_start[chosen[k]], face_start[chosen[k] + 1]):
        face = faces_around[place]
        p = face_point(trees, t, face, 0)
        total += wp.cross(face_point(trees, t, face, 1) - p, face_point(trees, t, face, 2) - p)
    normals[k] = wp.normalize(total)
