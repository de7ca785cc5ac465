"""Cloth on a moving body: the model, built with Newton (which runs on Warp), and its steps in time.

The body is one mesh collider without mass. Its points move at every substep, and its surface velocity reaches the
friction. The cloth collides with itself on request.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fusion.warp_start import warp_module
from imgtransfer.simulation.cloth.descent import CONTACT_DAMPING, ClothDescent
from imgtransfer.simulation.config import ClothConfig, SolverConfig
from render.extras import optional
from render.mesh.measures import edge_lengths
from render.mesh.mesh import Mesh

GRAVITY = (0.0, -9.81, 0.0)  # m/s²
_ROUND = 0.03  # metres, the radius of the sharpest bends that cloth lies on: knees, elbows, shoulders
_EVERYWHERE = 1e4  # metres; the collider's bounding box, which Newton computes for the rest pose only


class ClothOnBody:
    """A cloth and the body it lies on, stepped in time.

    Args:
        cloth: the cloth's rest shape; its curvature at rest costs no bending energy.
        body_vertices: (B, 3) where the body stands at first, metres. body_faces: (G, 3) int.
        material: see `ClothConfig`.
        solver: for its iterations, and whether the cloth collides with itself.
        pinned: (H,) int, vertices that go where `step` and `place` say, whatever pulls at them.

    Raises:
        InputError: Newton is not installed.
    """

    def __init__(
        self,
        cloth: Mesh,
        body_vertices: np.ndarray,
        body_faces: np.ndarray,
        material: ClothConfig,
        solver: SolverConfig,
        *,
        pinned: np.ndarray | None = None,
    ) -> None:
        warp, newton = _libraries()
        builder = newton.ModelBuilder(up_axis=newton.Axis.Y, gravity=GRAVITY)
        edge = edge_lengths(cloth.vertices, cloth.edges).mean()
        hinge = 2 / np.sqrt(3) * material.bending / edge
        # Only vertices meet the skin. Between them a straight edge on a round limb would sink in by its sagitta.
        kept = material.thickness + edge**2 / (8 * _ROUND)
        material = material.model_copy(update={"thickness": float(kept)})
        builder.add_cloth_mesh(
            pos=warp.vec3(0.0),
            rot=warp.quat_identity(),
            scale=1.0,
            vel=warp.vec3(0.0),
            vertices=[warp.vec3(*vertex) for vertex in cloth.vertices],
            indices=cloth.faces.ravel().tolist(),
            density=material.density,
            tri_ke=material.stretch,
            tri_ka=material.stretch,
            tri_kd=material.stretch_damping * material.stretch,
            # Equilateral triangles with edge length L bend like a plate of rigidity D where a hinge's energy is
            # 1/2 (2/√3 D) angle² (Seung and Nelson 1988), and Newton multiplies by the edge's length itself.
            edge_ke=hinge,
            edge_kd=material.bending_damping * hinge,
            particle_radius=material.thickness,
        )
        collider = newton.Mesh(body_vertices, body_faces.ravel().astype(np.int32), compute_inertia=False)
        surface = newton.ModelBuilder.ShapeConfig(
            ke=material.contact_stiffness, kd=CONTACT_DAMPING, mu=material.friction, margin=0.0
        )
        builder.add_shape_mesh(-1, mesh=collider, cfg=surface)
        self._pinned = np.zeros(0, np.int64) if pinned is None else pinned
        for vertex in self._pinned:
            builder.particle_mass[vertex] = 0.0
        builder.color(include_bending=True)  # no two vertices of a colour share a face or a hinge
        model = builder.finalize(device="cpu")
        model.soft_contact_ke = material.contact_stiffness
        model.soft_contact_kd = CONTACT_DAMPING
        model.soft_contact_mu = material.friction
        model.shape_collision_aabb_lower.fill_(warp.vec3(-_EVERYWHERE))
        model.shape_collision_aabb_upper.fill_(warp.vec3(_EVERYWHERE))
        self.collider: Any = collider.mesh
        self.model: Any = model
        self.stepper: Any = ClothDescent(
            model,
            self.collider,
            material,
            solver.iterations,
            relaxation=solver.relaxation,
            self_contact=solver.self_contact,
        )
        self.state: Any = model.state()
        self._body = body_vertices.astype(np.float32)

    @property
    def vertices(self) -> np.ndarray:
        """(N, 3) float32, metres."""
        return self.state.particle_q.numpy().copy()

    @property
    def velocities(self) -> np.ndarray:
        """(N, 3) float32, m/s."""
        return self.state.particle_qd.numpy().copy()

    def place(self, vertices: np.ndarray, velocities: np.ndarray, body_vertices: np.ndarray) -> None:
        """Set where the cloth (N, 3) and the body (B, 3) are, without a step in time."""
        self.state.particle_q.assign(vertices.astype(np.float32))
        self.state.particle_qd.assign(velocities.astype(np.float32))
        self._body = body_vertices.astype(np.float32)

    def step(self, body_vertices: np.ndarray, dt: float, pinned: np.ndarray | None = None) -> None:
        """Move the body to (B, 3) and the pinned vertices to (H, 3) within `dt` seconds and let the cloth follow."""
        if pinned is not None and len(pinned):
            cloth = self.state.particle_q.numpy()
            cloth[self._pinned] = pinned
            self.state.particle_q.assign(cloth)
        self.move_body(body_vertices, dt)
        self.stepper.step(self.state, dt)

    def move_body(self, body_vertices: np.ndarray, dt: float) -> None:
        """Move the body alone to (B, 3) within `dt` seconds; its surface gets the velocity that this takes."""
        body = body_vertices.astype(np.float32)
        self.collider.points.assign(body)
        self.collider.velocities.assign((body - self._body) / dt)
        self.collider.refit()
        self._body = body


def _libraries() -> tuple[Any, Any]:
    """Warp and Newton.

    Raises:
        InputError: Newton is not installed.
    """
    return warp_module(), optional("newton", "simulate", "simulation")
