"""Warp kernels of `surface_contact`; apart from it, because defining them imports Warp."""

# mypy: ignore-errors
# ruff: noqa: UP018, RUF046, PLR0917
# Kernels are written in Warp's own language: its annotations are no Python types; int(0) makes a variable where 0 were
# a constant; both sides of an `and` are computed; arguments go by position.

import warp as wp

from fusion.obstacles.crossing_kernels import corner, through

wp.set_module_options({"enable_backward": False})

# No point of a triangle is farther from its nearest corner than its longest side over the root of 3.
FARTHEST_POINT = wp.constant(0.5774)
# Metres by which distances give way, a few roundings of a coordinate.
ROUNDING = wp.constant(1.0e-6)


@wp.func
def height(normal: wp.vec3d, point: wp.vec3d, a: wp.vec3d):
    return wp.dot(normal, a - point)


@wp.func
def note(
    places: wp.array3d(dtype=float), t: int, edge: int, first: wp.float64, last: wp.float64, turned: bool
):
    """Widen the interval between an edge's crossings, measured from its first vertex, by the one at which heights of
    opposite sign become 0."""
    along = float(first / (first - last))
    if turned:
        along = 1.0 - along
    wp.atomic_min(places, 0, t, edge, along)
    wp.atomic_max(places, 1, t, edge, along)


@wp.func
def one_side(x: wp.float64, y: wp.float64, z: wp.float64):
    zero = wp.float64(0.0)
    return (x > zero and y > zero and z > zero) or (x < zero and y < zero and z < zero)


@wp.func
def cut(x: wp.vec3, y: wp.vec3, clear: float):
    """How far the edge from x to y is clear, as a point on it."""
    span = y - x
    return x + span * wp.clamp((clear - ROUNDING) / wp.max(wp.length(span), ROUNDING), 0.0, 1.0)


@wp.kernel
def crossed(
    meshes: wp.array(dtype=wp.uint64),
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
    # Nothing crosses a corner nearer to its vertex than the mesh is: what is left lies between where corners end.
    dx, dy, dz = distance[t, i], distance[t, j], distance[t, k]
    xy, xz, yz = cut(x, y, dx), cut(x, z, dx), cut(y, z, dy)
    yx, zx, zy = cut(y, x, dy), cut(z, x, dz), cut(z, y, dz)
    lower = wp.min(wp.min(wp.min(xy, xz), wp.min(yz, yx)), wp.min(zx, zy))
    upper = wp.max(wp.max(wp.max(xy, xz), wp.max(yz, yx)), wp.max(zx, zy))
    mesh = meshes[frames[t]]
    query = wp.mesh_query_aabb(mesh, lower, upper)
    other = int(0)
    while wp.mesh_query_aabb_next(query, other):
        p, q, r = corner(mesh, 3 * other), corner(mesh, 3 * other + 1), corner(mesh, 3 * other + 2)
        hp, hq, hr = height(normal, a, p), height(normal, a, q), height(normal, a, r)
        if not one_side(hp, hq, hr):
            across = wp.cross(q - p, r - p)
            ha, hb, hc = height(across, p, a), height(across, p, b), height(across, p, c)
            if not one_side(ha, hb, hc):
                u = wp.mesh_get_index(mesh, 3 * other)
                v = wp.mesh_get_index(mesh, 3 * other + 1)
                w = wp.mesh_get_index(mesh, 3 * other + 2)
                if through(a, b, p, q, r, u, v, w):
                    note(own_places, t, own_side_of[face, 0] / 2, ha, hb, own_side_of[face, 0] % 2 == 1)
                if through(b, c, p, q, r, u, v, w):
                    note(own_places, t, own_side_of[face, 1] / 2, hb, hc, own_side_of[face, 1] % 2 == 1)
                if through(c, a, p, q, r, u, v, w):
                    note(own_places, t, own_side_of[face, 2] / 2, hc, ha, own_side_of[face, 2] % 2 == 1)
                if through(p, q, a, b, c, i, j, k):
                    note(places, t, side_of[other, 0] / 2, hp, hq, side_of[other, 0] % 2 == 1)
                if through(q, r, a, b, c, i, j, k):
                    note(places, t, side_of[other, 1] / 2, hq, hr, side_of[other, 1] % 2 == 1)
                if through(r, p, a, b, c, i, j, k):
                    note(places, t, side_of[other, 2] / 2, hr, hp, side_of[other, 2] % 2 == 1)


@wp.kernel
def nearest(
    meshes: wp.array(dtype=wp.uint64),
    chosen: wp.array(dtype=int),
    points: wp.array(dtype=wp.vec3),
    farthest: float,
    faces: wp.array(dtype=int),
    weights: wp.array(dtype=wp.vec3),
):
    """The places on the first mesh closest to the chosen points: face and barycentric coordinates; face -1 where none
    is as near."""
    i = chosen[wp.tid()]
    query = wp.mesh_query_point_no_sign(meshes[0], points[i], farthest)
    faces[i] = -1
    if query.result:
        faces[i] = query.face
        weights[i] = wp.vec3(query.u, query.v, 1.0 - query.u - query.v)


@wp.kernel
def normals_at(
    meshes: wp.array(dtype=wp.uint64),
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
    mesh = meshes[frames[k]]
    total = wp.vec3()
    for place in range(face_start[chosen[k]], face_start[chosen[k] + 1]):
        face = faces_around[place]
        p = wp.mesh_get_point(mesh, 3 * face)
        total += wp.cross(
            wp.mesh_get_point(mesh, 3 * face + 1) - p, wp.mesh_get_point(mesh, 3 * face + 2) - p
        )
    normals[k] = wp.normalize(total)
