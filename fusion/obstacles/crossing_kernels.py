"""Warp kernels of `crossings`; apart from it, because defining them imports Warp."""

# mypy: ignore-errors
# ruff: noqa: UP018, RUF046, SIM102, PLR0917
# Kernels are written in Warp's own language: its annotations are no Python types; int(0) makes a variable where 0 were
# a constant; both sides of an `and` are computed; arguments go by position.

import warp as wp

from fusion.obstacles.tree_kernels import Trees, numbers, overlapped

wp.set_module_options({"enable_backward": False})


@wp.func
def corner(trees: Trees, t: int, place: int, number: int):
    """A corner of the face at a place of the order, in float64, in which differences of float32 numbers and their
    products are all but exact."""
    return wp.vec3d(trees.corners[t, place, number])


@wp.func
def around_side(a: wp.vec3d, b: wp.vec3d, p: wp.vec3d, q: wp.vec3d, turned: bool):
    """Six times the volume of a, b and the side p q of a face.

    Both faces of a side compute it from the same end, so that they get the same rounding with opposite signs, and no
    edge slips between them: `turned` says that q is that end.
    """
    volume = wp.dot(wp.cross(p - a, q - a), b - a)
    if turned:
        volume = -wp.dot(wp.cross(q - a, p - a), b - a)
    return volume


@wp.func
def through(a: wp.vec3d, b: wp.vec3d, p: wp.vec3d, q: wp.vec3d, r: wp.vec3d, i: int, j: int, k: int):
    """Whether the edge a b passes through the face p q r, whose corners are vertices i, j and k."""
    zero = wp.float64(0.0)
    normal = wp.cross(q - p, r - p)
    first = wp.dot(normal, a - p)
    last = wp.dot(normal, b - p)
    inside = bool(False)
    if (first < zero and last > zero) or (first > zero and last < zero):
        s = around_side(a, b, p, q, i > j)
        t = around_side(a, b, q, r, j > k)
        u = around_side(a, b, r, p, k > i)
        inside = (s >= zero and t >= zero and u >= zero) or (s <= zero and t <= zero and u <= zero)
    return inside


@wp.func
def passes(a: wp.vec3d, b: wp.vec3d, trees: Trees, t: int, place: int):
    """Whether the edge a b passes through the face at a place of the order: see `fusion.obstacles.crossings`."""
    face = trees.order[place]
    i, j, k = trees.faces[face, 0], trees.faces[face, 1], trees.faces[face, 2]
    return through(
        a, b, corner(trees, t, place, 0), corner(trees, t, place, 1), corner(trees, t, place, 2), i, j, k
    )


@wp.func
def belongs(trees: Trees, face: int, vertex: int):
    """Whether a vertex is a corner of the face."""
    i, j, k = trees.faces[face, 0], trees.faces[face, 1], trees.faces[face, 2]
    return vertex == i or vertex == j or vertex == k  # noqa: PLR1714 (Warp knows no `in`)


@wp.kernel
def passed_faces(
    trees: Trees,
    poses: wp.array(dtype=int),
    starts: wp.array(dtype=wp.vec3),
    faces: wp.array(dtype=int),
    ends: wp.array2d(dtype=float),
    own: wp.array2d(dtype=int),
    places: wp.array(dtype=int),
    counts: wp.array(dtype=int),
):
    """How many faces each edge passes through; with places (not -1) also which, written to `faces` from there on.

    `own` are the edge's vertices where the mesh is the edge's own, whose faces around them do not count; -1 elsewhere.
    Edges whose count is 0 already are passed over.
    """
    row = wp.tid()
    if counts[row] == 0:
        return
    t = poses[row]
    start = starts[row]
    end = wp.vec3(ends[row, 0], ends[row, 1], ends[row, 2])
    a = wp.vec3d(start)
    b = wp.vec3d(end)
    lower = wp.min(start, end)
    upper = wp.max(start, end)
    passed = int(0)
    stack = numbers()
    count = int(1)
    while count > 0:
        count -= 1
        node = stack[count]
        apart = overlapped(trees, t, node, lower, upper)
        first = 8 * node + 1
        for child in range(trees.children):
            if apart[child] <= 0.0:
                if first < trees.inner:
                    stack[count] = first + child
                    count += 1
                else:
                    leaf = first + child - trees.inner
                    for place in range(trees.start[leaf], trees.start[leaf + 1]):
                        face = trees.order[place]
                        if not (belongs(trees, face, own[row, 0]) or belongs(trees, face, own[row, 1])):
                            if passes(a, b, trees, t, place):
                                if places[row] >= 0:
                                    faces[places[row] + passed] = face
                                passed += 1
    counts[row] = passed
