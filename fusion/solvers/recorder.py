"""Kernel launches that are made many times with the same arguments, and how their tensors lie in memory."""

from __future__ import annotations

import math
from collections import ChainMap
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import torch

from fusion.warp_start import launch, warp_module

_LANES = 8  # frames side by side on the CPU: a vector of float32 with AVX2; on CUDA threads do it


def frames_last(*shape: int, like: torch.Tensor) -> torch.Tensor:
    """Zeros of shape (T, ...) in memory as (..., T), T filled up to whole groups; dtype and device of `like`."""
    frames, *rest = shape
    groups = -(-max(frames, 1) // lanes_on(like.device))
    buffer = like.new_zeros(*rest, groups * lanes_on(like.device))
    return buffer.movedim(-1, 0)[:frames]


@cache
def _kernels(bits: int, lanes: int) -> SimpleNamespace:
    """All kernels for float32 or float64 (`bits` 32 or 64) and groups of so many frames."""
    # Defining kernels imports warp.
    from fusion.solvers.descent_kernels import descent_kernels  # noqa: PLC0415
    from fusion.solvers.energy_kernels import kernels  # noqa: PLC0415
    from fusion.solvers.memory_kernels import memory_kernels  # noqa: PLC0415
    from fusion.solvers.sum_kernels import sum_kernels  # noqa: PLC0415

    made = (each(bits, lanes) for each in (kernels, descent_kernels, memory_kernels, sum_kernels))
    return SimpleNamespace(**ChainMap(*map(vars, made)))


def lanes_on(device: torch.device) -> int:
    """How many frames lie side by side."""
    return _LANES if device.type == "cpu" else 1


class Recorder:
    """Kernel launches with all their arguments, and Warp views of the tensors that they work on.

    Args:
        like: (T, N, 3), sets device and dtype of all floating-point arguments.
        busy: (G,) int32, whether a group of frames takes part; every kernel's first argument.
    """

    def __init__(self, like: torch.Tensor, busy: torch.Tensor) -> None:
        self._warp, self._like, self._groups = warp_module(), like, len(busy)
        bits, self._lanes = (64 if like.dtype == torch.float64 else 32), lanes_on(like.device)
        self._kernels = _kernels(bits, self._lanes)
        self._real = self._warp.float64 if bits == 64 else self._warp.float32
        self._lane = self._warp.types.vector(self._lanes, self._real)
        self._busy = self.ints(busy)
        self._launches: list[tuple[Any, tuple[Any, ...]]] = []  # with the arrays, which must outlive them

    def __call__(self, kernel: str, columns: int | tuple[int, ...], *arguments: Any) -> None:
        """Add a launch of `kernel` for (columns, groups); with 0 columns there is nothing to do."""
        dim = (*columns, self._groups) if isinstance(columns, tuple) else (columns, self._groups)
        if 0 in dim:
            return
        recorded = launch(
            getattr(self._kernels, kernel),
            dim=dim,
            inputs=[self._busy, *arguments],
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
        """Numbers that are the same for all frames as an array of Warp's."""
        return self._warp.from_torch(tensor.to(self._like).contiguous(), dtype=self._real)

    def vectors(self, tensor: torch.Tensor) -> Any:
        """(..., 3), the same for all frames, as an array of vectors."""
        vector = self._warp.types.vector(3, self._real)
        return self._warp.from_torch(tensor.to(self._like).contiguous(), dtype=vector)

    def frames(self, tensor: torch.Tensor) -> Any:
        """(T, ...) as an array (..., G) of vectors, one number a frame; the same memory if made by `frames_last`."""
        whole = self._whole(tensor)
        if whole is None:
            copied = frames_last(*tensor.shape, like=self._like)
            copied.copy_(tensor)
            whole = self._whole(copied)
        assert whole is not None
        return self._warp.from_torch(whole, dtype=self._lane)

    def doubles(self, tensor: torch.Tensor) -> Any:
        """(..., G · lanes) float64 as an array (..., G) of vectors, one number a frame, in the same memory."""
        lanes = tensor.view(*tensor.shape[:-1], self._groups, self._lanes)
        return self._warp.from_torch(lanes, dtype=self._warp.types.vector(self._lanes, self._warp.float64))

    def _whole(self, tensor: torch.Tensor) -> torch.Tensor | None:
        """The (..., G, lanes) buffer behind a tensor of `frames_last`; None for any other."""
        padded = self._groups * self._lanes
        shape = *tensor.shape[1:], padded
        strides = tuple(math.prod(shape[axis + 1 :]) for axis in range(len(shape)))
        same_kind = tensor.dtype == self._like.dtype and tensor.device == self._like.device
        if not same_kind or tensor.stride() != (strides[-1], *strides[:-1]):
            return None
        start, size = tensor.storage_offset(), tensor.untyped_storage().nbytes() // tensor.element_size()
        if start + math.prod(shape) > size or (tensor.ndim == 1 and (start or size != padded)):
            return None  # what follows in memory is another's
        lanes: torch.Tensor = tensor.as_strided(shape, strides, start).view(
            *shape[:-1], self._groups, self._lanes
        )
        return lanes
