"""What the last steps tell of an energy's curvature: the two loops of L-BFGS, by few passes over the vertices."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from fusion.solvers.contact import ConstrainedStep
from fusion.solvers.energy import Energy
from fusion.solvers.recorder import Recorder, frames_last, lanes_on

# Steps remembered. More lower the energy no further in as many steps, and cost; with fewer, the cloth drifts farther
# from predicted positions on the way to an energy as low.
PAIRS = 3
# Fraction of the slope along a step by which it must have changed at its end, for the step to be remembered.
_CURVATURE = 1e-4
_BLOCK = 32  # vertices whose products are summed by one thread


class StepMemory:
    """The last steps s and changes of gradient y, and the inverse Hessian that they suggest.

    In turn: `prepare`, solve the system, `lead`, and, when the energy has been evaluated where the step ended, `add`.

    Args:
        energy: of T frames.
        step: its `vertices` and `gradient` are where the step begins, and, after `add`, where it ended; `prepare` makes
            its `open_gradient`, and `lead` its `direction`, which is to descend that.

    Attributes:
        right, solution: (T, N, 3), what the system is to be solved for, and its solution.
    """

    def __init__(self, energy: Energy, step: ConstrainedStep) -> None:
        like = energy.vertices
        frames, count, _ = like.shape
        self.right, self.solution = (frames_last(*like.shape, like=like) for _ in range(2))
        self._steps, self._changes = (frames_last(frames, PAIRS, count, 3, like=like) for _ in range(2))
        self._factors = frames_last(frames, PAIRS, like=like)
        self._count = 0  # of the steps that were added
        self._states = torch.from_numpy(_states()).to(like.device)
        self._state = torch.full((PAIRS + 1,), -1, dtype=torch.int32, device=like.device)
        self._place, self._places = self._state[:1], self._state[1:]
        # Sums by blocks of vertices, of whole groups: taken in the same order whatever frames are in them.
        parts, whole = -(-count // _BLOCK), len(energy.busy) * lanes_on(like.device)
        self._along_steps, self._along_changes, self._slopes = (
            frames_last(whole, parts, several, like=like) for several in (PAIRS, PAIRS, 1)
        )
        self._open, self._make_right, self._along, self._lead, self._remember = (
            Recorder(like, energy.busy) for _ in range(5)
        )
        record = self._open
        steps, changes, factors, right, solution, open_gradient, direction = map(
            record.frames,
            (
                self._steps,
                self._changes,
                self._factors,
                self.right,
                self.solution,
                step.open_gradient,
                step.direction,
            ),
        )
        along_steps, along_changes, slopes = map(
            record.frames, (self._along_steps, self._along_changes, self._slopes)
        )
        limits, blocks = step.limits(record), (parts,)
        record("open_gradient", blocks, count, _BLOCK, *limits, steps, open_gradient, along_steps)
        self._make_right("combine", count, open_gradient, factors, changes, right)
        self._along("products", (parts, PAIRS), count, _BLOCK, changes, solution, along_changes)
        led = solution, factors, steps, open_gradient, direction, slopes
        self._lead("lead", blocks, count, _BLOCK, *limits, *led)
        ends = (energy.vertices, step.vertices, energy.gradient, step.gradient)
        kept = *map(record.frames, ends), steps, changes, along_steps
        self._remember("remember", blocks, count, _BLOCK, record.ints(self._place), *kept)
        self._record_loops(energy, step)

    def _record_loops(self, energy: Energy, step: ConstrainedStep) -> None:
        """The small sums between the passes over the vertices."""
        self._first, self._second, self._judge = (Recorder(energy.vertices, energy.busy) for _ in range(3))
        record = self._first
        order, factors = record.ints(self._places), record.frames(self._factors)
        # Step times change; 1 / that of a pair, or 0 where it is not to be used; what the loops have found.
        whole = len(energy.busy) * lanes_on(energy.vertices.device)
        double = energy.vertices.new_zeros(PAIRS, PAIRS + 3, whole, dtype=torch.float64)
        by_change = record.doubles(double[:, :PAIRS].contiguous())
        inverse, alphas, lengths = (record.doubles(double[:, PAIRS + k].contiguous()) for k in range(3))
        along_steps, along_changes, along_direction = map(
            record.frames, (self._along_steps, self._along_changes, self._slopes)
        )
        record("first_loop", (), order, along_steps, inverse, by_change, alphas, factors)
        self._second("second_loop", (), order, along_changes, inverse, by_change, alphas, lengths, factors)
        self._judge(
            "judge_pair",
            (),
            record.ints(self._place),
            _CURVATURE,
            along_steps,
            along_direction,
            record.frames(step.length),
            inverse,
            by_change,
        )

    def prepare(self) -> None:
        """Make the right-hand side: the first loop, newest pair first."""
        self._open.run()
        if self._count:
            self._first.run()
        self._make_right.run()

    def lead(self) -> None:
        """Let the step's direction follow from the solution: the second loop, oldest pair first."""
        if self._count:
            self._along.run()
            self._second.run()
        self._lead.run()

    def slope(self) -> torch.Tensor:
        """(T,) float64: direction times gradient."""
        return self._slopes.sum((1, 2), dtype=torch.float64)[: len(self._factors)]

    def add(self) -> None:
        """Keep the step to the energy's vertices; frames in which it has no positive curvature keep nothing."""
        self._state.copy_(self._states[self._count % PAIRS if self._count >= PAIRS else self._count - PAIRS])
        self._count += 1
        self._remember.run()
        self._judge.run()


def _states() -> NDArray[np.int32]:
    """(2 PAIRS, 1 + PAIRS) where the newest pair is kept, and all from the oldest to the newest, -1 for those that
    there are not yet: for each place once all are there, and, counted from the end, while the first ones come."""
    filled = [[new, *((new + 1 + k) % PAIRS for k in range(PAIRS))] for new in range(PAIRS)]
    filling = [[new, *(k if k >= 0 else -1 for k in range(new + 1 - PAIRS, new + 1))] for new in range(PAIRS)]
    return np.array(filled + filling, np.int32)
