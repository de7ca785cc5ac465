"""The exponential moving average of a model's weights over the steps of its training."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch
from torch import Tensor, nn


class WeightAverage:
    """The mean of the weights after each step, the latest counting most.

    Args:
        model: whose weights, which are where the mean begins.
        decay: what remains, after a step, of the mean before it.
    """

    def __init__(self, model: nn.Module, decay: float) -> None:
        self._decay = decay
        self._weights = dict(model.named_parameters())
        self._mean = {
            name: weight.detach().clone() if weight.requires_grad else weight.detach()
            for name, weight in self._weights.items()
        }

    @torch.no_grad()
    def update(self, step: int) -> None:
        """Take in the weights after step 1, 2, ...

        Early steps count more than the decay says: the random weights in the beginning shall not stay in the mean.
        """
        decay = min(self._decay, (1 + step) / (10 + step))
        for name, mean in self._mean.items():
            if self._weights[name].requires_grad:  # the others are their own mean, in the same memory
                mean.lerp_(self._weights[name], 1 - decay)

    @contextmanager
    def in_place(self) -> Iterator[None]:
        """Within, the model has the mean for its weights."""
        self._swap()
        try:
            yield
        finally:
            self._swap()

    def _swap(self) -> None:
        for name, weight in self._weights.items():
            weight.data, self._mean[name] = self._mean[name], weight.data

    def tensors(self) -> dict[str, Tensor]:
        """The mean by the parameters' names."""
        return dict(self._mean)

    @torch.no_grad()
    def load(self, mean: dict[str, Tensor]) -> None:
        """Go on from a mean that `tensors` gave."""
        for name, value in mean.items():
            self._mean[name].copy_(value)
