"""Signed distance from points to a moving body mesh, on Warp's mesh queries."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

import numpy as np
import torch

from render import InputError
from render.mesh import check_faces, check_finite

Sign = Literal["winding", "normal"]


@dataclass(frozen=True, eq=False)
class SdfQuery:
    """What `BodySdf.query` found for points (..., N, 3); plain values, without autograd.

    Args:
        distance: (..., N) float32, metres, negative inside the body.
        direction: (..., N, 3) float32 unit vectors, the gradient of the distance: away from the body.
        closest: (..., N, 3) float32, metres, the closest point of the body's surface.
    """

    distance: torch.Tensor
    direction: torch.Tensor
    closest: torch.Tensor


class BodySdf:
    """Signed distance to one pose of a body, or to one pose per frame of a batch (equation 7 of the paper).

    The search structure is built at the first `update` and refitted at later ones, since the faces never
    change. Queries compute in float32, whatever the dtype of the points.

    Args:
        faces: (G, 3) integers, counter-clockwise seen from outside.
        n_vertices: B, the number of body vertices.
        device: a torch device, "cpu" or "cuda"; points must lie on it.
        sign: how inside is told from outside. "winding" (generalised winding number) is right where limbs
            sink into each other and where the mesh has holes. "normal" (angle-weighted pseudo-normal of the
            closest point) is about five times as fast and differs from it only inside such overlaps.

    Raises:
        InputError: faces of a wrong shape, or indices out of range.
    """

    def __init__(
        self,
        faces: np.ndarray | torch.Tensor,
        n_vertices: int,
        *,
        device: str | torch.device = "cpu",
        sign: Sign = "winding",
    ) -> None:
        warp = _warp()
        faces = np.asarray(faces.detach().cpu() if isinstance(faces, torch.Tensor) else faces)
        check_faces(faces, n_vertices, "body_faces")
        self.n_vertices = n_vertices
        self.device = torch.device(device)
        self.sign = sign
        self._warp_device = warp.device_from_torch(self.device)
        self._indices = warp.array(faces.astype(np.int32).ravel(), dtype=warp.int32, device=self._warp_device)
        self._meshes: list[Any] = []
        self._ids: Any = None
        self._batched = False

    def update(self, body_vertices: np.ndarray | torch.Tensor) -> None:
        """Move the body.

        Args:
            body_vertices: (B, 3), or (T, B, 3) for one body a frame, metres.

        Raises:
            InputError: another shape, or a vertex that is not finite.
        """
        warp = _warp()
        if isinstance(body_vertices, torch.Tensor):
            body_vertices = body_vertices.detach().cpu().numpy()
        vertices = np.asarray(body_vertices, np.float32)
        if vertices.ndim not in (2, 3) or vertices.shape[-2:] != (self.n_vertices, 3) or 0 in vertices.shape:
            raise InputError(
                f"body_vertices must have shape ({self.n_vertices}, 3) or (frames, {self.n_vertices}, 3), "
                f"found {vertices.shape}"
            )
        check_finite(vertices, "body_vertices")
        self._batched = vertices.ndim == 3
        frames = vertices if self._batched else vertices[None]
        for mesh, frame in zip(self._meshes, frames, strict=False):
            mesh.points.assign(frame)
            mesh.refit()
        for frame in frames[len(self._meshes) :]:
            points = warp.array(frame, dtype=warp.vec3, device=self._warp_device)
            winding = self.sign == "winding"
            self._meshes.append(warp.Mesh(points, self._indices, support_winding_number=winding))
        del self._meshes[len(frames) :]
        ids = np.array([mesh.id for mesh in self._meshes], np.uint64)
        self._ids = warp.array(ids, dtype=warp.uint64, device=self._warp_device)

    def query(self, points: torch.Tensor) -> SdfQuery:
        """Distance, direction and closest point, without autograd.

        Args:
            points: (..., N, 3), metres; with a body per frame (T, N, 3), each frame against its own body.

        Raises:
            InputError: no `update` came before, a wrong shape, or points that are not finite.
        """
        if self._ids is None:
            raise InputError("BodySdf.query: no body yet; call update(body_vertices) first")
        if points.ndim < 1 or points.shape[-1] != 3:
            raise InputError(f"points must have shape (..., 3), found {tuple(points.shape)}")
        if self._batched and (points.ndim != 3 or len(points) != len(self._meshes)):
            raise InputError(
                f"points must have shape ({len(self._meshes)}, N, 3), one frame a body, "
                f"found {tuple(points.shape)}"
            )
        flat = points.detach().to(self.device, torch.float32).reshape(-1, 3).contiguous()
        packed = torch.empty((len(flat), 7), dtype=torch.float32, device=self.device)
        if len(flat):
            _launch(self._ids, flat, packed, len(flat) // len(self._meshes), self.sign)
        if bool(packed.isnan().any()):
            raise InputError("signed distance: points are not finite, or lie more than 1000 km away")
        packed = packed.reshape(*points.shape[:-1], 7)
        return SdfQuery(packed[..., 0], packed[..., 1:4], packed[..., 4:7])

    def distance(self, points: torch.Tensor) -> torch.Tensor:
        """Signed distance in metres, negative inside, differentiable once in the points.

        Args:
            points: as for `query`, floating point.

        Returns:
            (..., N), dtype of `points`. The gradient is the unit direction away from the surface.
        """
        return _Distance.apply(points, self)


class _Distance(torch.autograd.Function):
    """d(x) = ±|x − c(x)| with gradient ±(x − c) / |x − c|."""

    @staticmethod
    def forward(ctx: Any, points: torch.Tensor, sdf: BodySdf) -> torch.Tensor:
        found = sdf.query(points)
        ctx.save_for_backward(found.direction)
        return found.distance.to(points)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, *upstream: torch.Tensor) -> tuple[torch.Tensor, None]:
        (direction,) = ctx.saved_tensors
        return upstream[0][..., None] * direction.to(upstream[0]), None


@cache
def _warp() -> Any:
    """The warp module, started without its banner; imported late, because that takes a second."""
    import warp  # noqa: PLC0415

    if hasattr(warp, "LOG_WARNING"):
        warp.config.log_level = warp.LOG_WARNING
    else:  # older versions
        setattr(warp.config, "quiet", True)  # noqa: B010 (the type checker knows only the newer versions)
    with _without_driver_warning():
        warp.init()
    return warp


@contextmanager
def _without_driver_warning() -> Iterator[None]:
    """Keep back the one line that Warp's C++ start-up writes to stderr on every machine without a GPU driver.

    No setting of Warp's silences it. Whatever else is written meanwhile is passed on.
    """
    sys.stderr.flush()
    keep = os.dup(2)
    with tempfile.TemporaryFile() as caught:
        os.dup2(caught.fileno(), 2)
        try:
            yield
        finally:
            sys.stderr.flush()
            os.dup2(keep, 2)
            os.close(keep)
            caught.seek(0)
            lines = [line for line in caught if b"load the NVIDIA CUDA driver" not in line]
            os.write(2, b"".join(lines))


def _launch(ids: Any, points: torch.Tensor, packed: torch.Tensor, per_body: int, sign: Sign) -> None:
    """Fill `packed` (P, 7) with distance, direction and closest point of `points` (P, 3), both float32."""
    from fusion import sdf_kernels as kernels  # noqa: PLC0415 (defining kernels imports warp)

    warp = _warp()
    kernel = kernels.winding if sign == "winding" else kernels.normal
    # Torch may use a stream of its own; queueing on it keeps the order without waiting for the device.
    stream = warp.stream_from_torch(torch.cuda.current_stream(points.device)) if points.is_cuda else None
    warp.launch(
        kernel,
        dim=len(points),
        inputs=[ids, per_body, warp.from_torch(points, dtype=warp.vec3)],
        outputs=[warp.from_torch(packed)],
        device=ids.device,
        stream=stream,
    )
