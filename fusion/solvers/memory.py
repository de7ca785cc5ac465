"""What the last steps tell of an energy's curvature: the two loops of L-BFGS, by few passes over the vertices."""

from __future__ import annotations

import torch

from fusion.solvers.contact import ConstrainedStep
from fusion.solvers.energy import Energy
from fusion.solvers.recorder import Recorder, frames_last, lanes_on

PAIRS = 2  # steps remembered; more lower the energy no further in as many steps, and cost
# Fraction of the slope along a step by which it must have changed at its end, for the step to be remembered.
_CURVATURE = 1e-4
_BLOCK = 32  # vertices whose products are summed by one thread


class StepMemory:
    """The last steps s and changes of gradient y, and the inverse Hessian that they suggest.

    In turn: write `gradient`, `prepare`, solve the system, `lead`, and, when the energy has been evaluated where the
    step ended, `add`.

    Args:
        energy: of T frames.
        step: its `direction` is what `lead` makes; its `vertices` and `gradient` are where the step begins, and, after
            `add`, where it ended.

    Attributes:
        gradient: (T, N, 3), what the next step is to descend.
        right, solution: (T, N, 3), what the system is to be solved for, and its solution.
    """

    def __init__(self, energy: Energy, step: ConstrainedStep) -> None:
        like, self._step = energy.vertices, step
        frames, count, _ = like.shape
        self.gradient, self.right, self.solution = (frames_last(*like.shape, like=like) for _ in range(3))
        self._steps, self._changes = (frames_last(frames, PAIRS, count, 3, like=like) for _ in range(2))
        self._factors = frames_last(frames, PAIRS, like=like)
        self._slope = like.new_zeros(frames, dtype=torch.float64)
        self._order: list[int] = []  # pairs by where they are kept, oldest first
        self._place = torch.zeros(1, dtype=torch.int32, device=like.device)
        # (T, PAIRS, PAIRS) step times change; (T, PAIRS) 1 / that of a pair, or 0 where it is not to be used, and what
        # the first loop has found.
        self._by_change = like.new_zeros(frames, PAIRS, PAIRS, dtype=torch.float64)
        self._inverse, self._alphas = (like.new_zeros(frames, PAIRS, dtype=torch.float64) for _ in range(2))
        self._products = {
            name: _Products(energy, many, one)
            for name, (many, one) in {
                "steps, gradient": (self._steps, self.gradient),
                "changes, solution": (self._changes, self.solution),
                "direction, gradient": (step.direction[:, None], self.gradient),
            }.items()
        }
        self._make_right, self._make_direction, self._remember = (
            Recorder(like, energy.busy) for _ in range(3)
        )
        for record, scale, base, others, made in (
            (self._make_right, 1.0, self.gradient, self._changes, self.right),
            (self._make_direction, -1.0, self.solution, self._steps, step.direction),
        ):
            factors, several = record.frames(self._factors), record.frames(others)
            record("combine", count, scale, record.frames(base), factors, several, record.frames(made))
        record = self._remember
        for tensors in (
            (energy.vertices, step.vertices, self.right, self._steps),
            (energy.gradient, step.gradient, self.gradient, self._changes),
        ):
            record("differ", count, record.ints(self._place), *map(record.frames, tensors))

    def prepare(self) -> None:
        """Make the right-hand side: the first loop, newest pair first."""
        if self._order:
            along = self._products["steps, gradient"]()
            for place in reversed(self._order):
                self._alphas[:, place] = along[:, place] * self._inverse[:, place]
                along = along - self._alphas[:, place, None] * self._by_change[:, :, place]
        self._factors.copy_(-self._alphas)
        self._make_right.run()

    def lead(self) -> None:
        """Let the step's direction follow from the solution: the second loop, oldest pair first."""
        lengths = torch.zeros_like(self._alphas)
        if self._order:
            along = self._products["changes, solution"]()
            for place in self._order:
                lengths[:, place] = self._alphas[:, place] - along[:, place] * self._inverse[:, place]
                along = along + lengths[:, place, None] * self._by_change[:, place]
        self._factors.copy_(-lengths)
        self._make_direction.run()

    def slope(self) -> torch.Tensor:
        """(T,) float64: direction times gradient."""
        self._slope = self._products["direction, gradient"]()[:, 0]
        return self._slope

    def add(self) -> None:
        """Keep the step to the energy's vertices; frames in which it has no positive curvature keep nothing."""
        place = len(self._order) if len(self._order) < PAIRS else self._order.pop(0)
        self._order.append(place)
        self._place.fill_(place)
        self._remember.run()
        products = self._products["steps, gradient"]()
        product = products[:, place]
        good = product > _CURVATURE * (self._step.length * self._slope).abs()
        self._by_change[:, :, place] = products
        self._inverse[:, place] = torch.where(good, 1 / torch.where(good, product, 1), 0)


class _Products:
    """Products of several (T, K, N, 3) with one (T, N, 3), frame by frame."""

    def __init__(self, energy: Energy, many: torch.Tensor, one: torch.Tensor) -> None:
        frames, several, count, _ = many.shape
        blocks = -(-count // _BLOCK)
        # Of whole groups, so that sums are taken in the same order whatever frames are in them.
        self._frames, whole = frames, len(energy.busy) * lanes_on(one.device)
        self._blocks = frames_last(whole, blocks, several, like=one)
        self._record = record = Recorder(one, energy.busy)
        arguments = record.frames(many), record.frames(one), record.frames(self._blocks)
        record("products", (blocks, several), count, _BLOCK, *arguments)

    def __call__(self) -> torch.Tensor:
        """(T, K) float64."""
        self._record.run()
        return self._blocks.sum(1, dtype=torch.float64)[: self._frames]
