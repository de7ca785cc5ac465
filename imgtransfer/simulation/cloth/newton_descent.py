"""Newton's own vertex block descent: what `ClothDescent` is tested against and timed against."""

from __future__ import annotations

from typing import Any

from imgtransfer.simulation.cloth.descent import CONTACT_GAP
from imgtransfer.simulation.config import ClothConfig
from render.extras import optional


class NewtonDescent:
    """Steps a cloth in time with SolverVBD.

    Args:
        model: a Newton model of one cloth and one shape, the body.
        material: see `ClothConfig`; the cloth keeps half its `thickness` from itself.
        iterations: of descent, a step.
        self_contact: False leaves only the contact with the body, as `ClothDescent` computes it.
    """

    def __init__(
        self, model: Any, material: ClothConfig, iterations: int, *, self_contact: bool = True
    ) -> None:
        newton = optional("newton", "simulate", "simulation")
        self._pipeline = newton.CollisionPipeline(model, soft_contact_gap=CONTACT_GAP)
        self._contacts = self._pipeline.contacts()
        base = newton.solvers.SolverBase
        slot = base.CollisionSlot.SOFT_SELF_CONTACT
        apart = material.thickness / 2
        # A vertex may go only so far as the detection looked. Detecting anew before every iteration lets cloth follow
        # a fast body; detecting once a step would hold it back.
        extra: dict[str, Any] = {
            "particle_enable_self_contact": True,
            "particle_self_contact_margin": apart,
            "particle_self_contact_gap": 2 * apart,
            "particle_rest_shape_contact_exclusion_radius": 2 * apart,
            "collision_frequency_type": {slot: base.CollisionFrequencyType.ITERATIONS},
            "collision_frequency": {slot: 1},
        }
        self._solver = newton.solvers.SolverVBD(
            model, iterations=iterations, **(extra if self_contact else {})
        )
        self._control = model.control()
        self._next = model.state()

    def step(self, state: Any, dt: float) -> None:
        """Move the particles of a Newton state in place by `dt` seconds; the body stands where it will be."""
        state.clear_forces()
        self._pipeline.collide(state, self._contacts)
        self._solver.step(state, self._next, self._control, self._contacts, dt)
        state.assign(self._next)
