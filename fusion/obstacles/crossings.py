"""Where edges of one mesh pass through faces of another, or of their own: what vertices' distances do not show.

An edge passes through a face where its ends lie strictly on different sides of the face's plane and the point between
them that lies in the plane belongs to the triangle, sides and corners included. So an edge that only touches (an end on
the face) or lies in its plane does not pass, nor does one without length, nor any through a face without area; one that
meets the side between two faces passes through both, and is still counted as one edge. Surfaces may be open: what goes
in and out through an opening passes through nothing.

Computed in float64 from vertices in float32, to which others are rounded first.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from fusion.obstacles.bvh import MeshBvh
from fusion.parallel import one_torch_thread
from render import InputError

_ROWS = 1 << 17  # edges times frames looked at together; some 30 bytes each, and a tree a frame


@dataclass(frozen=True, eq=False)
class Crossings:
    """C places at which an edge passes through a face, in the order of frame, edge and face.

    Args:
        frame: (C,) int64, below `n_frames`.
        edge: (C,) int64, row of the edges asked about, below `n_edges`.
        face: (C,) int64, row of the faces.
        along: (C,) float64 in [0, 1], where on the edge, from its first vertex (0) to its second.
        weights: (C, 3) float64 in [0, 1] of sum 1, barycentric coordinates of the place in the face.
        outwards: (C,) bool, whether the edge's second vertex lies on the side that the face's normal points to.
        n_frames, n_edges: T and E.
    """

    frame: torch.Tensor
    edge: torch.Tensor
    face: torch.Tensor
    along: torch.Tensor
    weights: torch.Tensor
    outwards: torch.Tensor
    n_frames: int
    n_edges: int

    def marks(self) -> torch.Tensor:
        """(T, E) bool, which edges pass through any face."""
        marks = torch.zeros(self.n_frames, self.n_edges, dtype=torch.bool, device=self.edge.device)
        marks[self.frame, self.edge] = True
        return marks

    def counts(self) -> torch.Tensor:
        """(T,) int64, how many edges pass through any face: each edge once, however many faces it meets."""
        return self.marks().sum(1)


class EdgeCrossings:
    """Finds where edges pass through the faces of a mesh that takes a new pose every frame.

    Trees of boxes are kept and refitted between queries; one query at a time.

    Args:
        edges: (E, 2) integers, vertices of the mesh whose edges are asked about (`Mesh.edges`).
        faces: (F, 3) integers, of the mesh that they may pass through.
        n_vertices: of the mesh with the faces.
        itself: whether both are one mesh; then faces that share a vertex with an edge do not count for it.
        device: a torch device, "cpu" or "cuda".
        name: what error messages call the mesh with the faces.

    Raises:
        InputError: faces of a wrong shape, or indices out of range.
    """

    def __init__(
        self,
        edges: np.ndarray | torch.Tensor,
        faces: np.ndarray | torch.Tensor,
        n_vertices: int,
        *,
        itself: bool = False,
        device: str | torch.device = "cpu",
        name: str = "body",
    ) -> None:
        self._bvh = MeshBvh(faces, n_vertices, device=device, name=name)
        device = self._bvh.device
        self._edges = torch.as_tensor(edges).to(device, torch.int64)
        self._faces = torch.from_numpy(self._bvh.faces).to(device)
        own = self._edges if itself else torch.full_like(self._edges, -1)
        self._own = own.to(torch.int32)

    def query(
        self, vertices: np.ndarray | torch.Tensor, surface: np.ndarray | torch.Tensor | None = None
    ) -> Crossings:
        """Where the edges of `vertices` (T, N, 3) pass through the faces of `surface` (T, M, 3), metres.

        Without `surface` it is `vertices`. Memory grows with T · E; `edges_through_faces` bounds it.

        Raises:
            InputError: other shapes, or vertices that are not finite.
        """
        with one_torch_thread():  # small steps; the kernels take the other threads
            return self._query(vertices, vertices if surface is None else surface)

    def counts(self, vertices: torch.Tensor) -> torch.Tensor:
        """(T,) int64, how many edges of vertices (T, N, 3) pass through faces of the same mesh, as `Crossings.counts`.

        Raises:
            InputError: another shape, or vertices that are not finite.
        """
        with one_torch_thread():
            starts, ends, _ = self._ends(vertices, vertices)
            return (self._passed(starts, ends)[0] > 0).view(starts.shape[:2]).sum(1)

    def _query(self, vertices: np.ndarray | torch.Tensor, surface: np.ndarray | torch.Tensor) -> Crossings:
        starts, ends, posed = self._ends(vertices, surface)
        row, face = self._pairs(starts, ends.reshape(-1, 3))
        frame, edge = row // max(1, len(self._edges)), row % max(1, len(self._edges))
        corners = posed[frame[:, None], self._faces[face]].double()
        along, weights, outwards = _places(starts[frame, edge].double(), ends[frame, edge].double(), corners)
        return Crossings(frame, edge, face, along, weights, outwards, len(posed), len(self._edges))

    def _ends(
        self, vertices: np.ndarray | torch.Tensor, surface: np.ndarray | torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """(T, E, 3) first and second ends of the edges, and (T, M, 3) the surface, once it has been moved there."""
        points = torch.as_tensor(vertices).detach()
        if points.ndim != 3 or points.shape[-1] != 3:
            raise InputError(f"vertices must have shape (frames, N, 3), found {tuple(points.shape)}")
        posed = self._bvh.update(surface)
        if len(points) != len(posed):
            raise InputError(f"{len(points)} frames of edges, {len(posed)} of faces")
        points = points.to(posed.device, torch.float32)
        return points[:, self._edges[:, 0]], points[:, self._edges[:, 1]].contiguous(), posed

    def _passed(self, starts: torch.Tensor, ends: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """(T E,) int32, how many faces each edge passes through, and its first end, as `MeshBvh.points` has them."""
        from fusion.obstacles.crossing_kernels import passed_faces  # noqa: PLC0415 (heavy)

        flat = self._bvh.points(starts)
        counts = torch.full((len(flat),), -1, dtype=torch.int32, device=starts.device)
        nowhere = torch.zeros(1, dtype=torch.int32, device=starts.device)
        results = [ends.reshape(-1, 3), self._own.repeat(len(starts), 1), counts.clone(), counts]
        self._bvh.launch(passed_faces, flat, [nowhere], results, count=len(flat))
        return counts, flat

    def _pairs(self, starts: torch.Tensor, ends: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """(C,) rows of edges, frame by frame, and the faces that they pass through; both sorted."""
        from fusion.obstacles.crossing_kernels import passed_faces  # noqa: PLC0415 (heavy)

        device = starts.device
        counts, flat = self._passed(starts, ends)
        total = int(counts.sum())
        row = torch.repeat_interleave(torch.arange(len(counts), device=device), counts.long())
        faces = torch.zeros(total, dtype=torch.int32, device=device)
        if total:
            places = torch.where(counts > 0, counts.cumsum(0) - counts, -1).to(torch.int32)
            results = [ends, self._own.repeat(len(starts), 1), places, counts]
            self._bvh.launch(passed_faces, flat, [faces], results, count=len(flat))
        # The tree's order depends on the poses that it was built and refitted for.
        order = torch.argsort(row * len(self._faces) + faces)
        return row, faces.long()[order]


def edges_through_faces(
    vertices: np.ndarray,
    edges: np.ndarray,
    surface: np.ndarray,
    faces: np.ndarray,
    *,
    name: str = "body",
) -> Crossings:
    """Where edges of one mesh pass through faces of another, in every frame.

    Args:
        vertices: (T, N, 3) metres, of the mesh with the edges.
        edges: (E, 2) integers, as `Mesh.edges`.
        surface: (T, M, 3) metres, of the mesh with the faces.
        faces: (F, 3) integers.
        name: what error messages call the mesh with the faces.

    Raises:
        InputError: shapes that do not fit, faces out of range, or vertices that are not finite.
    """
    return _by_parts(EdgeCrossings(edges, faces, surface.shape[1], name=name), vertices, surface, len(edges))


def edges_through_own_faces(vertices: np.ndarray, edges: np.ndarray, faces: np.ndarray) -> Crossings:
    """Where edges of a mesh pass through those of its faces that they share no vertex with, in every frame.

    Args:
        vertices: (T, N, 3) metres.
        edges: (E, 2) integers, as `Mesh.edges`.
        faces: (F, 3) integers.

    Raises:
        InputError: shapes that do not fit, faces out of range, or vertices that are not finite.
    """
    search = EdgeCrossings(edges, faces, vertices.shape[1], itself=True, name="garment")
    return _by_parts(search, vertices, vertices, len(edges))


def _by_parts(search: EdgeCrossings, vertices: np.ndarray, surface: np.ndarray, n_edges: int) -> Crossings:
    """All frames, some at a time."""
    if len(vertices) != len(surface):
        raise InputError(f"{len(vertices)} frames of edges, {len(surface)} of faces")
    step = max(1, _ROWS // max(1, n_edges))
    parts, starts = [], range(0, len(vertices), step)
    for start in starts:
        parts.append(search.query(vertices[start : start + step], surface[start : start + step]))
    if not parts:
        nothing = torch.zeros(0, dtype=torch.int64)
        return Crossings(
            nothing, nothing, nothing, torch.zeros(0), torch.zeros(0, 3), nothing > 0, 0, n_edges
        )
    return Crossings(
        frame=torch.cat([part.frame + start for part, start in zip(parts, starts, strict=True)]),
        **{
            name: torch.cat([getattr(part, name) for part in parts])
            for name in ("edge", "face", "along", "weights", "outwards")
        },
        n_frames=len(vertices),
        n_edges=n_edges,
    )


def _places(
    start: torch.Tensor, end: torch.Tensor, corners: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """`along`, `weights` and `outwards` of `Crossings` for edges (C, 3) through faces (C, 3, 3)."""
    p, q, r = corners.unbind(1)
    normal = torch.linalg.cross(q - p, r - p)
    first, last = ((normal * (point - p)).sum(-1) for point in (start, end))
    direction = (end - start)[:, None]
    from_start = corners - start[:, None]
    opposite = torch.linalg.cross(from_start.roll(-1, 1), from_start.roll(-2, 1))
    volumes = (opposite * direction).sum(-1).abs()  # all of one sign, but for rounding
    return first / (first - last), volumes / volumes.sum(-1, keepdim=True), last > 0
