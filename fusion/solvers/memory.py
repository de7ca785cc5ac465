"""What the last steps tell of an energy's curvature: the two loops of L-BFGS, by few passes over the vertices."""

from __future__ import annotations

import torch

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

    In turn: `project_gradient` of the step, `prepare`, solve the system, `lead`, and, when the energy has been
    evaluated where the step ended, `add`.

    Args:
        energy: of T frames.
        step: its `direction` is what `lead` makes, which is to descend its `open_gradient`; its `vertices` and
            `gradient` are where the step begins, and, after `add`, where it ended.

    Attributes:
        right, solution: (T, N, 3), what the system is to be solved for, and its solution.
    """

    def __init__(self, energy: Energy, step: ConstrainedStep) -> None:
        like, self._step = energy.vertices, step
        frames, count, _ = like.shape
        self.right, self.solution = (frames_last(*like.shape, like=like) for _ in range(2))
        gradient = step.open_gradient  # and, once it has been used, how the gradient changes
        self._steps, self._changes = (frames_last(frames, PAIRS, count, 3, like=like) for _ in range(2))
        self._factors = frames_last(frames, PAIRS, like=like)
        self._order: list[int] = []  # pairs by where they are kept, oldest first
        self._place, self._places = (
            torch.full((length,), -1, dtype=torch.int32, device=like.device) for length in (1, PAIRS)
        )
        self._products = {
            name: _Products(energy, many, one)
            for name, (many, one) in {
                "steps, gradient": (self._steps, gradient),
                "changes, solution": (self._changes, self.solution),
                "direction, gradient": (step.direction[:, None], gradient),
            }.items()
        }
        self._make_right, self._make_direction, self._remember = (
            Recorder(like, energy.busy) for _ in range(3)
        )
        for record, scale, base, others, made in (
            (self._make_right, 1.0, gradient, self._changes, self.right),
            (self._make_direction, -1.0, self.solution, self._steps, step.direction),
        ):
            factors, several = record.frames(self._factors), record.frames(others)
            record("combine", count, scale, record.frames(base), factors, several, record.frames(made))
        record = self._remember
        for tensors in (
            (energy.vertices, step.vertices, self.right, self._steps),
            (energy.gradient, step.gradient, gradient, self._changes),
        ):
            record("differ", count, record.ints(self._place), *map(record.frames, tensors))
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
        along_steps, along_changes, along_direction = (
            record.frames(products.blocks) for products in self._products.values()
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
        if self._order:
            self._products["steps, gradient"].run()
            self._first.run()
        self._make_right.run()

    def lead(self) -> None:
        """Let the step's direction follow from the solution: the second loop, oldest pair first."""
        if self._order:
            self._products["changes, solution"].run()
            self._second.run()
        self._make_direction.run()

    def slope(self) -> torch.Tensor:
        """(T,) float64: direction times gradient."""
        return self._products["direction, gradient"]()[:, 0]

    def add(self) -> None:
        """Keep the step to the energy's vertices; frames in which it has no positive curvature keep nothing."""
        place = len(self._order) if len(self._order) < PAIRS else self._order.pop(0)
        self._order.append(place)
        self._place.fill_(place)
        self._places[PAIRS - len(self._order) :] = torch.tensor(self._order, dtype=torch.int32)
        self._remember.run()
        self._products["steps, gradient"].run()
        self._judge.run()


class _Products:
    """Products of several (T, K, N, 3) with one (T, N, 3), frame by frame."""

    def __init__(self, energy: Energy, many: torch.Tensor, one: torch.Tensor) -> None:
        frames, several, count, _ = many.shape
        blocks = -(-count // _BLOCK)
        # Of whole groups, so that sums are taken in the same order whatever frames are in them.
        self._frames, whole = frames, len(energy.busy) * lanes_on(one.device)
        self.blocks = frames_last(whole, blocks, several, like=one)
        record = Recorder(one, energy.busy)
        arguments = record.frames(many), record.frames(one), record.frames(self.blocks)
        record("products", (blocks, several), count, _BLOCK, *arguments)
        self.run = record.run

    def __call__(self) -> torch.Tensor:
        """(T, K) float64."""
        self.run()
        return self.blocks.sum(1, dtype=torch.float64)[: self._frames]
