"""What a garment must stay outside of besides the body: an inner garment, and several obstacles at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import torch

from fusion.obstacles.bvh import MeshBvh
from fusion.obstacles.sdf import Obstacle, SdfQuery, differentiable_distance, unpacked
from render import InputError


class MovingObstacle(Obstacle, Protocol):
    """An obstacle that takes a new pose."""

    def update(self, vertices: np.ndarray | torch.Tensor) -> None:
        """Move to (B, 3), or (T, B, 3) for one pose a frame, metres."""
        ...


class OuterSurface:
    """Signed distance to the outer side of an open surface: a garment worn beneath another one.

    An open surface has no inside. A point counts as below it if it lies behind the closest point's normal, no
    deeper than `inner_band_m`. Loose cloth hangs 5 cm off the body, so the default is more; much deeper, a point is
    on the body's other side. A point whose closest point is on the surface's rim is not covered, and free. So is
    every point farther out than `band_m`. Points that are free have the distance `band_m` and no direction.

    Keeps a garment out of another one, not out of itself: folds of one garment that cross each other are
    outside what the fusion solves.

    Args:
        faces: (G, 3) integers, counter-clockwise seen from outside.
        n_vertices: M, the number of vertices.
        device: a torch device, "cpu" or "cuda"; points must lie on it.
        offset_m: metres by which the surface is raised, at least 0: distances are to the raised surface.
        band_m: metres above the raised surface.
        inner_band_m: metres below the surface itself.

    Raises:
        InputError: faces of a wrong shape, indices out of range, or widths that are not positive.
    """

    def __init__(
        self,
        faces: np.ndarray | torch.Tensor,
        n_vertices: int,
        *,
        device: str | torch.device = "cpu",
        offset_m: float = 0.0,
        band_m: float = 0.05,
        inner_band_m: float = 0.1,
    ) -> None:
        if not (offset_m >= 0 and band_m > 0 and inner_band_m > 0):
            raise InputError(
                f"offset_m is {offset_m}, band_m {band_m}, inner_band_m {inner_band_m}; metres are wanted, the "
                "first at least 0, the others above 0"
            )
        self._mesh = MeshBvh(faces, n_vertices, device=device, name="inner")
        self._widths = float(band_m), float(inner_band_m), float(offset_m)
        self._rims = torch.from_numpy(_rims(self._mesh.faces, n_vertices)).to(self._mesh.device)

    @property
    def surfaces(self) -> tuple[MeshBvh, ...]:
        """The surface's mesh, not raised."""
        return (self._mesh,)

    @property
    def lipschitz(self) -> bool:
        """It is not: around its rim one gets below it without passing it."""
        return False

    def update(self, vertices: np.ndarray | torch.Tensor) -> None:
        """Move the surface to (M, 3), or (T, M, 3) for one pose a frame, metres.

        Raises:
            InputError: another shape, or a vertex that is not finite.
        """
        self._mesh.update(vertices)

    def query(
        self,
        points: torch.Tensor,
        frames: torch.Tensor | None = None,
        *,
        outside: torch.Tensor | None = None,
    ) -> SdfQuery:
        """Distance, direction and closest point of the surface as it is, not raised; without autograd.

        Args:
            points: (..., N, 3), metres; with a pose per frame (T, N, 3), each frame against its own.
            frames: (K,) integers, with points (K, 3): against which frame's surface each is asked.
            outside: as for any obstacle; nothing is saved here.

        Raises:
            InputError: no `update` came before, a wrong shape, or points that are not finite.
        """
        from fusion.obstacles import sdf_kernels as kernels  # noqa: PLC0415 (defining kernels imports warp)

        flat = self._mesh.points(points, frames)
        packed = torch.empty((len(flat), 7), dtype=torch.float32, device=self._mesh.device)
        arguments = [*self._widths, self._rims]
        self._mesh.launch(
            kernels.surface, flat, arguments, [packed], count=len(flat), frames=frames, by_warp=True
        )
        return unpacked(packed, points)

    def distance(self, points: torch.Tensor) -> torch.Tensor:
        """(..., N) signed distance in metres, negative below, differentiable once in the points."""
        return differentiable_distance(points, self)


class Obstacles:
    """Several obstacles as one: at each point the one with the smallest signed distance.

    Args:
        parts: at least one, all on one device.

    Raises:
        InputError: no parts.
    """

    def __init__(self, parts: Sequence[MovingObstacle]) -> None:
        if not parts:
            raise InputError("Obstacles: at least one obstacle is wanted, found none")
        self._parts = tuple(parts)

    @property
    def surfaces(self) -> tuple[MeshBvh, ...]:
        """The meshes of all parts."""
        return tuple(mesh for part in self._parts for mesh in part.surfaces)

    @property
    def lipschitz(self) -> bool:
        """Whether all parts are."""
        return all(part.lipschitz for part in self._parts)

    def update(self, *vertices: np.ndarray | torch.Tensor) -> None:
        """Move every part, in the order of `parts`; each as its own `update` takes it.

        Raises:
            InputError: not as many poses as parts, or one that its part refuses.
        """
        if len(vertices) != len(self._parts):
            raise InputError(
                f"Obstacles: {len(self._parts)} arrays of vertices are wanted, found {len(vertices)}"
            )
        for part, moved in zip(self._parts, vertices, strict=True):
            part.update(moved)

    def query(
        self,
        points: torch.Tensor,
        frames: torch.Tensor | None = None,
        *,
        outside: torch.Tensor | None = None,
    ) -> SdfQuery:
        """Distance, direction and closest point of the nearest part; see `BodySdf.query`."""
        nearest, *others = (part.query(points, frames, outside=outside) for part in self._parts)
        for other in others:
            nearer = other.distance < nearest.distance
            nearest = SdfQuery(
                torch.where(nearer, other.distance, nearest.distance),
                torch.where(nearer[..., None], other.direction, nearest.direction),
                torch.where(nearer[..., None], other.closest, nearest.closest),
            )
        return nearest

    def distance(self, points: torch.Tensor) -> torch.Tensor:
        """(..., N) signed distance in metres to the nearest part, differentiable once in the points."""
        return differentiable_distance(points, self)


def _rims(faces: np.ndarray, n_vertices: int) -> np.ndarray:
    """(G, 3) int8 for the kernel `surface`: 1 where the corner is on the rim, + 2 where the edge opposite is."""
    halves = np.sort(faces[:, [[1, 2], [2, 0], [0, 1]]], axis=2)  # (G, 3, 2): opposite each corner
    keys = halves[..., 0] * n_vertices + halves[..., 1]
    _, edge, uses = np.unique(keys, return_inverse=True, return_counts=True)
    rim_edge = uses[edge.reshape(keys.shape)] == 1
    rim_vertex = np.zeros(n_vertices, bool)
    rim_vertex[halves[rim_edge]] = True
    rims: np.ndarray = (rim_vertex[faces] + 2 * rim_edge).astype(np.int8)
    return rims
