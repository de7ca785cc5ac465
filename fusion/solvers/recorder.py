"""Kernel launches that are made many times with the same arguments."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from fusion.warp_start import launch, warp_module


class Recorder:
    """Kernel launches with all their arguments, and Warp views of the tensors that they work on.

    Args:
        like: (T, N, 3), sets device and dtype of all floating-point arguments.
        active: (T,) int32, every kernel's first argument.
    """

    def __init__(self, like: torch.Tensor, active: torch.Tensor) -> None:
        from fusion.solvers.energy_kernels import kernels  # noqa: PLC0415 (defining kernels imports warp)

        self._warp, self._like, self._frames = warp_module(), like, len(like)
        double = like.dtype == torch.float64
        self._kernels = kernels(64 if double else 32)
        self._real = self._warp.float64 if double else self._warp.float32
        self._vector = self._warp.types.vector(3, self._real)
        self._active = self.ints(active)
        self._launches: list[tuple[Any, tuple[Any, ...]]] = []  # with the arrays, which must outlive them

    def __call__(self, kernel: str, columns: int, *arguments: Any) -> None:
        """Add a launch of `kernel` for (frames, columns); with 0 columns there is nothing to do."""
        if not columns:
            return
        recorded = launch(
            getattr(self._kernels, kernel),
            dim=(self._frames, columns),
            inputs=[self._active, *arguments],
            device=self._warp.device_from_torch(self._like.device),
            record_cmd=True,
        )
        self._launches.append((recorded, arguments))

    def run(self) -> None:
        """Launch them all, in order, on torch's stream."""
        stream = None
        if self._like.is_cuda:
            stream = self._warp.stream_from_torch(torch.cuda.current_stream(self._like.device))
        for recorded, _ in self._launches:
            recorded.launch(stream=stream)

    def ints(self, values: np.ndarray | torch.Tensor) -> Any:
        """The numbers as an array of Warp's."""
        tensor = torch.as_tensor(values).to(self._like.device, torch.int32).contiguous()
        return self._warp.from_torch(tensor, dtype=self._warp.int32)

    def reals(self, tensor: torch.Tensor) -> Any:
        """The numbers as an array of Warp's; the same memory where device, dtype and layout allow."""
        return self._warp.from_torch(tensor.to(self._like).contiguous(), dtype=self._real)

    def vectors(self, tensor: torch.Tensor) -> Any:
        """(..., 3) as an array of vectors; the same memory where device, dtype and layout allow."""
        return self._warp.from_torch(tensor.to(self._like).contiguous(), dtype=self._vector)
