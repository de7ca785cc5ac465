"""Warp kernels of `edge_limits`; apart from it, because defining them imports Warp."""

# mypy: ignore-errors
# Kernels are written in Warp's own language: its annotations are no Python types; arguments go by position.

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def pull_ends(
    points: wp.array(dtype=wp.vec3),
    ends: wp.array2d(dtype=int),
    longest: wp.array(dtype=float),
    pulls: wp.array(dtype=wp.vec4),
):
    """Add to both ends of each edge that is too long half of what it is too long by, and 1."""
    edge = wp.tid()
    first, second = ends[edge, 0], ends[edge, 1]
    span = points[second] - points[first]
    length = wp.length(span)
    if length > longest[edge]:
        pull = span * (0.5 * (1.0 - longest[edge] / length))
        wp.atomic_add(pulls, first, wp.vec4(pull[0], pull[1], pull[2], 1.0))
        wp.atomic_add(pulls, second, wp.vec4(-pull[0], -pull[1], -pull[2], 1.0))


@wp.kernel
def move_points(
    over: float,
    loose: wp.array(dtype=wp.int8),
    walls: wp.array(dtype=wp.vec3),
    points: wp.array(dtype=wp.vec3),
    pulls: wp.array(dtype=wp.vec4),
):
    """Move loose points by `over` times the mean of their pulls, but not against their walls; no pulls are left."""
    i = wp.tid()
    pull = pulls[i]
    if pull[3] > 0.0:
        pulls[i] = wp.vec4(0.0, 0.0, 0.0, 0.0)
        if loose[i] != wp.int8(0):
            step = wp.vec3(pull[0], pull[1], pull[2]) * (over / pull[3])
            points[i] = points[i] + (step - walls[i] * wp.min(wp.dot(step, walls[i]), 0.0))
