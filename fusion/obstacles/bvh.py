"""A mesh that takes a new pose every frame, and the search structures for it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from itertools import pairwise
from threading import Lock
from typing import Any

import numpy as np
import torch

from fusion.obstacles.box_trees import BoxTrees
from fusion.parallel import n_threads, run_all
from fusion.warp_start import launch, warp_module
from render import InputError
from render.mesh.mesh import check_faces, check_finite

_WORTH_A_THREAD = 2000  # points; for fewer, waking it costs more than it does
_FARTHEST = 1e6  # metres; float32 points farther away have no use


class MeshBvh:
    """One pose of a mesh, or one pose a frame, for queries on Warp.

    Trees of boxes (`BoxTrees`) are built for the first pose of the first `update` and only fitted to all others, since
    the faces never change. A few kernels that are seldom wanted ask Warp's own meshes, which cost far more to make, and
    are not before. Queries may run in several threads; `update` must not run beside them.

    Args:
        faces: (G, 3) integers.
        n_vertices: B; vertices in no face do no harm.
        device: a torch device, "cpu" or "cuda"; points must lie on it.
        name: what error messages call the vertices and, with "_faces", the faces: "body" for body_vertices.
        winding: whether winding numbers are asked for, which makes refitting about ten times as slow.

    Raises:
        InputError: faces of a wrong shape, or indices out of range.
    """

    def __init__(
        self,
        faces: np.ndarray | torch.Tensor,
        n_vertices: int,
        *,
        device: str | torch.device,
        name: str,
        winding: bool = False,
    ) -> None:
        faces = np.asarray(faces.detach().cpu() if isinstance(faces, torch.Tensor) else faces)
        check_faces(faces, n_vertices, f"{name}_faces")
        self.faces = faces.astype(np.int64)
        self.n_vertices = n_vertices
        self.device = torch.device(device)
        self._name, self._winding = name, winding
        warp = warp_module()
        self._warp_device = warp.device_from_torch(self.device)
        self._boxes: BoxTrees | None = None
        self._first: torch.Tensor | None = None  # (B, 3), the pose that trees are built for
        self._trees: Any = None  # at the pose, once they are asked for
        self._meshes: list[Any] = []
        self._points: list[torch.Tensor] = []  # of the meshes, in their memory
        self._ids: Any = None
        self._meshes_moved = False
        self._lock = Lock()  # of several queries at once, the first one makes what they need
        self._batched = False
        self._posed: torch.Tensor | None = None

    @property
    def vertices(self) -> torch.Tensor:
        """(T, B, 3) float32 on the device, where the last `update` put them; no copy.

        Raises:
            InputError: there was none.
        """
        if self._posed is None:
            raise InputError(
                f"no pose of the {self._name} yet; call update({self._name}_vertices) before a query"
            )
        return self._posed

    def update(self, vertices: np.ndarray | torch.Tensor) -> torch.Tensor:
        """Move the mesh.

        Args:
            vertices: (B, 3), or (T, B, 3) for one pose a frame, metres.

        Returns:
            (T, B, 3) float32 on the device, T = 1 for a single pose.

        Raises:
            InputError: another shape, or a vertex that is not finite.
        """
        moved = torch.as_tensor(vertices).detach()
        if moved.ndim not in (2, 3) or moved.shape[-2:] != (self.n_vertices, 3) or 0 in moved.shape:
            raise InputError(
                f"{self._name}_vertices must have shape ({self.n_vertices}, 3) or (frames, {self.n_vertices}, 3), "
                f"found {tuple(moved.shape)}"
            )
        if not bool(torch.isfinite(moved).all()):
            check_finite(moved.cpu().numpy(), f"{self._name}_vertices")
        self._batched = moved.ndim == 3
        frames = moved.to(self.device, torch.float32, copy=True).reshape(-1, self.n_vertices, 3).contiguous()
        if self._first is None:
            self._first = frames[0].clone()
        self._trees, self._meshes_moved = None, False
        self._posed = frames
        return frames

    def _posed_trees(self) -> Any:
        """Trees of boxes at the pose."""
        with self._lock:
            if self._trees is None:
                if self._boxes is None:
                    assert self._first is not None
                    self._boxes = BoxTrees(self.faces, self._first.cpu().numpy(), self.device)
                with torch_stream(self.device):
                    self._trees = self._boxes.fit(self.vertices)
            return self._trees

    def _posed_meshes(self) -> Any:
        """Numbers of Warp's meshes at the pose, one a frame."""
        with self._lock:
            if not self._meshes_moved:
                with torch_stream(self.device):
                    self._place(self.vertices)
                self._meshes_moved = True
            return self._ids

    def _place(self, frames: torch.Tensor) -> None:
        warp = warp_module()
        indices = warp.array(self.faces.astype(np.int32).ravel(), dtype=warp.int32, device=self._warp_device)
        for mesh, points, pose in zip(self._meshes, self._points, frames, strict=False):
            points.copy_(pose)
            mesh.refit()
        if self._ids is not None and len(frames) == len(self._ids):
            return
        # Those of larger batches stay for the next one.
        for pose in frames[len(self._meshes) :]:
            # Leaves of 2 faces: queries are 6 % faster than with Warp's 4, and refitting costs as much.
            self._points.append(pose.clone())
            points = warp.from_torch(self._points[-1], dtype=warp.vec3)
            self._meshes.append(
                warp.Mesh(points, indices, support_winding_number=self._winding, bvh_leaf_size=2)
            )
        ids = np.array([mesh.id for mesh in self._meshes[: len(frames)]], np.uint64)
        self._ids = warp.array(ids, dtype=warp.uint64, device=self._warp_device)

    def points(self, points: torch.Tensor, frames: torch.Tensor | None = None) -> torch.Tensor:
        """Query points as (P, 3) float32 on the device.

        Args:
            points: (..., 3), or (T, N, 3) with a pose per frame; (P, 3) with `frames`.
            frames: (P,) integers, whose pose each point is to meet.

        Raises:
            InputError: no `update` came before, a wrong shape, or points that are not finite.
        """
        poses = len(self.vertices)
        if points.ndim < 1 or points.shape[-1] != 3:
            raise InputError(f"points must have shape (..., 3), found {tuple(points.shape)}")
        if frames is not None and points.shape != (*frames.shape, 3):
            raise InputError(
                f"points must have shape ({len(frames)}, 3), one a frame, found {tuple(points.shape)}"
            )
        if frames is None and self._batched and (points.ndim != 3 or len(points) != poses):
            raise InputError(
                f"points must have shape ({poses}, N, 3), one frame a {self._name}, "
                f"found {tuple(points.shape)}"
            )
        flat = points.detach().to(self.device, torch.float32).reshape(-1, 3).contiguous()
        if not bool((flat.abs() < _FARTHEST).all()):
            raise InputError("signed distance: points are not finite, or lie more than 1000 km away")
        return flat

    def launch(
        self,
        kernel: Any,
        flat: torch.Tensor,
        arguments: Sequence[Any],
        results: Sequence[torch.Tensor] = (),
        *,
        count: int,
        frames: torch.Tensor | None = None,
        by_warp: bool = False,
    ) -> None:
        """Run `kernel(trees, pose of each point, points, *arguments, *results)` on `count` threads.

        Where every point has its thread, they are shared out over the CPU's cores; Warp itself uses one.

        Args:
            kernel: of `fusion.obstacles.sdf_kernels`.
            flat: (P, 3), as `points` returned them.
            arguments: numbers and contiguous tensors, which are read or filled in place.
            results: (P, ...) contiguous tensors with a row a point, filled in place.
            count: threads; with 0 nothing happens.
            frames: as `points` got them; None: as many points a pose, one pose after the other.
            by_warp: the kernel takes the numbers of Warp's meshes in place of the trees.
        """
        if not count:
            return
        searched = self._posed_meshes() if by_warp else self._posed_trees()
        if frames is None:
            frames = torch.arange(len(self.vertices), device=self.device).repeat_interleave(
                len(flat) // len(self.vertices)
            )
        poses = frames.to(self.device, torch.int32).contiguous()
        parts = 1
        if count == len(flat) and self.device.type == "cpu":
            parts = max(1, min(n_threads(), count // _WORTH_A_THREAD))
        pieces = [
            partial(
                self._launch, kernel, searched, poses, flat, arguments, results, count, slice(first, last)
            )
            for first, last in pairwise(len(flat) * part // parts for part in range(parts + 1))
        ]
        run_all(pieces)

    def launch_grid(self, kernel: Any, dim: tuple[int, ...], arguments: Sequence[Any]) -> None:
        """Run `kernel(trees, *arguments)` on a grid of threads that each find their pose by themselves.

        Args:
            kernel: its first argument are the trees of all poses.
            dim: of the grid; with a 0 in it nothing happens.
            arguments: numbers, contiguous tensors, and what `array` and `vectors` return.
        """
        if 0 in dim:
            return
        converted = [array(each) if isinstance(each, torch.Tensor) else each for each in arguments]
        with torch_stream(self.device):
            launch(kernel, dim=dim, inputs=[self._posed_trees(), *converted], device=self._warp_device)

    def _launch(  # noqa: PLR0917
        self,
        kernel: Any,
        searched: Any,
        poses: torch.Tensor,
        flat: torch.Tensor,
        arguments: Sequence[Any],
        results: Sequence[torch.Tensor],
        count: int,
        part: slice,
    ) -> None:
        """`launch` for some of the points."""
        of_part = [rows[part] for rows in (poses, flat, *results)]
        converted = [
            array(value) if isinstance(value, torch.Tensor) else value for value in (*arguments, *of_part[2:])
        ]
        with torch_stream(self.device):
            launch(
                kernel,
                dim=min(count, len(of_part[1])),
                inputs=[searched, array(of_part[0]), vectors(of_part[1]), *converted],
                device=self._warp_device,
            )


def array(tensor: torch.Tensor) -> Any:
    """Numbers, contiguous, as what Warp's kernels take, in the same memory, which it does not keep alive."""
    return warp_module().from_torch(tensor, return_ctype=True)


def vectors(tensor: torch.Tensor) -> Any:
    """(..., 3) float32, contiguous, as an array of vectors; else like `array`."""
    warp = warp_module()
    return warp.from_torch(tensor, dtype=warp.vec3, return_ctype=True)


@contextmanager
def torch_stream(device: torch.device) -> Iterator[None]:
    """Queue Warp's work on torch's stream, which keeps the order without waiting for the device."""
    if device.type != "cuda":
        yield
        return
    warp = warp_module()
    with warp.ScopedStream(warp.stream_from_torch(torch.cuda.current_stream(device))):
        yield
