"""Where cloth between its vertices is in an obstacle: edges and faces that pass through it, and how far they must go.

Vertices outside do not keep edges and faces out: a knee comes through the middle of a face, and an edge cuts across a
shoulder. Both show as edges of one mesh that pass through faces of the other. What a crossing asks for is said for a
point of the cloth: a mean of the corners of a face or of the ends of an edge, a direction and a length.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from fusion.obstacles.bvh import MeshBvh, array, vectors
from fusion.obstacles.sdf import Obstacle
from fusion.topology import Topology
from render.mesh.normals import safe_normalize

# Metres by which a point of the cloth that has been inside is put outside: files hold float32, and lifts of its
# neighbours move it, too.
_CLEAR = 2e-4
# Metres: a body's vertex farther from the cloth than this has not just come through it.
_NEAR = 0.05
# Least cosine between the body's normal and the direction from the cloth to a point of the body that has come through.
_ALONG = 0.2
# Fraction of an edge between its first and last crossing below which they are one, noted from two faces; and metres
# below which the direction between two points is rounding.
_ONE_PLACE, _ROUNDING = 1e-4, 1e-6
# Metres that a point moves at once, and the least squared length of how it moves with its corners, below which walls
# leave it no room.
_LONGEST, _LEAST = 0.01, 0.1


@dataclass(frozen=True, eq=False)
class SurfaceContacts:
    """K points of the cloth that must move.

    Args:
        frame: (K,) int64.
        corners: (K, 3) int64, vertices of the cloth around the point.
        weights: (K, 3) of sum 1, with which it is their mean.
        direction: (K, 3) unit vectors, out of the obstacle.
        depth: (K,) metres to move along it, above 0.
    """

    frame: torch.Tensor
    corners: torch.Tensor
    weights: torch.Tensor
    direction: torch.Tensor
    depth: torch.Tensor

    def lifts(self, like: torch.Tensor, loose: torch.Tensor, walls: torch.Tensor) -> torch.Tensor:
        """(T, N, 3) by which vertices `like` (T, N, 3) must move so that the points do.

        Of the least moves that bring a point there, the mean where a vertex has several, weighted with how much of
        the point is the vertex's. Only `loose` (N,) bool ones move, and none against its wall: `walls` (T, N, 3) are
        unit vectors away from what a vertex touches, 0 where that is nothing.
        """
        weights = (self.weights * loose[self.corners])[..., None]
        wall = walls[self.frame[:, None], self.corners]
        against = (wall * self.direction[:, None]).sum(-1, keepdim=True).clamp(max=0)
        open_to = weights * (self.direction[:, None] - against * wall)
        squares = open_to.square().sum((1, 2), keepdim=True)
        push = open_to * (self.depth.clamp(max=_LONGEST)[:, None, None] / squares.clamp(min=_LEAST))
        places = self.frame[:, None] * like.shape[1] + self.corners
        rows = torch.cat([push * weights, weights], -1).to(like)
        total = like.new_zeros(like.shape[0] * like.shape[1], 4)
        total.index_add_(0, places.reshape(-1), rows.reshape(-1, 4))
        moved = total[:, :3] / total[:, 3:].clamp(min=1e-12)
        return moved.view(like.shape)

    def even_heights(self, height: torch.Tensor) -> torch.Tensor:
        """(T, N) metres above the obstacle at which the points are outside if all corners of each are as high.

        The most where a vertex has several points, 0 where it has none. `height` (T, N) metres is where they are now.
        """
        places = self.frame[:, None] * height.shape[1] + self.corners
        weights = self.weights.to(height)
        even = (weights * height.flatten()[places]).sum(1) + self.depth.to(height)
        even = even.clamp(max=_LONGEST)[:, None] * (weights > 0)
        highest = torch.zeros_like(height).flatten()
        return highest.scatter_reduce(0, places.flatten(), even.flatten(), "amax").view(height.shape)


class SurfaceContact:
    """Finds the contacts of a garment with an obstacle's surfaces.

    Trees of boxes are kept and refitted; one `find` at a time.

    Args:
        obstacle: one posed obstacle a frame.
        topology: of the garment.
        device: of the vertices.
    """

    def __init__(self, obstacle: Obstacle, topology: Topology, device: torch.device) -> None:
        self._obstacle = obstacle
        self._mesh = MeshBvh(topology.faces, topology.n_vertices, device=device, name="garment")
        # Built at rest, and only fitted later.
        self._mesh.update(topology.rest_vertices)
        self._sides = _Sides(self._mesh)
        self._surfaces = [_Surface(mesh) for mesh in obstacle.surfaces]

    def find(
        self, vertices: torch.Tensor, distance: torch.Tensor, looked_at: torch.Tensor | None = None
    ) -> SurfaceContacts | None:
        """The contacts of vertices (T, N, 3), metres; None where there are none.

        Args:
            vertices: all of them outside, as far as possible.
            distance: (T, N) metres, their distances.
            looked_at: (T, N) bool: only faces with such a vertex are; None for all.
        """
        if not self._surfaces or not vertices.numel():
            return None
        if looked_at is None:
            looked_at = torch.ones_like(distance, dtype=torch.bool)
        active = looked_at.any(1).nonzero()[:, 0]
        if not len(active):
            return None
        cloth = _Cloth(
            active,
            vertices[active].detach().to(torch.float32).contiguous(),
            distance[active].to(torch.float32).contiguous(),
            looked_at[active],
        )
        parts = []
        for surface in self._surfaces:
            of_cloth, of_surface = self._crossed(surface, cloth)
            parts.append(self._of_edges(cloth, of_cloth))
            if len(of_surface.edge):
                parts.append(self._of_surface(surface, cloth, of_surface))
        row, *others = (torch.cat(values) for values in zip(*parts, strict=True))
        return SurfaceContacts(active[row], *others) if len(row) else None

    def body_crossings(
        self, vertices: torch.Tensor, distance: torch.Tensor, frames: torch.Tensor
    ) -> torch.Tensor:
        """How many edges of the garment and of the obstacle's first surface pass through a face of the other.

        Args:
            vertices: (T, N, 3) metres.
            distance: (T, N) metres; no vertex is nearer to the obstacle.
            frames: (A,) int64, which of them are counted.

        Returns:
            (A,) int64.
        """
        cloth = _Cloth(
            frames,
            vertices[frames].detach().to(torch.float32).contiguous(),
            distance[frames].to(torch.float32).contiguous(),
            torch.ones_like(distance[frames], dtype=torch.bool),
        )
        counts = [
            torch.bincount(each.row, minlength=len(frames))
            for each in self._crossed(self._surfaces[0], cloth)
        ]
        return counts[0] + counts[1]

    def _crossed(self, surface: _Surface, cloth: _Cloth) -> list[_Crossed]:
        """The cloth's edges that pass through the surface, and the surface's that pass through the cloth."""
        from fusion.obstacles.surface_kernels import crossed  # noqa: PLC0415 (defining kernels imports warp)

        places = [
            cloth.points.new_empty(2, len(cloth.points), len(sides.edges))
            for sides in (self._sides, surface.sides)
        ]
        for first, last in places:
            first.fill_(2)
            last.fill_(-1)
        surface.mesh.launch_grid(
            crossed,
            (len(cloth.points), len(self._sides.faces)),
            [
                cloth.frames.int(),
                surface.sides.of_face,
                vectors(cloth.points),
                cloth.distance,
                cloth.looked_at.to(torch.int8),
                self._sides.faces,
                self._sides.of_face,
                *places,
            ],
        )
        return [_Crossed.of(each) for each in places]

    def _of_edges(self, cloth: _Cloth, crossed: _Crossed) -> tuple[torch.Tensor, ...]:
        """Contacts of the cloth's edges: halfway between the crossings, they must leave the obstacle."""
        ends = self._sides.edges[crossed.edge]
        nearer = cloth.distance[crossed.row[:, None], ends].argmin(1)
        once = ~crossed.twice  # from there to an end, it is inside or below
        first = torch.where(once & (nearer == 0), 0, crossed.first)
        last = torch.where(once & (nearer == 1), 1, crossed.last)
        middle = 0.5 * (first + last)
        weights = torch.stack([1 - middle, middle, torch.zeros_like(middle)], -1)
        corners = torch.cat([ends, ends[:, :1]], -1)
        query = self._obstacle.query(cloth.mean(crossed.row, corners, weights), cloth.frames[crossed.row])
        inside = query.distance < _CLEAR
        return tuple(
            values[inside]
            for values in (crossed.row, corners, weights, query.direction, _CLEAR - query.distance)
        )

    def _of_surface(self, surface: _Surface, cloth: _Cloth, crossed: _Crossed) -> tuple[torch.Tensor, ...]:
        """Contacts of points of the surface that have come through the cloth, which are beyond its nearest point as
        seen along their normals: ends of edges that pass through it, and middles between places where they do."""
        row, at, outwards = surface.samples(cloth.frames, crossed)
        face, weights = self._nearest(cloth, row, at)
        corners = self._sides.faces[face.long()].long()
        away = at - cloth.mean(row, corners, weights)
        length = torch.linalg.vector_norm(away, dim=-1)
        direction = torch.where((length > _ROUNDING)[:, None], safe_normalize(away), outwards)
        through = (face >= 0) & ((direction * outwards).sum(-1) > _ALONG)
        return tuple(values[through] for values in (row, corners, weights, direction, length + _CLEAR))

    def _nearest(
        self, cloth: _Cloth, row: torch.Tensor, points: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Of points (K, 3) in rows (K,), the nearest faces of the cloth (K,), -1 where none is near, and the
        coordinates in them (K, 3)."""
        from fusion.obstacles.surface_kernels import nearest  # noqa: PLC0415 (defining kernels imports warp)

        faces = torch.empty(len(points), dtype=torch.int32, device=points.device)
        weights = torch.zeros_like(points)
        frames, poses = row.unique(return_inverse=True)
        self._mesh.update(cloth.points[frames])
        arguments = [poses.int(), vectors(points), _NEAR, array(faces), vectors(weights)]
        self._mesh.launch_grid(nearest, (len(points),), arguments)
        return faces, weights


@dataclass(frozen=True, eq=False)
class _Cloth:
    """The frames (A,) that are looked at: their vertices (A, N, 3), distances and whether each is looked at (A, N)."""

    frames: torch.Tensor
    points: torch.Tensor
    distance: torch.Tensor
    looked_at: torch.Tensor

    def mean(self, row: torch.Tensor, corners: torch.Tensor, weights: torch.Tensor) -> torch.Tensor:
        """(K, 3) points in rows (K,) with weights (K, 3) between vertices (K, 3)."""
        return (self.points[row[:, None], corners] * weights[..., None]).sum(1)


@dataclass(frozen=True, eq=False)
class _Crossed:
    """Edges that cross: in which row of the frames (C,), which (C,), and in [0, 1] where first and last (C,)."""

    row: torch.Tensor
    edge: torch.Tensor
    first: torch.Tensor
    last: torch.Tensor

    @property
    def twice(self) -> torch.Tensor:
        """(C,) bool, whether the edge crosses at two places at least."""
        return self.last - self.first > _ONE_PLACE

    @classmethod
    def of(cls, places: torch.Tensor) -> _Crossed:
        """From what the kernel wrote (2, A, edges)."""
        place = (places[1].flatten() >= 0).nonzero()[:, 0]
        n_edges = places.shape[2]
        return cls(place // n_edges, place % n_edges, *places.flatten(1)[:, place])


class _Sides:
    """The edges of a mesh and which of them bound each face, as the kernel `crossed` takes them."""

    def __init__(self, mesh: MeshBvh) -> None:
        halves = mesh.faces[:, [[0, 1], [1, 2], [2, 0]]]  # (G, 3, 2)
        low, high = halves.min(2), halves.max(2)
        keys, place = np.unique(low * mesh.n_vertices + high, return_inverse=True)
        edges = np.stack([keys // mesh.n_vertices, keys % mesh.n_vertices], 1)
        turned = halves[..., 0] > halves[..., 1]
        of_face = (2 * place.reshape(turned.shape) + turned).astype(np.int32)
        self.edges = torch.from_numpy(edges).to(mesh.device)
        self.of_face = torch.from_numpy(of_face).to(mesh.device)
        self.faces = torch.from_numpy(mesh.faces.astype(np.int32)).to(mesh.device)


class _Surface:
    """A surface of the obstacle with its edges, and the normals at those of its vertices that are asked about."""

    def __init__(self, mesh: MeshBvh) -> None:
        self.mesh, self.sides = mesh, _Sides(mesh)
        by_vertex = np.argsort(mesh.faces.ravel(), kind="stable")
        starts = np.searchsorted(mesh.faces.ravel()[by_vertex], np.arange(mesh.n_vertices + 1))
        self._around = [
            torch.from_numpy(values.astype(np.int32)).to(mesh.device) for values in (starts, by_vertex // 3)
        ]

    def samples(
        self, frames: torch.Tensor, crossed: _Crossed
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Ends of edges that cross, each once, and middles between crossings: rows (K,), points and normals (K, 3)."""
        ends = self.sides.edges[crossed.edge]
        numbers = crossed.row[:, None] * self.mesh.n_vertices + ends
        place, own = torch.unique(numbers, return_inverse=True)
        row, vertex = place // self.mesh.n_vertices, place % self.mesh.n_vertices
        twice = crossed.twice
        middle = 0.5 * (crossed.first + crossed.last)[twice, None]
        first, last = own[twice].T
        at = self.mesh.vertices[frames[row], vertex], self._normals(frames[row], vertex)
        points, normals = (
            torch.cat([values, torch.lerp(values[first], values[last], middle)]) for values in at
        )
        return torch.cat([row, crossed.row[twice]]), points, safe_normalize(normals)

    def _normals(self, frames: torch.Tensor, vertices: torch.Tensor) -> torch.Tensor:
        """(K, 3) at vertices (K,) in frames (K,)."""
        from fusion.obstacles.surface_kernels import normals_at  # noqa: PLC0415 (defining kernels imports warp)

        normals = torch.zeros(len(frames), 3, device=frames.device)
        numbers = [frames.int(), vertices.int(), *self._around]
        self.mesh.launch_grid(normals_at, (len(frames),), [*numbers, vectors(normals)])
        return normals
