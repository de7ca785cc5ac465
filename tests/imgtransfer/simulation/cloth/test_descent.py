"""The project's own descent against Newton's solver, and contact of the cloth with itself."""

import numpy as np
import pytest

from imgtransfer.simulation.cloth.model import ClothOnBody
from imgtransfer.simulation.cloth.newton_descent import NewtonDescent
from imgtransfer.simulation.config import ClothConfig, SolverConfig
from render.mesh.mesh import Mesh


def sheet(n=9, size=0.3, height=0.0, seed=0):
    """A square of cloth, slightly uneven, at a height."""
    x, z = np.meshgrid(np.linspace(-size / 2, size / 2, n), np.linspace(-size / 2, size / 2, n))
    points = np.stack([x.ravel(), np.full(n * n, height), z.ravel()], axis=1)
    points += 0.1 * size / n * np.random.default_rng(seed).uniform(-1, 1, points.shape)
    quads = np.arange(n * n).reshape(n, n)
    a, b, c, d = (quads[i : n - 1 + i, j : n - 1 + j].ravel() for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)))
    faces = np.concatenate([np.stack([a, c, b], axis=1), np.stack([b, c, d], axis=1)])
    return Mesh(points, faces)


def octahedron(radius=0.1):
    points = radius * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
    faces = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
    return points.astype(np.float32), np.array(faces)


def dropped(kind, steps, **options):
    """A sheet with two pinned corners that falls on a body, which moves away under it; (steps, N, 3)."""
    body, faces = octahedron()
    mesh = sheet(height=0.104)
    pinned = np.array([0, 8])
    material = ClothConfig.model_validate({"stretch_damping": 1e-4, **options})
    solver = SolverConfig(iterations=5, relaxation=1.0)
    cloth = ClothOnBody(mesh, body, faces, material, solver, pinned=pinned)
    if kind == "newton":
        model = cloth.model  # the same model, so that nothing but the stepping differs
        cloth.stepper = NewtonDescent(model, material, 5, self_contact=False)
    frames = []
    for number in range(1, steps + 1):
        way = np.array([0.002 * number, 0.001 * number, 0], np.float32)
        cloth.step(body + way, 1 / 240, mesh.vertices[pinned] + way)
        frames.append(cloth.vertices)
    return np.stack(frames)


@pytest.mark.parametrize("options", [{}, {"fabric": "denim"}, {"bending_damping": 0.0, "friction": 0.0}])
def test_it_steps_as_newtons_solver_does(options):
    own, newton = dropped("own", 30, **options), dropped("newton", 30, **options)
    assert np.abs(own - own[0]).max() > 0.03
    assert np.abs(own[:5] - newton[:5]).max() < 2e-6  # metres; rounding, which contact then multiplies
    assert np.abs(own - newton).max() < 5e-4


def test_over_relaxation_leaves_less_stretch():
    rest = sheet(height=0.104).vertices
    lengths = {}
    for relaxation in (1.0, 1.5):
        body, faces = octahedron()
        mesh, solver = sheet(height=0.104), SolverConfig(iterations=2, relaxation=relaxation)
        cloth = ClothOnBody(mesh, body - np.float32(5), faces, ClothConfig(), solver, pinned=np.arange(9))
        for _ in range(60):
            cloth.step(body - np.float32(5), 1 / 120)
        start, end = mesh.edges.T
        stretched = np.linalg.norm(cloth.vertices[end] - cloth.vertices[start], axis=1)
        lengths[relaxation] = (stretched / np.linalg.norm(rest[end] - rest[start], axis=1)).max()
    assert 1 < lengths[1.5] < lengths[1.0]
    assert lengths[1.5] - 1 < 0.7 * (lengths[1.0] - 1)


def test_free_fall_by_hand():
    body, faces = octahedron()
    mesh = sheet(height=2.0)
    cloth = ClothOnBody(mesh, body, faces, ClothConfig(), SolverConfig())
    for _ in range(24):
        cloth.step(body, 1 / 240)
    fallen = 9.81 / 240**2 * 24 * 25 / 2  # implicit Euler
    np.testing.assert_allclose(mesh.vertices - cloth.vertices, np.tile([0, fallen, 0], (81, 1)), atol=2e-5)


def test_held_vertices_go_where_they_are_told():
    body, faces = octahedron()
    mesh = sheet(height=0.5)
    pinned = np.array([0, 8, 40])
    cloth = ClothOnBody(mesh, body, faces, ClothConfig(), SolverConfig(), pinned=pinned)
    for number in range(1, 6):
        target = mesh.vertices[pinned] + [0, 0.001 * number, 0]
        cloth.step(body, 1 / 240, target)
        np.testing.assert_allclose(cloth.vertices[pinned], target, atol=1e-7)


def test_friction_decides_whether_cloth_rides_along():
    body, faces = np.array([[-2, 0, -2], [2, 0, -2], [2, 0, 2], [-2, 0, 2], [0, -1, 0]], np.float32), np.array(
        [[0, 2, 1], [0, 3, 2], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]
    )  # fmt: skip
    moved = {}
    for friction, moving in ((0.0, False), (0.0, True), (0.6, True)):
        material = ClothConfig.model_validate({"friction": friction})
        mesh = sheet(height=0.0115)
        cloth = ClothOnBody(mesh, body, faces, material, SolverConfig())
        for number in range(1, 121):  # 0.5 s at 1 m/s² sideways, a sixth of what friction 0.6 can hold
            way = moving * np.array([0.5 * (number / 240) ** 2, 0, 0], np.float32)
            cloth.step(body + way, 1 / 240)
        moved[friction, moving] = (cloth.vertices - mesh.vertices)[:, 0].mean()
    assert moved[0.0, True] == pytest.approx(moved[0.0, False], abs=1e-4)
    assert moved[0.6, True] == pytest.approx(0.125, abs=0.01)


def two_sheets():
    """One mesh of two separate sheets, the second 20 mm above the first, whose border is pinned."""
    lower, upper = sheet(seed=1), sheet(size=0.15, height=0.02, seed=2)
    n = len(lower.vertices)
    mesh = Mesh(
        np.concatenate([lower.vertices, upper.vertices]), np.concatenate([lower.faces, upper.faces + n])
    )
    at = np.abs(lower.vertices[:, [0, 2]]).max(axis=1)
    return mesh, np.flatnonzero(at > 0.13), n


def test_self_contact_catches_a_sheet_that_falls_on_another():
    body, faces = octahedron()
    mesh, pinned, n = two_sheets()
    heights = {}
    for self_contact in (False, True):
        solver = SolverConfig(self_contact=self_contact)
        cloth = ClothOnBody(mesh, body - np.float32(5), faces, ClothConfig(), solver, pinned=pinned)
        for _ in range(36):
            cloth.step(body - np.float32(5), 1 / 240, mesh.vertices[pinned])
        heights[self_contact] = (cloth.vertices[n:, 1] - cloth.vertices[:n, 1].min()).min()
        assert np.isfinite(cloth.vertices).all()
    assert heights[False] < -0.01  # fell through
    assert heights[True] > -0.001  # lies on the other, however deep that sags
