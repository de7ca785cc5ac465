"""Trees of boxes over the faces of a mesh in many poses at once: built for one pose, fitted to all others."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from fusion.warp_start import launch, warp_module

_CHILDREN = 8  # of a node: a vector of float32 with AVX2
_LEAF = 2.0  # faces of a leaf at most, on average


class BoxTrees:
    """Of one mesh.

    Which faces are near each other hardly changes as a mesh moves, so that a tree for one pose serves all. Where a
    place is found, among places as near it is that of the face with the lowest number, whatever the tree.

    Args:
        faces: (G, 3) int64.
        vertices: (B, 3) metres, the pose to build the tree for.
        device: torch device.
    """

    def __init__(self, faces: np.ndarray, vertices: np.ndarray, device: torch.device) -> None:
        depth = 1
        while _LEAF * _CHILDREN**depth < len(faces):
            depth += 1
        order, start = _sorted(vertices[faces].mean(1), 3 * depth)
        self._inner = (_CHILDREN**depth - 1) // (_CHILDREN - 1)
        self._depth, self._device = depth, device
        self._constant = [
            torch.from_numpy(values.astype(np.int32)).to(device) for values in (start, order, faces)
        ]
        self._n_faces = len(faces)
        self._boxes: torch.Tensor | None = None
        self._corners = torch.empty(0, len(faces), 3, 3, device=device)
        self._kept: Any = None  # what the struct's arrays belong to

    def fit(self, poses: torch.Tensor) -> Any:
        """The trees of poses (T, B, 3) float32, as kernels take them; the poses must not be changed while they do."""
        from fusion.obstacles.tree_kernels import Trees, fit_leaves, fit_nodes, lane  # noqa: PLC0415 (heavy)

        warp = warp_module()
        if self._boxes is None or len(self._boxes) < len(poses):
            self._boxes = torch.empty(len(poses), self._inner, 6, _CHILDREN, device=self._device)
            self._corners = torch.empty(len(poses), self._n_faces, 3, 3, device=self._device)
        start, order, faces = (warp.from_torch(values, dtype=warp.int32) for values in self._constant)
        trees = Trees()
        trees.inner, trees.children = self._inner, _CHILDREN
        trees.boxes = warp.from_torch(self._boxes[: len(poses)], dtype=lane)
        trees.start, trees.order, trees.faces = start, order, faces
        trees.points = warp.from_torch(poses, dtype=warp.vec3)
        trees.corners = warp.from_torch(self._corners[: len(poses)], dtype=warp.vec3)
        self._kept = poses
        for level in reversed(range(self._depth)):
            count = _CHILDREN**level
            launch(
                fit_leaves if level == self._depth - 1 else fit_nodes,
                dim=(len(poses), count),
                inputs=[trees, (count - 1) // (_CHILDREN - 1)],
                device=warp.device_from_torch(self._device),
            )
        return trees


def _sorted(points: np.ndarray, levels: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Points (K, 3) in 2^levels parts of about one size, each half of what it is a part of, cut across its longer side.

    Returns:
        (K,) the points in order, and (2^levels + 1,) where each part begins.
    """
    count = len(points)
    order, placed = np.arange(count), np.ascontiguousarray(points, np.float64)
    for level in range(levels):
        bounds = count * np.arange(2**level + 1) // 2**level
        sizes = np.diff(bounds)
        if sizes.max(initial=0) < 2:
            break
        used = sizes > 0
        low, high = (each.reduceat(placed, bounds[:-1][used], axis=0) for each in (np.minimum, np.maximum))
        axis = (high - low).argmax(1)
        rows = np.arange(len(axis))
        part = np.repeat(rows, sizes[used])
        scale = 0.5 / np.maximum((high - low)[rows, axis], np.finfo(np.float64).tiny)
        # The part, and where in it: one number is sorted faster than two.
        along = placed[np.arange(count), axis[part]]
        chosen = np.argsort(part + (along - low[rows, axis][part]) * scale[part])
        order, placed = order[chosen], placed[chosen]
    return order, count * np.arange(2**levels + 1) // 2**levels
