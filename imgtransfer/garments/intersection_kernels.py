"""Warp kernels of `imgtransfer.garments.checks`; apart from it, because defining them imports Warp."""

# mypy: ignore-errors
# ruff: noqa: UP018, RUF046, SIM102
# Kernels are written in Warp's own language: its annotations are no Python types, `int(0)` is a variable rather than a
# constant, and "and" evaluates both sides.

import warp as wp

wp.set_module_options({"enable_backward": False})

# Metres by which a face's box is widened, a few roundings of the tree's float32 coordinates.
WIDER = wp.constant(1.0e-6)


@wp.func
def corner(points: wp.array(dtype=wp.vec3d), faces: wp.array2d(dtype=wp.int32), face: int, number: int):
    return points[faces[face, number % 3]]


@wp.func
def crosses(a: wp.vec3d, b: wp.vec3d, p: wp.vec3d, q: wp.vec3d, r: wp.vec3d):
    """Whether the segment a b passes through the triangle p q r (signs of the volumes of five tetrahedra)."""
    first = wp.dot(wp.cross(q - p, r - p), a - p)
    last = wp.dot(wp.cross(q - p, r - p), b - p)
    s = wp.dot(wp.cross(p - a, q - a), b - a)
    t = wp.dot(wp.cross(q - a, r - a), b - a)
    u = wp.dot(wp.cross(r - a, p - a), b - a)
    zero = wp.float64(0.0)
    return first * last < zero and (
        (s > zero and t > zero and u > zero) or (s < zero and t < zero and u < zero)
    )


@wp.func
def meet(points: wp.array(dtype=wp.vec3d), faces: wp.array2d(dtype=wp.int32), one: int, other: int):
    """Whether two faces intersect elsewhere than in corners or an edge that they share."""
    shared = int(0)
    mine = int(0)
    theirs = int(0)
    for i in range(3):
        for j in range(3):
            if faces[one, i] == faces[other, j]:
                shared += 1
                mine = i
                theirs = j
    p = corner(points, faces, one, mine)
    q = corner(points, faces, one, mine + 1)
    r = corner(points, faces, one, mine + 2)
    a = corner(points, faces, other, theirs)
    b = corner(points, faces, other, theirs + 1)
    c = corner(points, faces, other, theirs + 2)
    intersect = bool(False)
    if shared < 2:
        # Of two triangles that meet, a side of one passes through the other. (`wp.intersect_tri_tri` of Warp 1.19 also
        # reports nearly coplanar triangles that lie apart.) With a shared corner only the sides opposite it can.
        intersect = crosses(q, r, a, b, c) or crosses(b, c, p, q, r)
    if shared == 0 and not intersect:
        intersect = (
            crosses(p, q, a, b, c)
            or crosses(r, p, a, b, c)
            or crosses(a, b, p, q, r)
            or crosses(c, a, p, q, r)
        )
    return intersect


@wp.kernel
def intersecting_faces(
    mesh: wp.uint64,
    points: wp.array(dtype=wp.vec3d),
    faces: wp.array2d(dtype=wp.int32),
    partner: wp.array(dtype=wp.int32),
):
    """For every face the smallest face that it intersects, -1 where there is none."""
    face = wp.tid()
    p = wp.vec3(corner(points, faces, face, 0))
    q = wp.vec3(corner(points, faces, face, 1))
    r = wp.vec3(corner(points, faces, face, 2))
    wide = wp.vec3(WIDER, WIDER, WIDER)
    query = wp.mesh_query_aabb(mesh, wp.min(p, wp.min(q, r)) - wide, wp.max(p, wp.max(q, r)) + wide)
    first = int(-1)
    other = int(0)
    while wp.mesh_query_aabb_next(query, other):
        if other != face and (first < 0 or other < first):
            if meet(points, faces, face, other):
                first = other
    partner[face] = first
