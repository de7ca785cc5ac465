"""Contact of the cloth with itself: the closest point, what touches what, which side, tangles, momentum."""

import numpy as np
import pytest
import warp as wp
from scipy.optimize import minimize

from fusion.obstacles import edges_through_own_faces
from imgtransfer.simulation.cloth.contact_kernels import closest_weights
from imgtransfer.simulation.cloth.model import ClothOnBody
from imgtransfer.simulation.cloth.self_contact import SelfContact
from imgtransfer.simulation.config import ClothConfig, SolverConfig
from render.mesh.mesh import Mesh

FAR = np.float32([0, -50, 0])
TETRAHEDRON = np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
TETRAHEDRON_FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


@wp.kernel
def weights_of(
    points: wp.array(dtype=wp.vec3), corners: wp.array2d(dtype=wp.vec3), out: wp.array(dtype=wp.vec3)
):
    i = wp.tid()
    out[i] = closest_weights(points[i], corners[i, 0], corners[i, 1], corners[i, 2])


def weights(points, corners):
    out = wp.zeros(len(points), dtype=wp.vec3, device="cpu")
    given = [wp.array(np.float32(points), dtype=wp.vec3, device="cpu"),
             wp.array(np.float32(corners), dtype=wp.vec3, ndim=2, device="cpu")]  # fmt: skip
    wp.launch(weights_of, dim=len(points), inputs=[*given, out], device="cpu")
    return out.numpy()


def square(height=0.0, n=4, size=0.06, seed=0):
    """A level square of cloth, slightly uneven within its plane."""
    x, z = np.meshgrid(np.linspace(0, size, n), np.linspace(0, size, n))
    points = np.stack([x.ravel(), np.full(n * n, height), z.ravel()], axis=1)
    points[:, [0, 2]] += 0.1 * size / n * np.random.default_rng(seed).uniform(-1, 1, (n * n, 2))
    quads = np.arange(n * n).reshape(n, n)
    a, b, c, d = (quads[i : n - 1 + i, j : n - 1 + j].ravel() for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)))
    return Mesh(points, np.concatenate([np.stack([a, c, b], axis=1), np.stack([b, c, d], axis=1)]))


def inner(height=0.001):
    """A smaller square, above the middle of `square()`."""
    small = square(height, size=0.03, seed=1)
    return Mesh(small.vertices + np.array([0.015, 0, 0.015]), small.faces)


def layers(lower, upper):
    """The cloth of two squares that lie far apart at rest, where the squares are (2n, 3), and n."""
    n = len(lower.vertices)
    rest = np.concatenate([lower.vertices, upper.vertices + np.array([0, 1, 0])])
    placed = np.concatenate([lower.vertices, upper.vertices])
    return Mesh(rest, np.concatenate([lower.faces, upper.faces + n])), np.float32(placed), n


def cloth_of(mesh, iterations=20, **material):
    given = {"thickness": 0.002, "friction": 0.0, **material}
    solver = SolverConfig(self_contact=True, iterations=iterations, relaxation=1.0)
    return ClothOnBody(mesh, TETRAHEDRON + FAR, TETRAHEDRON_FACES, ClothConfig(**given), solver)


def itself(cloth) -> SelfContact:
    found = cloth.stepper.self_contact
    assert found is not None
    return found


def look(cloth, vertices):
    """Find touches of the cloth at `vertices`, as a step does."""
    cloth.place(vertices, np.zeros_like(vertices), TETRAHEDRON + FAR)
    contact = itself(cloth)
    contact.update(cloth.state.particle_q)
    for kernel, arguments in contact.commands(cloth.state.particle_q):
        wp.launch(kernel, dim=len(vertices), inputs=list(arguments), device="cpu")
    return contact.touch


def test_weights_of_the_closest_point_by_hand():
    corners = np.float32([[0, 0, 0], [2, 0, 0], [0, 2, 0]])
    points = np.float32(
        [[0.5, 0.5, 3], [-1, -1, 0], [5, -1, 1], [-1, 5, 0], [1, -2, 0], [-3, 1, 0], [3, 3, 0]]
    )
    wanted = [[0.5, 0.25, 0.25], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0.5, 0.5, 0], [0.5, 0, 0.5], [0, 0.5, 0.5]]
    assert weights(points, np.stack([corners] * len(points))) == pytest.approx(np.array(wanted), abs=1e-6)


def test_weights_of_the_closest_point_are_those_of_a_plain_search():
    random = np.random.default_rng(4)
    corners, points = random.normal(size=(20, 3, 3)), 2 * random.normal(size=(20, 3))
    for point, triangle, found in zip(points, corners, weights(points, corners), strict=True):
        best = minimize(
            lambda w, p=point, t=triangle: ((p - w @ t) ** 2).sum(),
            np.full(3, 1 / 3),
            bounds=[(0, 1)] * 3,
            constraints={"type": "eq", "fun": lambda w: w.sum() - 1},
        )
        assert found.min() >= 0
        assert found.sum() == pytest.approx(1, abs=1e-6)
        assert np.linalg.norm(point - found @ triangle) == pytest.approx(np.sqrt(best.fun), abs=2e-4)


def test_touches_are_between_layers():
    mesh, placed, n = layers(square(), inner())
    cloth = cloth_of(mesh)
    assert 0.001 < itself(cloth).touch.apart < 0.005
    touch = look(cloth, placed)
    face, faces = touch.face.numpy(), mesh.faces
    assert (faces[face[n:]] < n).all()  # the upper layer touches the lower one
    assert (face[n:] >= 0).all()
    assert (face[:n] < 0).any()  # what lies beside the upper layer touches nothing
    assert touch.normal.numpy()[n:, 1] == pytest.approx(1, abs=1e-5)
    counts = np.bincount(faces[face[face >= 0]].ravel(), minlength=2 * n)
    assert np.array_equal(counts, touch.count.numpy())
    apart = placed.copy()
    apart[n:, 1] += 0.01
    assert (look(cloth, apart).face.numpy() < 0).all()


def test_what_lies_close_at_rest_never_touches():
    lower, upper = square(), inner()
    rest = np.concatenate([lower.vertices, upper.vertices])
    cloth = cloth_of(Mesh(rest, np.concatenate([lower.faces, upper.faces + len(lower.vertices)])))
    assert (look(cloth, np.float32(rest)).face.numpy() < 0).all()


def test_a_vertex_that_slipped_through_belongs_on_its_old_side():
    mesh, placed, n = layers(square(), inner())
    cloth = cloth_of(mesh)
    before = look(cloth, placed).side.numpy()[n:].copy()
    through = placed.copy()
    through[n:, 1] = -0.001
    after = look(cloth, through)
    assert np.array_equal(after.side.numpy()[n:], before)
    assert after.normal.numpy()[n:, 1] == pytest.approx(1, abs=1e-5)
    for _ in range(20):
        cloth.step(TETRAHEDRON + FAR, 1 / 300)
    # Both fall; the upper layer is above again.
    assert (cloth.vertices[n:, 1] > cloth.vertices[:n, 1].max() - 0.001).all()


def test_edges_that_pass_through_the_cloth_are_those_of_a_plain_loop():
    upright = square(seed=3, size=0.04)
    upright = Mesh(upright.vertices[:, [0, 2, 1]] + [0.011, -0.02, 0.0313], upright.faces)
    mesh, placed, _ = layers(square(), upright)
    tangled = look(cloth_of(mesh), placed).tangled.numpy()
    wanted = np.zeros(len(placed), int)
    for start, end in mesh.edges:
        for face in mesh.faces:
            p, q, r = np.float64(placed[face])
            a, b = np.float64(placed[[start, end]])
            system = np.stack([q - p, r - p, a - b], axis=1)
            if {start, end} & set(face.tolist()) or abs(np.linalg.det(system)) < 1e-12:
                continue
            u, v, t = np.linalg.solve(system, a - p)
            if min(u, v, t) > 0 and u + v < 1 and t < 1:
                wanted[[start, end]] = 1
    assert 0 < wanted.sum() < len(wanted)
    assert np.array_equal(tangled, wanted)
    found = edges_through_own_faces(np.stack([mesh.vertices, placed]), mesh.edges, mesh.faces).marks().numpy()
    assert not found[0].any()  # apart, as at rest
    assert np.array_equal(np.unique(mesh.edges[found[1]]), np.flatnonzero(wanted))


def test_layers_that_collide_keep_their_momentum():
    mesh, placed, n = layers(square(), square(0.006, seed=1))
    cloth = cloth_of(mesh, iterations=300)  # what a step has not shared out yet is no law's fault
    mass = cloth.model.particle_mass.numpy().astype(float)
    velocity = np.zeros_like(placed)
    velocity[n:] = [0.1, -0.5, 0]
    cloth.place(placed, velocity, TETRAHEDRON + FAR)
    dt, steps = 1 / 600, 60
    for _ in range(steps):
        cloth.step(TETRAHEDRON + FAR, dt)
    gained = mass @ (cloth.velocities - velocity)
    fallen = -9.81 * dt * steps
    assert gained == pytest.approx([0, mass.sum() * fallen, 0], abs=0.02 * 0.5 * float(mass[n:].sum()))
    # They met: the lower one was pushed on, and did not let the other pass.
    assert mass[:n] @ cloth.velocities[:n, 1] / mass[:n].sum() < fallen - 0.1
    assert cloth.vertices[n:, 1].mean() > cloth.vertices[:n, 1].mean()


def test_friction_between_layers_carries_the_lower_one_along():
    speeds = {}
    for friction in (0.0, 0.8):
        mesh, placed, n = layers(square(), inner(0.003))
        cloth = cloth_of(mesh, friction=friction)
        velocity = np.zeros_like(placed)
        velocity[n:] = [0.3, -1.0, 0]
        cloth.place(placed, velocity, TETRAHEDRON + FAR)
        for _ in range(20):
            cloth.step(TETRAHEDRON + FAR, 1 / 600)
        speeds[friction] = cloth.velocities[:n, 0].mean()
    assert speeds[0.8] > speeds[0.0] + 0.05
