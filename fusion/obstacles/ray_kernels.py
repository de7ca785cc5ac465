"""Rays through a closed mesh that may overlap itself: winding numbers by counting, and exits. Warp functions."""

# mypy: ignore-errors
# ruff: noqa: UP018, RUF046
# Written in Warp's own language: its annotations are no Python types; int(0) makes a variable where 0 were a constant.

import warp as wp

# Metres; beyond any scene.
FARTHEST = wp.constant(1.0e6)
# Metres by which a ray goes on behind a surface that it hit, a few roundings of a coordinate.
STEP = wp.constant(1.0e-5)
# Surfaces that one ray may cross.
CROSSINGS = wp.constant(64)
# Directions in which an exit is looked for, and steps that turn the best one towards the surface's normal.
DIRECTIONS = wp.constant(24)
TURNS = wp.constant(3)
GOLDEN_ANGLE = wp.constant(2.3999632)


@wp.func
def crossings(mesh: wp.uint64, start: wp.vec3, direction: wp.vec3):
    """Winding number of `start` in a closed mesh: surfaces left minus surfaces entered on the direction to infinity."""
    total = int(0)
    passed = int(0)
    at = start
    going = bool(True)
    while going:
        hit = wp.mesh_query_ray(mesh, at, direction, FARTHEST)
        going = hit.result and passed < CROSSINGS
        if hit.result:
            total += wp.where(hit.sign > 0.0, -1, 1)
            at = at + direction * (hit.t + STEP)
            passed += 1
    return total


@wp.func
def exit_along(mesh: wp.uint64, start: wp.vec3, direction: wp.vec3, depth: int):
    """Metres to where the winding number, `depth` at the start, gets 0 (FARTHEST: nowhere), with the normal there."""
    left = depth
    passed = int(0)
    gone = float(0.0)
    exit = wp.vec4(0.0, 0.0, 0.0, FARTHEST)
    going = bool(True)
    while going:
        hit = wp.mesh_query_ray(mesh, start + direction * gone, direction, FARTHEST)
        going = hit.result and passed < CROSSINGS
        if hit.result:
            left += wp.where(hit.sign > 0.0, 1, -1)
            if left == 0:
                exit = wp.vec4(hit.normal[0], hit.normal[1], hit.normal[2], gone + hit.t)
                going = False
            gone += hit.t + STEP
            passed += 1
    return exit


@wp.func
def nearest_exit(mesh: wp.uint64, start: wp.vec3, depth: int):
    """Unit vector and metres to about the nearest point of the outer surface; FARTHEST metres: none exit."""
    best = wp.vec4(0.0, 0.0, 0.0, FARTHEST)
    normal = wp.vec3(0.0, 0.0, 0.0)
    for k in range(DIRECTIONS):  # spread evenly over the sphere
        up = 1.0 - (2.0 * float(k) + 1.0) / float(DIRECTIONS)
        around = wp.sqrt(1.0 - up * up)
        angle = GOLDEN_ANGLE * float(k)
        direction = wp.vec3(around * wp.cos(angle), up, around * wp.sin(angle))
        exit = exit_along(mesh, start, direction, depth)
        if exit[3] < best[3]:
            best = wp.vec4(direction[0], direction[1], direction[2], exit[3])
            normal = wp.vec3(exit[0], exit[1], exit[2])
    for _turn in range(TURNS):
        if wp.length(normal) > 0.5:
            exit = exit_along(mesh, start, normal, depth)
            if exit[3] < best[3]:
                best = wp.vec4(normal[0], normal[1], normal[2], exit[3])
                normal = wp.vec3(exit[0], exit[1], exit[2])
    return best
