"""Warp kernels of vertex block descent for cloth: the same energies as Newton's SolverVBD, in closed form.

What depends on the step's start alone (contacts, the metric and hinge angles that damping compares with) is computed
once a step; a vertex gathers its triangles and hinges in an order of its own, so that no matrix is built for the
vertices that do not move.
"""

# mypy: ignore-errors
# ruff: noqa: PLR0917
# Kernels are written in Warp's own language: its annotations are no Python types, and arguments go by position.

import warp as wp

from imgtransfer.simulation.cloth.contact_kernels import Fabric, Touch, plane_contact, self_contact

wp.set_module_options({"enable_backward": False})

_TINY = wp.constant(1e-12)


@wp.struct
class Sheet:
    """What is constant of a cloth with N vertices, C corners of faces, and hinges (two faces at an edge).

    corners: (C,) per vertex in a row, the face and its two other vertices; corner_start (N + 1,) where each
    vertex's begin.
    corner_rest: (C,) p0, q0, p1, q1: the columns of the deformation gradient are f_k = p_k (p - x) + q_k (q - x).
    tips, spines: per vertex in a row, hinges that the vertex is opposite to, or at the edge of: the vertices
    (near opposite, far opposite, edge start, edge end), turned so that the vertex itself is the first or the third.
    """

    mass: wp.array(dtype=float)
    faces: wp.array(dtype=wp.vec3i)
    face_rest: wp.array(dtype=wp.vec4)
    area: wp.array(dtype=float)
    corner_start: wp.array(dtype=int)
    corners: wp.array(dtype=wp.vec3i)
    corner_rest: wp.array(dtype=wp.vec4)
    hinges: wp.array(dtype=wp.vec4i)
    hinge_stiffness: wp.array(dtype=float)  # N·m, energy is half of it times the angle squared
    hinge_rest: wp.array(dtype=float)
    tip_start: wp.array(dtype=int)
    tips: wp.array(dtype=wp.vec4i)
    tip_hinge: wp.array(dtype=int)
    spine_start: wp.array(dtype=int)
    spines: wp.array(dtype=wp.vec4i)
    spine_hinge: wp.array(dtype=int)


@wp.struct
class Step:
    """What is constant within a step: a row a vertex, but for the metric of each face and the angle of each hinge."""

    start: wp.array(dtype=wp.vec3)  # where the step starts
    goal: wp.array(dtype=wp.vec3)  # where inertia and gravity alone would lead
    # Closest point of the body, its outward normal (0 if far away) and velocity.
    surface: wp.array(dtype=wp.vec3)
    normal: wp.array(dtype=wp.vec3)
    speed: wp.array(dtype=wp.vec3)
    metric: wp.array(dtype=wp.vec3)  # FᵀF (its entries 00, 01, 11) at the start
    angle: wp.array(dtype=float)  # at the start


@wp.func
def hinge_angle(x0: wp.vec3, x1: wp.vec3, x2: wp.vec3, x3: wp.vec3) -> float:
    """The fold at the edge x2 x3 of the triangles with the tips x0 and x1; 0 where flat or degenerate."""
    n1 = wp.cross(x2 - x0, x3 - x0)
    n2 = wp.cross(x3 - x1, x2 - x1)
    e = x3 - x2
    length = wp.length(e)
    if length < 1e-6:
        return 0.0
    return wp.atan2(wp.dot(wp.cross(n1, n2), e) / length, wp.dot(n1, n2))


@wp.func
def _columns(rest: wp.vec4, x: wp.vec3, p: wp.vec3, q: wp.vec3):
    a, b = p - x, q - x
    return a * rest[0] + b * rest[1], a * rest[2] + b * rest[3]


@wp.kernel
def begin(
    sheet: Sheet,
    step: Step,
    gravity: wp.vec3,
    dt: float,
    velocity: wp.array(dtype=wp.vec3),
    position: wp.array(dtype=wp.vec3),
):
    """Keep where the step starts, and move to where inertia and gravity alone would lead."""
    i = wp.tid()
    x = position[i]
    step.start[i] = x
    if sheet.mass[i] > 0.0:
        x = x + dt * (velocity[i] + dt * gravity)
    step.goal[i] = x
    position[i] = x


@wp.kernel
def measure_faces(sheet: Sheet, step: Step):
    """The metric of each face at the step's start."""
    t = wp.tid()
    face = sheet.faces[t]
    f0, f1 = _columns(sheet.face_rest[t], step.start[face[0]], step.start[face[1]], step.start[face[2]])
    step.metric[t] = wp.vec3(wp.dot(f0, f0), wp.dot(f0, f1), wp.dot(f1, f1))


@wp.kernel
def measure_hinges(sheet: Sheet, step: Step):
    """The angle of each hinge at the step's start."""
    h = wp.tid()
    of = sheet.hinges[h]
    step.angle[h] = hinge_angle(step.start[of[0]], step.start[of[1]], step.start[of[2]], step.start[of[3]])


@wp.kernel
def find_contacts(step: Step, body: wp.uint64, reach: float):
    """The body's closest point to each vertex, if it is within `reach`."""
    i = wp.tid()
    x = step.start[i]
    n = wp.vec3(0.0)
    closest = wp.mesh_query_point_sign_normal(body, x, reach)
    if closest.result:
        p = wp.mesh_eval_position(body, closest.face, closest.u, closest.v)
        n = wp.normalize(x - p) * closest.sign
        step.surface[i] = p
        step.speed[i] = wp.mesh_eval_velocity(body, closest.face, closest.u, closest.v)
    step.normal[i] = n


@wp.func
def _membrane(
    rest: wp.vec4,
    area: float,
    before: wp.vec3,
    fabric: Fabric,
    inverse_dt: float,
    x: wp.vec3,
    p: wp.vec3,
    q: wp.vec3,
):
    """Stable Neo-Hookean membrane (Smith et al. 2018) with equal Lamé parameters, damped in its metric."""
    f0, f1 = _columns(rest, x, p, q)
    d0 = -(rest[0] + rest[1])
    d1 = -(rest[2] + rest[3])
    across = wp.cross(f0, f1)
    grown = wp.sqrt(wp.max(wp.dot(across, across), 1e-20))
    n = across / grown
    mu = fabric.stretch
    lam = 2.0 * mu  # λ + μ
    pressure = lam * (grown - 1.5)  # rest stability: 1 + μ / (λ + μ)
    rise = wp.cross(f1, n) * d0 + wp.cross(n, f0) * d1  # derivative of `grown`
    force = -(mu * (d0 * f0 + d1 * f1) + pressure * rise)
    r = wp.max(pressure, 0.0) / grown
    w = f1 * d0 - f0 * d1
    hessian = (
        wp.identity(n=3, dtype=float) * (mu * (d0 * d0 + d1 * d1) + r * wp.dot(w, w))
        + wp.outer(rise, rise) * (lam - r)
        - wp.outer(w, w) * r
    )
    if fabric.stretch_damping > 0.0:
        c00, c01, c11 = 2.0 * d0 * f0, d0 * f1 + d1 * f0, 2.0 * d1 * f1
        k = fabric.stretch_damping * fabric.stretch * inverse_dt
        force -= k * (
            (wp.dot(f0, f0) - before[0]) * c00
            + 2.0 * (wp.dot(f0, f1) - before[1]) * c01
            + (wp.dot(f1, f1) - before[2]) * c11
        )
        hessian += k * (wp.outer(c00, c00) + 2.0 * wp.outer(c01, c01) + wp.outer(c11, c11))
    return force * area, hessian * area


@wp.func
def _hinge(
    sheet: Sheet,
    step: Step,
    k: int,
    of: wp.vec4i,
    at_edge: bool,
    position: wp.array(dtype=wp.vec3),
    damping: float,
):
    """Force and Hessian on the first vertex of hinge k, or on the third if `at_edge`; `damping` in units of a step."""
    x0, x1, x2, x3 = position[of[0]], position[of[1]], position[of[2]], position[of[3]]
    e = x3 - x2
    n1 = wp.cross(x2 - x0, x3 - x0)
    n2 = wp.cross(x3 - x1, x2 - x1)
    length = wp.length(e)
    big1, big2 = wp.dot(n1, n1), wp.dot(n2, n2)
    if length < 1e-6 or big1 < _TINY * 1e-4 or big2 < _TINY * 1e-4:
        return wp.vec3(0.0), wp.mat33(0.0)
    angle = wp.atan2(wp.dot(wp.cross(n1, n2), e) / length, wp.dot(n1, n2))
    gradient = -length / big1 * n1
    if at_edge:
        square = length * length
        gradient = gradient * (-wp.dot(x3 - x0, e) / square) + n2 * (
            length / big2 * wp.dot(x3 - x1, e) / square
        )
    turned = angle - step.angle[k]
    if turned > wp.pi:
        turned -= 2.0 * wp.pi
    elif turned < -wp.pi:
        turned += 2.0 * wp.pi
    stiffness = sheet.hinge_stiffness[k]
    moment = stiffness * (angle - sheet.hinge_rest[k] + damping * turned)
    return -moment * gradient, wp.outer(gradient, gradient) * (stiffness * (1.0 + damping))


@wp.kernel
def descend(
    sheet: Sheet,
    step: Step,
    touch: Touch,
    fabric: Fabric,
    dt: float,
    members: wp.array(dtype=int),
    position: wp.array(dtype=wp.vec3),
):
    """One Newton step of each vertex of a colour, the others fixed; no two of a colour share a face or hinge."""
    i = members[wp.tid()]
    mass = sheet.mass[i]
    if mass == 0.0:
        return
    x = position[i]
    inverse_dt = 1.0 / dt
    inertia = mass * inverse_dt * inverse_dt
    force, hessian = plane_contact(
        fabric,
        fabric.contact_stiffness,
        fabric.thickness,
        dt,
        x,
        step.start[i],
        step.surface[i],
        step.normal[i],
        step.speed[i],
    )
    if touch.apart > 0.0:
        f, h = self_contact(touch, fabric, dt, i, step.start, position)
        force += f
        hessian += h
    force += inertia * (step.goal[i] - x)
    hessian += inertia * wp.identity(n=3, dtype=float)
    for c in range(sheet.corner_start[i], sheet.corner_start[i + 1]):
        of = sheet.corners[c]
        t, p, q = of[0], position[of[1]], position[of[2]]
        f, h = _membrane(sheet.corner_rest[c], sheet.area[t], step.metric[t], fabric, inverse_dt, x, p, q)
        force += f
        hessian += h
    damping = fabric.bending_damping * inverse_dt
    for c in range(sheet.tip_start[i], sheet.tip_start[i + 1]):
        k = sheet.tip_hinge[c]
        f, h = _hinge(sheet, step, k, sheet.tips[c], False, position, damping)
        force += f
        hessian += h
    for c in range(sheet.spine_start[i], sheet.spine_start[i + 1]):
        k = sheet.spine_hinge[c]
        f, h = _hinge(sheet, step, k, sheet.spines[c], True, position, damping)
        force += f
        hessian += h
    if wp.abs(wp.determinant(hessian)) > 1e-8:
        position[i] = x + fabric.relaxation * (wp.inverse(hessian) * force)


@wp.kernel
def finish(
    step: Step, inverse_dt: float, position: wp.array(dtype=wp.vec3), velocity: wp.array(dtype=wp.vec3)
):
    """Velocities from the displacements of the step."""
    i = wp.tid()
    velocity[i] = (position[i] - step.start[i]) * inverse_dt
