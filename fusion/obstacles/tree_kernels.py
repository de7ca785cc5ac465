"""Warp functions and kernels on `fusion.obstacles.box_trees`; apart from it, because defining them imports Warp.

A node of a tree has eight boxes, the bounds of its children, side by side as vectors, so that one pass through the
vector units looks at all of them.
"""

# mypy: ignore-errors
# ruff: noqa: UP018, RUF046, PLR0911, PLR0912
# Kernels are written in Warp's own language: its annotations are no Python types; int(0) makes a variable where 0 were
# a constant; both sides of an `and` are computed; arguments go by position.

import warp as wp

wp.set_module_options({"enable_backward": False})

lane = wp.types.vector(8, wp.float32)
# Nodes still to be looked at: seven a level and one more, so that nine levels, 2 · 8⁹ faces, have room.
numbers = wp.types.vector(64, wp.int32)
squares = wp.types.vector(64, wp.float32)
# Metres that say that nothing is there.
NOWHERE = wp.constant(1.0e30)
# A face whose normal is shorter than this part of the sum of its squared sides has no area to speak of.
SLIVER = wp.constant(1.0e-6)
# Relative slack of a ray against a box, a few roundings.
SLACK = wp.constant(1.000001)


@wp.struct
class Trees:
    """Trees of one mesh, T poses: nodes are numbered as in a heap, children of k are 8 k + 1 to 8 k + 8; those from
    `inner` on are leaves, of which number l, counted from there, has faces start[l] to start[l + 1] of `order`."""

    inner: int
    children: int  # 8, told at run time: loops over a constant are unrolled, which takes long to compile
    boxes: wp.array3d(dtype=lane)  # (T, inner, 6): least x, y, z and greatest x, y, z
    start: wp.array(dtype=int)
    order: wp.array(dtype=int)
    faces: wp.array2d(dtype=int)
    points: wp.array2d(dtype=wp.vec3)  # (T, B)
    corners: wp.array3d(dtype=wp.vec3)  # (T, G, 3), faces in `order`: side by side they are read faster


@wp.struct
class Nearest:
    """A place on a mesh: face (-1: there is none), where in it as weights of its first two corners, and where."""

    face: int
    u: float
    v: float
    at: wp.vec3


@wp.func
def face_point(trees: Trees, t: int, face: int, corner: int):
    return trees.points[t, trees.faces[face, corner]]


@wp.func
def face_normal(trees: Trees, t: int, face: int):
    p = face_point(trees, t, face, 0)
    return wp.normalize(wp.cross(face_point(trees, t, face, 1) - p, face_point(trees, t, face, 2) - p))


@wp.kernel
def fit_leaves(trees: Trees, first: int):
    """Boxes of the leaves, by the nodes above them, of which the first has this number."""
    t, k = wp.tid()
    node = first + k
    for child in range(8):
        leaf = 8 * node + 1 + child - trees.inner
        lower = wp.vec3(NOWHERE, NOWHERE, NOWHERE)
        upper = -lower
        for place in range(trees.start[leaf], trees.start[leaf + 1]):
            face = trees.order[place]
            for corner in range(3):
                point = face_point(trees, t, face, corner)
                trees.corners[t, place, corner] = point
                lower = wp.min(lower, point)
                upper = wp.max(upper, point)
        for axis in range(3):
            trees.boxes[t, node, axis][child] = lower[axis]
            trees.boxes[t, node, 3 + axis][child] = upper[axis]


@wp.kernel
def fit_nodes(trees: Trees, first: int):
    """Boxes of the nodes' children, once these have theirs."""
    t, k = wp.tid()
    node = first + k
    for axis in range(3):
        lower, upper = lane(), lane()
        for child in range(8):
            lower[child] = wp.min(trees.boxes[t, 8 * node + 1 + child, axis])
            upper[child] = wp.max(trees.boxes[t, 8 * node + 1 + child, 3 + axis])
        trees.boxes[t, node, axis] = lower
        trees.boxes[t, node, 3 + axis] = upper


@wp.func
def outside_axis(trees: Trees, t: int, node: int, axis: int, x: float):
    """How far a coordinate is outside of the children's boxes."""
    at = lane(x)
    away = wp.max(trees.boxes[t, node, axis] - at, at - trees.boxes[t, node, 3 + axis])
    return wp.max(away, lane())


@wp.func
def box_squares(trees: Trees, t: int, node: int, point: wp.vec3):
    """Squared distances of a point from the children's boxes."""
    x = outside_axis(trees, t, node, 0, point[0])
    y = outside_axis(trees, t, node, 1, point[1])
    z = outside_axis(trees, t, node, 2, point[2])
    return wp.cw_mul(x, x) + wp.cw_mul(y, y) + wp.cw_mul(z, z)


@wp.func
def on_triangle(p: wp.vec3, q: wp.vec3, r: wp.vec3, point: wp.vec3):
    """Weights of p and q in the point of a triangle that is closest to a point (Ericson, Real-Time Collision
    Detection, 5.1.5)."""
    pq = q - p
    pr = r - p
    away = point - p
    d1 = wp.dot(pq, away)
    d2 = wp.dot(pr, away)
    if d1 <= 0.0 and d2 <= 0.0:
        return wp.vec2(1.0, 0.0)
    away = point - q
    d3 = wp.dot(pq, away)
    d4 = wp.dot(pr, away)
    if d3 >= 0.0 and d4 <= d3:
        return wp.vec2(0.0, 1.0)
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        v = d1 / (d1 - d3)
        return wp.vec2(1.0 - v, v)
    away = point - r
    d5 = wp.dot(pq, away)
    d6 = wp.dot(pr, away)
    if d6 >= 0.0 and d5 <= d6:
        return wp.vec2(0.0, 0.0)
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        return wp.vec2(1.0 - d2 / (d2 - d6), 0.0)
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 >= d3 and d5 >= d6:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return wp.vec2(0.0, 1.0 - w)
    scale = 1.0 / (va + vb + vc)
    v = vb * scale
    w = vc * scale
    return wp.vec2(1.0 - v - w, v)


@wp.func
def nearest_on(trees: Trees, t: int, point: wp.vec3, farthest: float):
    """The place of pose t nearest to a point, if it is nearer than `farthest`; of places as near, the first face's."""
    found = Nearest()
    found.face = -1
    best = farthest * farthest
    stack = numbers()
    away = squares()
    count = int(1)
    while count > 0:
        count -= 1
        if away[count] <= best:
            node = stack[count]
            square = box_squares(trees, t, node, point)
            least = int(0)
            low = square[0]
            for k in range(1, 8):
                if square[k] < low:
                    low = square[k]
                    least = k
            first = 8 * node + 1
            if first < trees.inner:
                # The nearest one last, which is looked at first.
                for k in range(1, trees.children + 1):
                    child = (least + k) % 8
                    if square[child] <= best:
                        stack[count] = first + child
                        away[count] = square[child]
                        count += 1
            else:
                for k in range(trees.children):
                    child = (least + k) % 8
                    if square[child] <= best:
                        leaf = first + child - trees.inner
                        for place in range(trees.start[leaf], trees.start[leaf + 1]):
                            p = trees.corners[t, place, 0]
                            q = trees.corners[t, place, 1]
                            r = trees.corners[t, place, 2]
                            sides = wp.length_sq(q - p) + wp.length_sq(r - p) + wp.length_sq(r - q)
                            if (
                                wp.length_sq(wp.cross(q - p, r - p)) >= SLIVER * SLIVER * sides * sides
                                and sides > 0.0
                            ):
                                weights = on_triangle(p, q, r, point)
                                at = p * weights[0] + q * weights[1] + r * (1.0 - weights[0] - weights[1])
                                here = wp.length_sq(at - point)
                                face = trees.order[place]
                                if here < best or (here == best and (found.face < 0 or face < found.face)):
                                    best = here
                                    found.face = face
                                    found.u = weights[0]
                                    found.v = weights[1]
                                    found.at = at
    return found


@wp.func
def reached(trees: Trees, t: int, node: int, start: wp.vec3, inverse: wp.vec3):
    """1 for those of the children's boxes that a ray meets, with 1 / its direction; else 0."""
    enter = lane()
    leave = lane(NOWHERE)
    for axis in range(3):
        one = (trees.boxes[t, node, axis] - lane(start[axis])) * inverse[axis]
        other = (trees.boxes[t, node, 3 + axis] - lane(start[axis])) * inverse[axis]
        enter = wp.max(enter, wp.min(one, other))
        leave = wp.min(leave, wp.max(one, other))
    leave = leave * SLACK
    met = lane()
    for k in range(8):
        met[k] = wp.where(enter[k] <= leave[k], 1.0, 0.0)
    return met


@wp.func
def left_of(a: wp.vec3d, direction: wp.vec3d, p: wp.vec3d, q: wp.vec3d):
    """On which side of a line the side p q of a face lies: a number that is not 0. If it meets the line, the side that
    it is on once the line has been moved a hair, all lines and sides alike."""
    side = wp.dot(wp.cross(p - a, q - a), direction)
    if side == wp.float64(0.0):
        side = -wp.dot(
            wp.vec3d(wp.float64(0.61), wp.float64(0.37), wp.float64(0.71)), wp.cross(q - p, direction)
        )
    return side


@wp.func
def is_left_of(a: wp.vec3d, direction: wp.vec3d, p: wp.vec3d, q: wp.vec3d, turned: bool):
    """`left_of` as a yes or no. Both faces of a side compute it from the same end, so that it lies on different sides
    as they see it, whatever the rounding: `turned` says that q is that end."""
    left = left_of(a, direction, p, q) > wp.float64(0.0)
    if turned:
        left = not (left_of(a, direction, q, p) > wp.float64(0.0))
    return left


@wp.func
def winding_along(trees: Trees, t: int, start: wp.vec3, direction: wp.vec3):
    """Winding number of `start` in a closed mesh, pose t: surfaces left minus surfaces entered on a way to infinity."""
    inverse = wp.vec3()
    for axis in range(3):
        x = direction[axis]
        if wp.abs(x) < 1.0e-12:
            x = wp.where(x < 0.0, -1.0e-12, 1.0e-12)
        inverse[axis] = 1.0 / x
    a = wp.vec3d(start)
    ray = wp.vec3d(direction)
    zero = wp.float64(0.0)
    total = int(0)
    stack = numbers()
    count = int(1)
    while count > 0:
        count -= 1
        node = stack[count]
        met = reached(trees, t, node, start, inverse)
        first = 8 * node + 1
        for child in range(trees.children):
            if met[child] > 0.5:
                if first < trees.inner:
                    stack[count] = first + child
                    count += 1
                else:
                    leaf = first + child - trees.inner
                    for place in range(trees.start[leaf], trees.start[leaf + 1]):
                        p = wp.vec3d(trees.corners[t, place, 0])
                        q = wp.vec3d(trees.corners[t, place, 1])
                        r = wp.vec3d(trees.corners[t, place, 2])
                        normal = wp.cross(q - p, r - p)
                        ahead = wp.dot(normal, p - a)
                        along = wp.dot(normal, ray)
                        if (ahead > zero and along > zero) or (ahead < zero and along < zero):
                            face = trees.order[place]
                            i, j, k = trees.faces[face, 0], trees.faces[face, 1], trees.faces[face, 2]
                            left = is_left_of(a, ray, p, q, i > j)
                            if (
                                is_left_of(a, ray, q, r, j > k) == left
                                and is_left_of(a, ray, r, p, k > i) == left
                            ):
                                total += wp.where(along > zero, 1, -1)
    return total


@wp.func
def overlapped(trees: Trees, t: int, node: int, lower: wp.vec3, upper: wp.vec3):
    """At most 0 for those of the children's boxes that have a point in common with a box."""
    apart = lane(-NOWHERE)
    for axis in range(3):
        apart = wp.max(apart, trees.boxes[t, node, axis] - lane(upper[axis]))
        apart = wp.max(apart, lane(lower[axis]) - trees.boxes[t, node, 3 + axis])
    return apart
