"""Warp kernels of `fusion.sdf`; apart from it, because defining them imports Warp."""

# mypy: ignore-errors
# Kernels are written in Warp's own language: its annotations are no Python types.

import warp as wp

# Beyond any scene: queries are never cut off by distance.
FARTHEST = wp.constant(1.0e6)
# Metres; nearer than this the offset from the surface is rounding, and the face's normal gives the direction.
TOUCHING = wp.constant(1.0e-6)


@wp.func
def _store(
    query: wp.MeshQueryPoint, mesh: wp.uint64, point: wp.vec3, i: int, packed: wp.array2d(dtype=float)
):
    if query.result:
        closest = wp.mesh_eval_position(mesh, query.face, query.u, query.v)
        offset = point - closest
        length = wp.length(offset)
        side = wp.where(query.sign < 0.0, -1.0, 1.0)
        direction = wp.mesh_eval_face_normal(mesh, query.face)
        if length > TOUCHING:
            direction = offset * (side / length)
        packed[i, 0] = side * length
        for axis in range(3):
            packed[i, 1 + axis] = direction[axis]
            packed[i, 4 + axis] = closest[axis]
    else:
        for column in range(7):
            packed[i, column] = wp.nan


@wp.kernel(enable_backward=False)
def winding(
    meshes: wp.array(dtype=wp.uint64),
    per_body: int,
    points: wp.array(dtype=wp.vec3),
    packed: wp.array2d(dtype=float),
):
    """Distance, direction and closest point (7 columns), the sign from the generalised winding number."""
    i = wp.tid()
    mesh = meshes[i // per_body]
    query = wp.mesh_query_point_sign_winding_number(mesh, points[i], FARTHEST)
    _store(query, mesh, points[i], i, packed)


@wp.kernel(enable_backward=False)
def normal(
    meshes: wp.array(dtype=wp.uint64),
    per_body: int,
    points: wp.array(dtype=wp.vec3),
    packed: wp.array2d(dtype=float),
):
    """As `winding`, the sign from the angle-weighted pseudo-normal at the closest point."""
    i = wp.tid()
    mesh = meshes[i // per_body]
    query = wp.mesh_query_point_sign_normal(mesh, points[i], FARTHEST)
    _store(query, mesh, points[i], i, packed)
