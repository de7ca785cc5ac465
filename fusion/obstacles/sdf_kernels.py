"""Warp kernels of `sdf` and `layers`; apart from them, because defining them imports Warp."""

# mypy: ignore-errors
# ruff: noqa: UP018, RUF046, SIM102, PLR0917
# Kernels are written in Warp's own language: its annotations are no Python types; bool(False) and int(0) make variables
# where False and 0 were constants; both sides of an `and` are computed; arguments go by position.

import warp as wp

from fusion.obstacles.ray_kernels import FARTHEST, crossings, nearest_exit
from fusion.obstacles.tree_kernels import Trees, face_normal, nearest_on, winding_along

wp.set_module_options({"enable_backward": False})

# Metres; nearer than this the offset from the surface is rounding, and the face's normal gives the direction.
TOUCHING = wp.constant(1.0e-6)
# Metres from the surface at which the ray of a point on it starts, clear of that surface itself.
OUTSIDE = wp.constant(1.0e-4)


@wp.func
def store(i: int, distance: float, direction: wp.vec3, closest: wp.vec3, packed: wp.array2d(dtype=float)):
    packed[i, 0] = distance
    for axis in range(3):
        packed[i, 1 + axis] = direction[axis]
        packed[i, 4 + axis] = closest[axis]


@wp.func
def away_from(normal: wp.vec3, closest: wp.vec3, point: wp.vec3, side: float):
    """Unit vector from the closest point to the point, turned outwards; the face's normal where they coincide."""
    offset = point - closest
    length = wp.length(offset)
    direction = normal
    if length > TOUCHING:
        direction = offset * (side / length)
    return direction


@wp.func
def store_signed(
    normal: wp.vec3,
    closest: wp.vec3,
    point: wp.vec3,
    side: float,
    band: float,
    i: int,
    packed: wp.array2d(dtype=float),
):
    """Write what is nearer than `band` or inside; otherwise the band, without a direction."""
    distance = side * wp.length(point - closest)
    if distance < band:
        store(i, distance, away_from(normal, closest, point, side), closest, packed)
    else:
        store(i, band, wp.vec3(0.0, 0.0, 0.0), point, packed)


@wp.func
def store_query(
    query: wp.MeshQueryPoint,
    mesh: wp.uint64,
    point: wp.vec3,
    band: float,
    i: int,
    packed: wp.array2d(dtype=float),
):
    """Write the result of a query that tells sides."""
    if query.result:
        closest = wp.mesh_eval_position(mesh, query.face, query.u, query.v)
        side = wp.where(query.sign < 0.0, -1.0, 1.0)
        store_signed(wp.mesh_eval_face_normal(mesh, query.face), closest, point, side, band, i, packed)
    else:
        store(i, band, wp.vec3(0.0, 0.0, 0.0), point, packed)


@wp.kernel
def checked(
    trees: Trees,
    poses: wp.array(dtype=int),
    points: wp.array(dtype=wp.vec3),
    band: float,
    outside: wp.array(dtype=wp.int8),
    packed: wp.array2d(dtype=float),
    doubt: wp.array(dtype=int),
):
    """Distance, direction and closest point (7 columns) of a closed mesh, and where they are in doubt.

    The side is that of the closest face, which is certain if the winding number, counted along a ray, is 0 in front
    of it or 1 behind it: the closest point is then on the outer surface of the whole. It is not where parts overlap,
    or at a sharp edge, where one of the two faces may tell the wrong side. `doubt` is 0 where it is certain, and
    otherwise the winding number, or -1 for 0. Nothing is counted for points that are known to be outside (1).
    """
    i = wp.tid()
    t = poses[i]
    point = points[i]
    doubt[i] = 0
    found = nearest_on(trees, t, point, band)
    known = outside[i] != wp.int8(0)
    if found.face < 0 and not known:
        # Beyond the band outside or deep inside? Any direction will do.
        if winding_along(trees, t, point, wp.normalize(wp.vec3(0.31, 0.17, 0.94))) != 0:
            found = nearest_on(trees, t, point, FARTHEST)
    if found.face >= 0:
        closest = found.at
        normal = face_normal(trees, t, found.face)
        offset = point - closest
        side = wp.where(wp.dot(offset, normal) < 0.0, -1.0, 1.0)
        # On along the line from the closest point: never through it, nor along the faces that meet there.
        outward = side * away_from(normal, closest, point, side)
        start = point
        if wp.length(offset) <= TOUCHING:
            start = closest + outward * OUTSIDE
        around = int(0)
        if not known:
            around = winding_along(trees, t, start, outward)
        if around != wp.where(side < 0.0, 1, 0):
            doubt[i] = wp.where(around == 0, -1, around)
        store_signed(normal, closest, point, side, band, i, packed)
    else:
        store(i, band, wp.vec3(0.0, 0.0, 0.0), point, packed)


@wp.func
def settle(
    mesh: wp.uint64, point: wp.vec3, counted: int, band: float, i: int, packed: wp.array2d(dtype=float)
):
    """Write the answer for a point of a known winding number: outside at 0 and below; inside, the exit to the outer
    surface where the nearest surface is not that."""
    query = wp.mesh_query_point_sign_normal(mesh, point, FARTHEST)
    if query.result:
        closest = wp.mesh_eval_position(mesh, query.face, query.u, query.v)
        side = wp.where(counted > 0, -1.0, 1.0)
        store_signed(wp.mesh_eval_face_normal(mesh, query.face), closest, point, side, band, i, packed)
        if counted > 0 and (query.sign > 0.0 or counted > 1):  # not just behind a sharp edge
            best = nearest_exit(mesh, point, counted)
            if best[3] < FARTHEST:
                outward = wp.vec3(best[0], best[1], best[2])
                store(i, -best[3], outward, point + outward * best[3], packed)
    else:
        store(i, band, wp.vec3(0.0, 0.0, 0.0), point, packed)


@wp.kernel
def confirmed(
    meshes: wp.array(dtype=wp.uint64),
    poses: wp.array(dtype=int),
    points: wp.array(dtype=wp.vec3),
    band: float,
    doubtful: wp.array(dtype=int),
    doubt: wp.array(dtype=int),
    packed: wp.array2d(dtype=float),
):
    """For points in doubt: where rays in two other directions count what the first one did, that is the winding number,
    and there is no doubt left (0)."""
    i = doubtful[wp.tid()]
    mesh = meshes[poses[i]]
    point = points[i]
    counted = wp.max(doubt[i], 0)
    second = crossings(mesh, point, wp.normalize(wp.vec3(0.31, 0.17, 0.94)))
    third = crossings(mesh, point, wp.normalize(wp.vec3(-0.53, 0.81, -0.26)))
    touching = wp.mesh_query_point_no_sign(mesh, point, TOUCHING)
    if wp.max(second, 0) == counted and wp.max(third, 0) == counted and not touching.result:
        settle(mesh, point, counted, band, i, packed)
        doubt[i] = 0


@wp.kernel
def settled(
    meshes: wp.array(dtype=wp.uint64),
    poses: wp.array(dtype=int),
    points: wp.array(dtype=wp.vec3),
    band: float,
    doubtful: wp.array(dtype=int),
    doubt: wp.array(dtype=int),
    packed: wp.array2d(dtype=float),
):
    """For points that are still in doubt: the sign from the generalised winding number."""
    i = doubtful[wp.tid()]
    mesh = meshes[poses[i]]
    query = wp.mesh_query_point_sign_winding_number(mesh, points[i], FARTHEST)
    inside = query.result and query.sign < 0.0
    settle(mesh, points[i], wp.where(inside, wp.max(doubt[i], 1), 0), band, i, packed)


@wp.kernel
def winding(
    meshes: wp.array(dtype=wp.uint64),
    poses: wp.array(dtype=int),
    points: wp.array(dtype=wp.vec3),
    band: float,
    packed: wp.array2d(dtype=float),
):
    """Distance, direction and closest point (7 columns), the sign from the generalised winding number."""
    i = wp.tid()
    mesh = meshes[poses[i]]
    query = wp.mesh_query_point_sign_winding_number(mesh, points[i], FARTHEST)
    store_query(query, mesh, points[i], band, i, packed)


@wp.kernel
def normal(
    meshes: wp.array(dtype=wp.uint64),
    poses: wp.array(dtype=int),
    points: wp.array(dtype=wp.vec3),
    band: float,
    packed: wp.array2d(dtype=float),
):
    """As `winding`, the sign from the angle-weighted pseudo-normal at the closest point."""
    i = wp.tid()
    mesh = meshes[poses[i]]
    query = wp.mesh_query_point_sign_normal(mesh, points[i], FARTHEST)
    store_query(query, mesh, points[i], band, i, packed)


@wp.kernel
def surface(
    meshes: wp.array(dtype=wp.uint64),
    poses: wp.array(dtype=int),
    points: wp.array(dtype=wp.vec3),
    band: float,
    depth: float,
    offset: float,
    rims: wp.array2d(dtype=wp.int8),
    packed: wp.array2d(dtype=float),
):
    """Distance to the outer side of an open surface raised by `offset`; no obstacle past its rim or below `depth`.

    `rims` (G, 3): 1 where the corner lies on the rim, + 2 where the edge opposite it does.
    """
    i = wp.tid()
    mesh = meshes[poses[i]]
    point = points[i]
    query = wp.mesh_query_point_sign_normal(mesh, point, wp.max(band + offset, depth))
    distance = band
    direction = wp.vec3(0.0, 0.0, 0.0)
    closest = point
    if query.result:
        corners = wp.vec3(query.u, query.v, 1.0 - query.u - query.v)
        past = bool(False)
        for k in range(3):
            rim = int(rims[query.face, k])
            past = past or (rim % 2 == 1 and corners[k] > 1.0 - 1.0e-4) or (rim > 1 and corners[k] < 1.0e-4)
        at = wp.mesh_eval_position(mesh, query.face, query.u, query.v)
        side = wp.where(query.sign < 0.0, -1.0, 1.0)
        height = side * wp.length(point - at)
        if not past and height - offset < band and height > -depth:
            distance = height - offset
            closest = at
            direction = away_from(wp.mesh_eval_face_normal(mesh, query.face), at, point, side)
    store(i, distance, direction, closest, packed)
