"""Kernel launches that are made many times with the same arguments."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import torch

from fusion.parallel import n_threads, run_all
from fusion.warp_start import warp_module

# Vertices of all frames together that are worth a thread; below, waking it costs more than it does.
_WORTH_A_THREAD = 4000


@dataclass(frozen=True)
class _OfFrames:
    """A Warp array whose first axis is the frame."""

    array: Any


class Recorder:
    """Kernel launches with all their arguments, and Warp views of the tensors that they work on.

    On the CPU, where Warp uses one thread, frames are shared out over several.

    Args:
        like: (T, N, 3), sets device and dtype of all floating-point arguments.
        active: (T,) int32, every kernel's first argument.
    """

    def __init__(self, like: torch.Tensor, active: torch.Tensor) -> None:
        from fusion.energy_kernels import kernels  # noqa: PLC0415 (defining kernels imports warp)

        self._warp, self._like = warp_module(), like
        double = like.dtype == torch.float64
        self._kernels = kernels(64 if double else 32)
        self._real = self._warp.float64 if double else self._warp.float32
        self._vector = self._warp.types.vector(3, self._real)
        self._active = _OfFrames(self.ints(active))
        frames, vertices, _ = like.shape
        threads = 1 if like.is_cuda else min(n_threads(), frames, frames * vertices // _WORTH_A_THREAD)
        ends = np.linspace(0, frames, max(threads, 1) + 1).round().astype(int).tolist()
        self._parts = [slice(first, last) for first, last in itertools.pairwise(ends)]
        # By part, with the arrays, which must outlive the launches.
        self._launches: list[list[tuple[Any, tuple[Any, ...]]]] = [[] for _ in self._parts]

    def __call__(self, kernel: str, columns: int, *arguments: Any) -> None:
        """Add a launch of `kernel` for (frames, columns); with 0 columns there is nothing to do."""
        if not columns:
            return
        for part, launches in zip(self._parts, self._launches, strict=True):
            inputs = tuple(
                value.array[part] if isinstance(value, _OfFrames) else value
                for value in (self._active, *arguments)
            )
            launch = self._warp.launch(
                getattr(self._kernels, kernel),
                dim=(part.stop - part.start, columns),
                inputs=inputs,
                device=self._warp.device_from_torch(self._like.device),
                record_cmd=True,
            )
            launches.append((launch, inputs))

    def run(self) -> None:
        """Launch them all, in order, on torch's stream."""
        stream = None
        if self._like.is_cuda:
            stream = self._warp.stream_from_torch(torch.cuda.current_stream(self._like.device))
        run_all([partial(_launch_all, launches, stream) for launches in self._launches])

    def ints(self, values: np.ndarray | torch.Tensor) -> Any:
        """Integers that all frames share."""
        tensor = torch.as_tensor(values).to(self._like.device, torch.int32).contiguous()
        return self._warp.from_torch(tensor, dtype=self._warp.int32)

    def reals(self, tensor: torch.Tensor) -> Any:
        """Numbers that all frames share; the same memory where device, dtype and layout allow, as for the others."""
        return self._warp.from_torch(tensor.to(self._like).contiguous(), dtype=self._real)

    def vectors(self, tensor: torch.Tensor) -> Any:
        """(..., 3) as an array of vectors that all frames share."""
        return self._warp.from_torch(tensor.to(self._like).contiguous(), dtype=self._vector)

    def frame_reals(self, tensor: torch.Tensor) -> _OfFrames:
        """(T, ...) numbers."""
        return _OfFrames(self.reals(tensor))

    def frame_vectors(self, tensor: torch.Tensor) -> _OfFrames:
        """(T, ..., 3) as an array (T, ...) of vectors."""
        return _OfFrames(self.vectors(tensor))


def _launch_all(launches: list[tuple[Any, tuple[Any, ...]]], stream: Any) -> None:
    for launch, _ in launches:
        launch.launch(stream=stream)
