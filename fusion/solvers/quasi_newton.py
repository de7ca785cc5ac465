"""Quasi-Newton descent around a prefactorised system: every step is one back-substitution per frame and axis.

The first step is that of a local-global solver: the gradient of the edge term is what remains after each edge has been
scaled to its rest length by itself, and the system distributes it over the cloth. From then on the last few steps
correct the system's curvature (Liu, Bouaziz and Kavan 2017, "Quasi-Newton methods for real-time simulation of
hyperelastic materials").
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from fusion.solvers.contact import ConstrainedStep, Contact
from fusion.solvers.energy import Energy
from fusion.solvers.memory import StepMemory
from fusion.solvers.system import System

_SUFFICIENT = 1e-4  # fraction of the decrease that the gradient promises which a step must reach (Armijo)
_HALVINGS = 12  # of a step that does not; after the last the frame is finished
_STEPS_JUDGED = 3  # over which the decrease is averaged: now and then a step is small


@dataclass(frozen=True, eq=False)
class Descent:
    """What `descend` returns.

    Args:
        vertices: (T, N, 3) metres.
        iterations: (T,) int64, steps taken.
        history: (K, T, 4) float64, the energy's terms at the start and after each of the K - 1 steps of the longest
            frame.
        depths: (K, T), mean depth of the vertices in the obstacle, metres: at the start, as last asked for, at the end;
            None without obstacle.
    """

    vertices: torch.Tensor
    iterations: torch.Tensor
    history: torch.Tensor
    depths: torch.Tensor | None


def descend(
    energy: Energy,
    system: System,
    start: torch.Tensor,
    *,
    steps: int,
    tolerance: float,
    loose: torch.Tensor | None = None,
    contact: Contact | None = None,
) -> Descent:
    """Minimise the energy outside of the obstacle; every frame by itself.

    A vertex that touches the obstacle and is pushed into it slides along its tangent plane: an active set, which
    takes the place of the collision term (exact for a weight above the push).

    Args:
        energy: of T frames.
        system: an estimate of its Hessian, the better the sooner.
        start: (T, N, 3) metres, dtype and device of the energy.
        steps: at most.
        tolerance: mean relative decrease of the energy in a step below which a frame is finished.
        loose: (N,) bool, vertices that may move; None for all.
        contact: the obstacle.
    """
    return _Run(energy, system, loose, contact).run(start, steps, tolerance)


class _Run:
    """State of one `descend` of T independent problems, a frame each."""

    def __init__(
        self, energy: Energy, system: System, loose: torch.Tensor | None, contact: Contact | None
    ) -> None:
        self._energy, self._contact = energy, contact
        self._constrained = ConstrainedStep(energy, loose, contact)
        self._frames = len(energy.vertices)
        self._memory = memory = StepMemory(energy, self._constrained)
        self._solve = system.solver(memory.right, memory.solution, energy.busy)
        self._going = np.ones(self._frames, bool)
        self._value = np.zeros(self._frames)
        self._factors = energy.factors.cpu().numpy()
        self._active, self._length = self._going, np.ones(self._frames)  # as the kernels have them

    def run(self, start: torch.Tensor, steps: int, tolerance: float) -> Descent:
        iterations = np.zeros(self._frames, np.int64)
        contact, constrained = self._contact, self._constrained
        constrained.vertices.copy_(start)
        history = [self._restart()]
        values = [self._value]
        depths = [contact.depth] if contact else []
        for step in range(steps):
            if contact is not None and step and contact.due(step):
                self._restart()
                values = [self._value]
            history.append(self._step())
            values.append(self._value)
            iterations += self._going
            if contact is not None:
                depths.append(contact.depth)
            if len(values) > _STEPS_JUDGED:
                before = values[-1 - _STEPS_JUDGED]
                self._going = self._going & (
                    before - self._value > _STEPS_JUDGED * tolerance * np.abs(before)
                )
            if not self._going.any():
                break
        if contact is not None:
            contact.measure(constrained.vertices)
            depths[-1] = contact.depth
        return Descent(
            constrained.vertices.contiguous(),
            torch.from_numpy(iterations).to(start.device),
            torch.from_numpy(np.stack(history)).to(start.device),
            torch.stack(depths) if depths else None,
        )

    def _restart(self) -> NDArray[np.float64]:
        """Ask where the obstacle is, leave it, and evaluate there; frames that are finished stay as they are."""
        constrained, energy = self._constrained, self._energy
        if self._contact is not None:
            going = torch.from_numpy(self._going).to(energy.vertices.device)
            self._contact.update_planes(constrained.vertices, going)
        self._activate(self._going)
        terms = self._evaluate(np.zeros(self._frames))
        self._value = self._weighted(terms)
        constrained.vertices.copy_(energy.vertices)
        constrained.gradient.copy_(energy.gradient)
        return terms

    def _step(self) -> NDArray[np.float64]:
        """One step of all problems that are still going; the terms after it."""
        self._activate(self._going)
        self._memory.prepare()
        self._solve()
        # Projected at its end, so that it descends whatever walls the remembered steps were taken at.
        self._memory.lead()
        terms, self._value, lowered = self._line_search(self._memory.slope().cpu().numpy())
        self._going = self._going & lowered
        self._memory.add()
        return terms

    def _line_search(
        self, slope: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """Halve each problem's step until the energy falls enough: terms and energies there, and whether they did (T,).

        Those take part afterwards that did before.
        """
        length, trying = np.ones(self._frames), self._going
        for halving in range(_HALVINGS + 1):
            if halving == _HALVINGS:  # nowhere to go within rounding: stay
                length = np.where(trying, 0, length)
            self._activate(trying)
            terms = self._evaluate(length)
            value = self._weighted(terms)
            failed = trying & ~(value <= self._value + _SUFFICIENT * length * slope)
            if not failed.any():
                break
            trying = failed
            length = np.where(failed, 0.5 * length, length)
        self._activate(self._going)
        return terms, value, length > 0

    def _activate(self, frames: NDArray[np.bool_]) -> None:
        """Let these frames (T,) take part."""
        if not np.array_equal(frames, self._active):
            self._energy.activate(torch.from_numpy(frames).to(self._energy.vertices.device))
            self._active = frames

    def _evaluate(self, length: NDArray[np.float64]) -> NDArray[np.float64]:
        """(T, 4) the terms at the end of steps of so many directions (T,)."""
        if not np.array_equal(length, self._length):
            self._constrained.length.copy_(torch.from_numpy(length))
            self._length = length
        self._constrained.advance()
        return self._energy.evaluate().cpu().numpy()

    def _weighted(self, terms: NDArray[np.float64]) -> NDArray[np.float64]:
        """(T, 4) to the energies of the frames (T,)."""
        weighted: NDArray[np.float64] = (terms * self._factors).sum(-1)
        return weighted
