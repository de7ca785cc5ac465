"""The processes that train together, as `torchrun` or `accelerate launch` starts them; usually there is one.

Each has all weights and computes the gradients of its own frames; their mean is taken once a step. That is done here,
not by a wrapper around the networks: a step may show them several outfits, each with a backward pass of its own, and
not as many in each process.
"""

from __future__ import annotations

import atexit
import logging
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import timedelta

import torch
from torch import Tensor

from imgtransfer.running.task import WORKER_VARIABLE
from render import InputError

_PATIENCE = timedelta(hours=3)  # while the main process alone fuses or writes, the others wait


def launched() -> bool:
    """Whether this process is one of several that were started to train together."""
    variables = ("RANK", "LOCAL_RANK", "WORLD_SIZE")
    return all(name in os.environ for name in variables) and int(os.environ["WORLD_SIZE"]) > 1


def is_main() -> bool:
    """Whether this process is the one that writes files and tells of the run."""
    return not launched() or os.environ["RANK"] == "0"


@dataclass(frozen=True)
class Processes:
    """This process among those that train together.

    Args:
        device: that this one computes on.
        count: how many there are.
        number: this one's, from 0.
    """

    device: torch.device
    count: int = 1
    number: int = 0

    @classmethod
    def joined(cls, wanted: str) -> Processes:
        """Meet the others, where there are any.

        Args:
            wanted: `training.device`.

        Raises:
            InputError: no such device.
        """
        device = _device(wanted)
        if not launched():
            return cls(torch.device(device))
        from accelerate.state import PartialState  # noqa: PLC0415 (nobody who trains alone waits for it)

        state = PartialState(cpu=device == "cpu", timeout=_PATIENCE)
        atexit.register(state.destroy_process_group)
        if not state.is_main_process:  # it would say what the main one says
            os.environ[WORKER_VARIABLE] = "1"
            for layer in ("render", "fusion", "imgtransfer"):
                logging.getLogger(layer).setLevel(logging.ERROR)
        return cls(state.device, state.num_processes, state.process_index)

    @property
    def main(self) -> bool:
        """Whether this is the one that writes files and tells of the run."""
        return self.number == 0

    def parts(self, accumulate: int) -> range:
        """Which of a step's batches this process computes, of `accumulate` for each process."""
        return range(self.number, self.count * accumulate, self.count)

    def total(self, values: Mapping[str, float]) -> dict[str, float]:
        """Sums over the processes; each gives the same names in the same order."""
        if self.count == 1:
            return dict(values)
        tensor = torch.tensor(list(values.values()), dtype=torch.float64, device=self.device)
        return dict(zip(values, self._reduced(tensor, "sum").tolist(), strict=True))

    def mean(self, values: Mapping[str, float]) -> dict[str, float]:
        """Means over the processes."""
        return {name: value / self.count for name, value in self.total(values).items()}

    def any(self, flag: bool) -> bool:
        """Whether any process says so; all wait for each other here."""
        return self.total({"flag": float(flag)})["flag"] > 0

    def average_gradients(self, parameters: Iterable[Tensor]) -> None:
        """Put the mean over the processes in place of each gradient; all have gradients of the same parameters."""
        if self.count == 1:
            return
        gradients = [parameter.grad for parameter in parameters if parameter.grad is not None]
        mean = self._reduced(torch.cat([gradient.flatten() for gradient in gradients]), "mean")
        sizes = [gradient.numel() for gradient in gradients]
        for gradient, part in zip(gradients, mean.split(sizes), strict=True):
            gradient.copy_(part.view_as(gradient))

    def take_from_main(self, tensors: Iterable[Tensor]) -> None:
        """Put the main process' values in place of this one's: what all computed alike may differ by rounding."""
        if self.count == 1:
            return
        from accelerate.utils import broadcast  # noqa: PLC0415

        for tensor in tensors:
            tensor.copy_(broadcast(tensor.contiguous().to(self.device)))

    def _reduced(self, tensor: Tensor, reduction: str) -> Tensor:
        from accelerate.utils import reduce  # noqa: PLC0415

        result: Tensor = reduce(tensor, reduction)
        return result


def _device(wanted: str) -> str:
    if wanted == "auto":
        return "cuda" if torch.cuda.is_available() else "cpu"
    if wanted == "cuda" and not torch.cuda.is_available():
        raise InputError("training.device is cuda, but torch finds no CUDA device; use auto or cpu")
    return wanted
