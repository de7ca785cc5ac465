"""One vertex of a cloth whose others are pinned goes to where the energy of the step is least.

The energy is written out here in float64 with its own formulas (tr(FᵀF), areas, dihedral angles), and minimised by
SciPy; the kernels know only forces and approximate Hessians.
"""

from functools import cache

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from imgtransfer.simulation.cloth.descent import CONTACT_DAMPING
from imgtransfer.simulation.cloth.model import GRAVITY, ClothOnBody
from imgtransfer.simulation.config import ClothConfig, SolverConfig
from render.mesh.mesh import Mesh

DT, FREE = 1 / 60, 4
MATERIAL = {"density": 0.2, "stretch": 40.0, "bending": 2e-3, "stretch_damping": 0.0, "bending_damping": 0.0,
            "friction": 0.0, "thickness": 0.003, "contact_stiffness": 800.0}  # fmt: skip
PLATE = np.array([[-2, 0, -2], [2, 0, -2], [2, 0, 2], [-2, 0, 2], [0, -1, 0]], np.float32)
PLATE_FACES = np.array([[0, 2, 1], [0, 3, 2], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])


@cache
def patch(height=1.0):
    """Nine vertices, three rows of three, a little uneven, level at a height."""
    x, z = np.meshgrid([-0.05, 0.0, 0.05], [-0.05, 0.0, 0.05])
    points = np.stack([x.ravel(), np.full(9, height), z.ravel()], axis=1)
    points[:, [0, 2]] += np.random.default_rng(0).uniform(-0.008, 0.008, (9, 2))
    quads = np.arange(9).reshape(3, 3)
    a, b, c, d = (quads[i : 2 + i, j : 2 + j].ravel() for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)))
    return Mesh(points, np.concatenate([np.stack([a, c, b], axis=1), np.stack([b, c, d], axis=1)]))


def areas_and_stretch(points):
    """(F,) areas, and (F,) tr(FᵀF) = |f0|² + |f1|², of `points` against the patch at rest."""
    rest, faces = patch().vertices, patch().faces
    metric = metrics(points)
    at_rest = np.cross(rest[faces[:, 1]] - rest[faces[:, 0]], rest[faces[:, 2]] - rest[faces[:, 0]])
    now = np.cross(points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]])
    sizes = [np.linalg.norm(across, axis=1) / 2 for across in (at_rest, now)]
    return *sizes, np.trace(metric, axis1=1, axis2=2)


def metrics(points):
    """(F, 2, 2) FᵀF, in axes of the level patch at rest."""
    rest, faces = patch().vertices, patch().faces
    spans = [
        np.stack([p[faces[:, 1]] - p[faces[:, 0]], p[faces[:, 2]] - p[faces[:, 0]]], axis=2)
        for p in (rest, points)
    ]
    gradient = spans[1] @ np.linalg.inv(spans[0][:, [2, 0]])
    return np.swapaxes(gradient, 1, 2) @ gradient


@cache
def hinges():
    """(near tip, far tip, edge start, edge end) of every edge with two faces, by a plain search."""
    result = []
    for one in patch().faces.tolist():
        for start, end, tip in (one, one[1:] + one[:1], one[2:] + one[:2]):
            others = [f for f in patch().faces.tolist() if start in f and end in f and tip not in f]
            if others and start < end:
                (far,) = set(others[0]) - {start, end}
                result.append((tip, far, start, end))
    return result


def angles(points):
    """Signed folds at the hinges; 0 where flat."""
    tip, far, start, end = (points[column] for column in np.array(hinges()).T)
    edge = (end - start) / np.linalg.norm(end - start, axis=1, keepdims=True)
    near, beyond = (side - start - ((side - start) * edge).sum(axis=1)[:, None] * edge for side in (tip, far))
    # From one side's continuation to the other side, about the edge.
    return np.arctan2((np.cross(-near, beyond) * edge).sum(axis=1), (-near * beyond).sum(axis=1))


def energy(points, start, velocity, **material):
    """J, of a step of the free vertex; the cloth's rest shape costs no bending."""
    values = MATERIAL | material
    rest_area, area, stretch = areas_and_stretch(points)
    mass = values["density"] * rest_area[(patch().faces == FREE).any(axis=1)].sum() / 3
    goal = start[FREE] + DT * (velocity + DT * np.array(GRAVITY))
    mu = values["stretch"]
    total = mass / (2 * DT**2) * ((points[FREE] - goal) ** 2).sum()
    total += (rest_area * (mu / 2 * stretch + mu * (area / rest_area - 1.5) ** 2)).sum()
    change = metrics(points) - metrics(start)
    total += values["stretch_damping"] * mu / DT / 2 * (rest_area * (change**2).sum(axis=(1, 2))).sum()
    rest = patch().vertices
    mean = np.linalg.norm(np.diff(rest[patch().edges], axis=1), axis=-1).mean()
    lengths = np.array([np.linalg.norm(rest[b] - rest[a]) for _, _, a, b in hinges()])
    stiffness = 2 / np.sqrt(3) * values["bending"] / mean * lengths
    total += (stiffness / 2 * angles(points) ** 2).sum()
    damping = values["bending_damping"] / DT
    return total + (stiffness / 2 * damping * (angles(points) - angles(start)) ** 2).sum()


def least(near, start, velocity, extra=lambda x: 0.0, **material):
    """Where SciPy finds the least energy for the free vertex, from 0.5 mm beside `near`: slack cloth has two places."""

    def of(moved):  # in millimetres and microjoules, numbers near 1
        points = start.copy()
        points[FREE] = near + 1e-3 * moved
        return 1e6 * (energy(points, start, velocity, **material) + extra(points[FREE]))

    return near + 1e-3 * minimize(of, [0.3, 0.4, 0.0], jac="3-point", tol=1e-4).x


def stepped(start, velocity, *, below=-50.0, **material):
    """Where the kernels lead the free vertex."""
    config = ClothConfig.model_validate(MATERIAL | material)
    pinned = np.setdiff1d(np.arange(9), FREE)
    body = PLATE + np.float32([0, below, 0])
    solver = SolverConfig(iterations=150, relaxation=1.0)
    cloth = ClothOnBody(patch(), body, PLATE_FACES, config, solver, pinned=pinned)
    velocities = np.zeros((9, 3))
    velocities[FREE] = velocity
    cloth.place(start, velocities, body)
    cloth.step(body, DT)
    assert np.array_equal(cloth.vertices[pinned], np.float32(start[pinned]))
    np.testing.assert_allclose(cloth.velocities[FREE], (cloth.vertices[FREE] - start[FREE]) / DT, atol=1e-4)
    return cloth.vertices[FREE]


def bent(seed, *, scale=1.0, size=0.006):
    """The patch stretched evenly about its middle, and every vertex moved a little."""
    moved = np.random.default_rng(seed).normal(0, size, (9, 3))
    return np.float64(np.float32((patch().vertices - [0, 1, 0]) * scale + [0, 1, 0] + moved))


@pytest.mark.parametrize("scale", [0.8, 1.0, 1.6])  # slack; at rest; so far stretched that areas pull back
def test_a_vertex_goes_to_the_least_energy(scale):
    start, velocity = bent(1, scale=scale), np.array([0.2, 0.5, -0.3])
    end = stepped(start, velocity)
    assert np.linalg.norm(end - start[FREE]) > 1e-3
    np.testing.assert_allclose(end, least(end, start, velocity), atol=4e-6)


@pytest.mark.parametrize(("changed", "apart"), [
    ({"bending": 0.5}, 5e-4),  # outweighs everything else: a wrong gradient of an angle would show
    ({"stretch_damping": 0.02}, 5e-4),
    ({"bending_damping": 0.5}, 3e-5),
    ({"density": 2.0}, 5e-4),
])  # fmt: skip
def test_each_constant_of_the_cloth_counts_as_written(changed, apart):
    start, velocity = bent(3), np.array([0.1, -0.4, 0.6])
    end = stepped(start, velocity, **changed)
    assert np.linalg.norm(end - stepped(start, velocity)) > apart
    np.testing.assert_allclose(end, least(end, start, velocity, **changed), atol=4e-6)


@pytest.mark.parametrize("speed", [-0.15, 0.1])  # into the plate, which damps; off it, which does not
def test_a_plate_pushes_with_its_spring_and_damps_what_comes_nearer(speed):
    mean = np.linalg.norm(np.diff(patch().vertices[patch().edges], axis=1), axis=-1).mean()
    apart = MATERIAL["thickness"] + mean**2 / (8 * 0.03)  # and the sagitta of an edge on a bend of 3 cm
    start, top = bent(4), 1.0
    start[FREE, 1] = np.float32(top + 0.6 * apart)

    def contact(x):
        depth, nearer = max(apart - (x[1] - top), 0.0), min(x[1] - start[FREE, 1], 0.0)
        return (MATERIAL["contact_stiffness"] * depth**2 + CONTACT_DAMPING / DT * nearer**2 * (depth > 0)) / 2

    velocity = np.array([0.0, speed, 0.0])
    end = stepped(start, velocity, below=top)
    assert np.linalg.norm(end - stepped(start, velocity)) > 1e-4
    np.testing.assert_allclose(end, least(end, start, velocity, contact), atol=4e-6)


def fallen(turn, shift):
    """Ten steps of a patch that hangs from two corners, in a world that was turned about the vertical and shifted."""
    place = Rotation.from_rotvec([0, turn, 0]).as_matrix().T
    mesh = Mesh(bent(5) @ place + shift, patch().faces)
    cloth = ClothOnBody(
        mesh,
        PLATE - np.float32([0, 50, 0]),
        PLATE_FACES,
        ClothConfig(),
        SolverConfig(),
        pinned=np.array([0, 2]),
    )
    for _ in range(10):
        cloth.step(PLATE - np.float32([0, 50, 0]), DT)
    return (cloth.vertices - shift) @ place.T


def test_a_turned_and_shifted_world_is_the_same_world():
    first, other = fallen(0.0, np.zeros(3)), fallen(1.1, np.array([0.5, -0.25, 1.0]))
    assert np.abs(first - bent(5)).max() > 0.02
    np.testing.assert_allclose(other, first, atol=2e-5)


def test_triangles_and_hinges_without_a_size_leave_everything_finite():
    start = bent(6)
    start[5] = start[8]  # an edge of no length, and faces of no area
    start[FREE] = start[1]
    assert np.isfinite(stepped(start, np.zeros(3))).all()
