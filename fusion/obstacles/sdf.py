"""Signed distance from points to a moving body mesh, on Warp's mesh queries."""

from __future__ import annotations

from dataclasses import dataclass
from threading import Lock
from typing import Any, Literal, Protocol

import numpy as np
import torch

from fusion.obstacles.bvh import MeshBvh
from render import InputError
from render.mesh.measures import volume

Sign = Literal["checked", "winding", "normal"]
_FARTHEST = 1e6  # metres; a band that cuts nothing off


@dataclass(frozen=True, eq=False)
class SdfQuery:
    """The answer to a query for points (..., N, 3); plain values, without autograd.

    Args:
        distance: (..., N) float32, metres, negative inside; the band's width for points beyond the band.
        direction: (..., N, 3) float32 unit vectors, the gradient of the distance: outwards. 0 beyond the
            band.
        closest: (..., N, 3) float32, metres, the closest point of the surface; beyond the band the point
            itself.
    """

    distance: torch.Tensor
    direction: torch.Tensor
    closest: torch.Tensor


class Obstacle(Protocol):
    """Something that the garment must stay outside of: `BodySdf`, `OuterSurface`, or several as `Obstacles`."""

    @property
    def surfaces(self) -> tuple[MeshBvh, ...]:
        """The meshes that bound it; they take their poses with it."""
        ...

    @property
    def lipschitz(self) -> bool:
        """Whether no point's distance, where it is positive, changes by more than the point moves."""
        ...

    def query(
        self,
        points: torch.Tensor,
        frames: torch.Tensor | None = None,
        *,
        outside: torch.Tensor | None = None,
    ) -> SdfQuery:
        """Distance, direction and closest point, without autograd.

        Args:
            points: (T, N, 3) metres.
            frames: (K,) integers, with points (K, 3): against the obstacle in which frame each is asked.
            outside: bool, one a point: those that are known to be outside, which saves finding out.
        """
        ...

    def distance(self, points: torch.Tensor) -> torch.Tensor:
        """(T, N) signed distance in metres, differentiable once in the points."""
        ...


class BodySdf:
    """Signed distance to one pose of a body, or to one pose per frame of a batch (equation 7 of the paper).

    Outside, the distance is that to the nearest surface. Inside a body part that no other part overlaps, minus
    the distance to the nearest surface. Where parts overlap (an arm pressed into the trunk), surfaces that lie
    inside another part do not count: distance and direction are those of an exit from the whole, the shortest
    of some two dozen and hence up to a few per cent too long.

    Queries compute in float32, whatever the dtype of the points, and may run in several threads once there is a
    pose; `update` must not run beside them. The first query on a machine takes some seconds, in which Warp compiles
    the kernels; it keeps them on disk. Vertices in no face and faces without area do no harm. A garment's collisions
    with itself are no part of this.

    Args:
        faces: (G, 3) integers, counter-clockwise seen from outside.
        n_vertices: B, the number of body vertices.
        device: a torch device, "cpu" or "cuda"; points must lie on it.
        sign: how inside is told from outside. "checked" takes the angle-weighted pseudo-normal of the closest
            point, lets a ray see whether that point is on the outer surface, and asks for the winding number
            where it is not. "winding" takes the generalised winding number everywhere, about five times as slow.
            A mesh with holes, with seams whose vertices are not merged, or with some faces turned round, always
            gets the latter. "normal" takes the pseudo-normal alone, which is wrong where parts overlap.
        band_m: metres; farther outside, points get this distance and no direction, which saves time. None:
            every distance is exact. Inside, it always is.

    Raises:
        InputError: faces of a wrong shape, indices out of range, or a band that is not positive.
    """

    def __init__(
        self,
        faces: np.ndarray | torch.Tensor,
        n_vertices: int,
        *,
        device: str | torch.device = "cpu",
        sign: Sign = "checked",
        band_m: float | None = None,
    ) -> None:
        if band_m is not None and not band_m > 0:
            raise InputError(f"band_m is {band_m}; metres above 0 are wanted, or None for no band")
        self._body = MeshBvh(faces, n_vertices, device=device, name="body", winding=sign == "winding")
        self._closed = is_closed(self._body.faces)
        self.sign: Sign = "winding" if sign == "checked" and not self._closed else sign
        if self.sign != sign:
            self._body = MeshBvh(faces, n_vertices, device=device, name="body", winding=True)
        self._doubted: MeshBvh | None = None  # with winding numbers, made and moved only when asked for
        self._pose: torch.Tensor | None = None
        self._doubted_pose: torch.Tensor | None = None
        self._doubted_lock = Lock()  # of several queries at once, the first one makes it
        self._band = _FARTHEST if band_m is None else float(band_m)

    @property
    def n_vertices(self) -> int:
        """B, the number of body vertices."""
        return self._body.n_vertices

    @property
    def device(self) -> torch.device:
        """Where points must lie."""
        return self._body.device

    @property
    def surfaces(self) -> tuple[MeshBvh, ...]:
        """The body's mesh."""
        return (self._body,)

    @property
    def lipschitz(self) -> bool:
        """Of a closed mesh: through the holes of others one gets in without passing the surface."""
        return self.sign == "checked"

    def update(self, body_vertices: np.ndarray | torch.Tensor) -> None:
        """Move the body.

        Args:
            body_vertices: (B, 3), or (T, B, 3) for one body a frame, metres.

        Raises:
            InputError: another shape, a vertex that is not finite, or (at the first pose of a closed mesh)
                faces that are clockwise seen from outside, which would turn every sign round.
        """
        first = self._pose is None
        frames = self._body.update(body_vertices)
        if first and self._closed:
            enclosed = volume(frames[0].cpu().numpy().astype(np.float64), self._body.faces)
            if enclosed < 0:
                raise InputError(
                    f"body_faces: the body's volume is negative ({1000 * enclosed:.3g} litres), so its faces are "
                    "clockwise seen from outside; reverse the order of every face's corners"
                )
        self._pose = frames

    def query(
        self,
        points: torch.Tensor,
        frames: torch.Tensor | None = None,
        *,
        outside: torch.Tensor | None = None,
    ) -> SdfQuery:
        """Distance, direction and closest point, without autograd.

        Args:
            points: (..., N, 3), metres; with a body per frame (T, N, 3), each frame against its own body.
            frames: (K,) integers, with points (K, 3): against which frame's body each is asked.
            outside: bool, one a point: those that are known to be outside. For the sign "checked" that saves the rays.

        Raises:
            InputError: no `update` came before, a wrong shape, or points that are not finite.
        """
        from fusion.obstacles import sdf_kernels as kernels  # noqa: PLC0415 (defining kernels imports warp)

        flat = self._body.points(points, frames)
        packed = torch.empty((len(flat), 7), dtype=torch.float32, device=self.device)
        if self.sign != "checked":
            kernel = kernels.winding if self.sign == "winding" else kernels.normal
            self._body.launch(
                kernel, flat, [self._band], [packed], count=len(flat), frames=frames, by_warp=True
            )
            return unpacked(packed, points)
        doubt = torch.empty(len(flat), dtype=torch.int32, device=self.device)
        known = (
            torch.zeros_like(doubt, dtype=torch.int8)
            if outside is None
            else outside.reshape(-1).to(torch.int8)
        )
        self._body.launch(
            kernels.checked, flat, [self._band], [known, packed, doubt], count=len(flat), frames=frames
        )
        # Most doubts are settled by more rays, and only what is left asks for the costly winding numbers.
        for kernel in (kernels.confirmed, kernels.settled):
            doubtful = doubt.nonzero()[:, 0].int()
            if not len(doubtful):
                break
            mesh = self._body if kernel is kernels.confirmed else self._with_winding()
            arguments = [self._band, doubtful, doubt, packed]
            mesh.launch(kernel, flat, arguments, count=len(doubtful), frames=frames, by_warp=True)
        return unpacked(packed, points)

    def distance(self, points: torch.Tensor) -> torch.Tensor:
        """Signed distance in metres, negative inside, differentiable once in the points.

        Args:
            points: as for `query`, floating point.

        Returns:
            (..., N), dtype of `points`. The gradient is the unit direction away from the surface.
        """
        return differentiable_distance(points, self)

    def _with_winding(self) -> MeshBvh:
        """The same pose with what winding numbers need; moving that costs more than all else of an update."""
        with self._doubted_lock:
            if self._doubted is None:
                self._doubted = MeshBvh(
                    self._body.faces, self.n_vertices, device=self.device, name="body", winding=True
                )
            if self._doubted_pose is not self._pose:
                assert self._pose is not None
                self._doubted.update(self._pose)
                self._doubted_pose = self._pose
            return self._doubted


def is_closed(faces: np.ndarray) -> bool:
    """Whether each edge is passed as often in one direction as in the other: no holes, and all faces turned alike.

    Args:
        faces: (G, 3) integers.
    """
    halves = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).astype(np.int64)
    keys = halves.min(1) * (int(faces.max()) + 1) + halves.max(1)
    _, edge = np.unique(keys, return_inverse=True)
    # A face that uses a vertex twice has an edge from it to itself, which bounds nothing.
    balance = np.bincount(edge, np.sign(halves[:, 1] - halves[:, 0]))
    return not balance.any()


def differentiable_distance(points: torch.Tensor, obstacle: Obstacle) -> torch.Tensor:
    """The distance of a query with its direction as gradient.

    Args:
        points: (..., N, 3) floating point, metres.
        obstacle: asked once.

    Returns:
        (..., N), dtype of `points`.
    """
    distance: torch.Tensor = _Distance.apply(points, obstacle)  # type: ignore[no-untyped-call]
    return distance


def unpacked(packed: torch.Tensor, points: torch.Tensor) -> SdfQuery:
    """What the kernels write as the answer to a query.

    Args:
        packed: (P, 7) float32: distance, direction, closest point.
        points: (..., 3) with P points in all, whose leading axes the answer gets.
    """
    packed = packed.reshape(*points.shape[:-1], 7)
    return SdfQuery(packed[..., 0], packed[..., 1:4], packed[..., 4:7])


class _Distance(torch.autograd.Function):
    """d(x) = ±|x − c(x)| with gradient ±(x − c) / |x − c|."""

    @staticmethod
    def forward(ctx: Any, points: torch.Tensor, obstacle: Obstacle) -> torch.Tensor:
        query = obstacle.query(points)
        ctx.save_for_backward(query.direction)
        return query.distance.to(points)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, *upstream: torch.Tensor) -> tuple[torch.Tensor, None]:
        (direction,) = ctx.saved_tensors
        return upstream[0][..., None] * direction.to(upstream[0]), None
