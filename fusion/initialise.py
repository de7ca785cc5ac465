"""Vertices from position maps: section 3.3 of the paper, "Vertex Position Initialization"."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse
import torch
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from render.cameras import Camera
from render.errors import InputError
from render.maps.imager import TemplateImager
from render.mesh.measures import edge_lengths
from render.mesh.mesh import Mesh
from render.mesh.normals import vertex_normals
from render.mesh.sparse import SparseProduct

# Weight of a view that looks along the surface at a vertex, against 1 for one that looks straight at it.
_GRAZING = 0.01
# Fraction of a reading's weights that must lie on pixels with a confidence, lest the rest be blown up.
_KNOWN = 0.5


def initial_vertices(imager: TemplateImager, positions: torch.Tensor) -> torch.Tensor:
    """Read every vertex from the position maps.

    A visible vertex takes the value of the maps at its projection; where several views see it, their mean,
    weighted by how frontally each sees the template there. A vertex that no view sees takes the values at the
    closest visible vertices of the two views that have the closest ones (front and back, for the paper's
    views), interpolated linearly by distance. Distances run along the template's edges, so that a sleeve does
    not borrow from the torso.

    Args:
        imager: of the template.
        positions: (..., S, H, W, 3) metres.

    Returns:
        (..., N, 3) metres, same dtype and device.

    Raises:
        InputError: no view sees any vertex, or maps of another size.
    """
    return InitialWeights(imager)(imager.sample(positions))


@dataclass(frozen=True, eq=False)
class Readings:
    """Vertices read from position maps.

    Args:
        vertices: (T, N, 3) metres.
        seen: (T, N) bool, vertices that were read; the others were filled in from those.
        confidence: (T, N), mean confidence of each vertex's readings, 0 where not seen; None: 1 each.
    """

    vertices: torch.Tensor
    seen: torch.Tensor
    confidence: torch.Tensor | None = None


class InitialWeights:
    """The constant weights of `initial_vertices` (section 3.3): every vertex as a mean of readings of the maps.

    Args:
        imager: of the template, S views and N vertices.

    Raises:
        InputError: no view sees any vertex.
    """

    def __init__(self, imager: TemplateImager) -> None:
        views, n = imager.visible.shape
        #: (N,) bool, vertices that at least one view sees.
        self.seen = imager.visible.any(axis=0)
        if not self.seen.any():
            raise InputError(
                f"{imager.mesh.source}: no view sees any of its {n} vertices; "
                "use larger maps or frame the cameras on it"
            )
        self._imager = imager
        frontal = np.stack([_frontality(imager.mesh, camera) for camera in imager.cameras])
        self._frontal = np.where(imager.visible, frontal, 0)
        weight = self._frontal / self._frontal.sum(0).clip(min=_GRAZING)
        view, vertex = np.nonzero(imager.visible)
        readings = scipy.sparse.coo_matrix(
            (weight[view, vertex], (vertex, view * n + vertex)), shape=(n, views * n)
        )
        self._filling = _between_views(imager.mesh, imager.visible)
        combined = (self._filling @ readings.tocsr()).tocoo()
        self._product = SparseProduct(combined.row, combined.col, combined.data, combined.shape)

    def __call__(self, readings: torch.Tensor) -> torch.Tensor:
        """Readings (..., S, N, 3) of `TemplateImager.sample` -> vertices (..., N, 3)."""
        return self._product(readings.reshape(*readings.shape[:-3], -1, readings.shape[-1]))

    def read(self, positions: torch.Tensor, confidence: torch.Tensor | None = None) -> Readings:
        """Vertices from position maps of which some pixels may be worth less than others.

        Views count by their confidence at a vertex, besides how frontally they see it. Pixels with confidence 0 are
        left out of the readings; a vertex that has no other is filled in like one that no view sees.

        Args:
            positions: (T, S, H, W, 3) metres.
            confidence: (T, S, H, W), at least 0, same dtype and device; None: 1 everywhere.

        Raises:
            InputError: a frame in which nothing with a confidence shows a vertex.
        """
        visible = torch.from_numpy(self._imager.visible).to(positions.device)
        if confidence is None:
            vertices = self(self._imager.sample(positions))
            return Readings(vertices, visible.any(0).expand(len(positions), -1))
        known = (confidence > 0).to(positions)[..., None]
        # One sampling for all: positions, fraction of the reading that is known, confidence.
        sampled = self._imager.sample(torch.cat([positions * known, known, confidence[..., None]], dim=-1))
        fraction = sampled[..., 3]
        usable = visible & (fraction > _KNOWN)
        fraction = torch.where(usable, fraction, 1)
        trust = torch.where(usable, sampled[..., 4] / fraction, 0).clamp(min=0)
        weight = trust * torch.from_numpy(self._frontal).to(trust)
        seen = (weight > 0).any(1)
        weight = weight / torch.where(seen, weight.sum(1), 1)[:, None]
        vertices = (weight[..., None] * sampled[..., :3] / fraction[..., None]).sum(1)
        vertices = torch.stack(
            [self._filled(*frame) for frame in zip(vertices, (weight > 0).cpu().numpy(), strict=True)]
        )
        mean = trust.sum(1) / visible.sum(0).clamp(min=1)
        return Readings(vertices, seen, torch.where(seen, mean, 0))

    def _filled(self, vertices: torch.Tensor, usable: np.ndarray) -> torch.Tensor:
        """Vertices (N, 3) of one frame, those that no reading (S, N) of it shows put between others."""
        if not usable.any():
            raise InputError(
                "confidence: a frame has no pixel with a confidence above 0 at any vertex; leave it out"
            )
        filling = self._filling
        if (usable != self._imager.visible).any():
            filling = _between_views(self._imager.mesh, usable)
        entries = filling.tocoo()
        return SparseProduct(entries.row, entries.col, entries.data, entries.shape)(vertices)


def _frontality(mesh: Mesh, camera: Camera) -> np.ndarray:
    """(N,) how frontally a camera sees each vertex of the template: |cos| of the angle, at least _GRAZING."""
    centre = -camera.view[:3, :3].T @ camera.view[:3, 3]
    sight = centre - mesh.vertices
    sight /= np.linalg.norm(sight, axis=1, keepdims=True)
    normals = vertex_normals(torch.from_numpy(mesh.vertices), torch.from_numpy(mesh.faces)).numpy()
    cosines: np.ndarray = np.abs((normals * sight).sum(1)).clip(min=_GRAZING)
    return cosines


def _between_views(mesh: Mesh, visible: np.ndarray) -> scipy.sparse.csr_matrix:
    """(N, N) weights over seen vertices: the identity for seen ones, the closest of two views for others."""
    n, seen = visible.shape[1], visible.any(axis=0)
    unseen = np.flatnonzero(~seen)
    distance, source = _closest_along_edges(mesh, visible)
    if len(visible) > 2:
        order = np.argsort(distance, axis=0)[:2]
        distance, source = np.take_along_axis(distance, order, 0), np.take_along_axis(source, order, 0)
    distance, source = distance[:, unseen], source[:, unseen]
    lost = ~np.isfinite(distance).any(axis=0)
    if lost.any():  # pieces of cloth that no view sees at all: the closest seen vertex through space
        _, nearest = cKDTree(mesh.vertices[seen]).query(mesh.vertices[unseen[lost]])
        distance[0, lost], source[0, lost] = 1.0, np.flatnonzero(seen)[nearest]
    closeness = np.where(
        np.isfinite(distance), 1 / distance, 0
    )  # two views: the linear interpolation between them
    closeness /= closeness.sum(axis=0)
    keep = closeness > 0
    rows = np.broadcast_to(unseen, closeness.shape)[keep]
    identity = np.flatnonzero(seen)
    return scipy.sparse.csr_matrix(
        (
            np.concatenate([np.ones(len(identity)), closeness[keep]]),
            (np.concatenate([identity, rows]), np.concatenate([identity, source[keep]])),
        ),
        shape=(n, n),
    )


def _closest_along_edges(mesh: Mesh, visible: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Per view, how far along edges each vertex's closest visible vertex is, and which it is.

    Returns:
        (S, N) distances in metres, infinite where no visible vertex is connected; (S, N) vertex numbers.
    """
    n, edges = len(mesh.vertices), mesh.edges
    length = edge_lengths(mesh.vertices, edges)
    # An edge of no length would count as no edge at all.
    graph = scipy.sparse.csr_matrix((length.clip(min=1e-9), (edges[:, 0], edges[:, 1])), shape=(n, n))
    distance, source = np.full(visible.shape, np.inf), np.zeros(visible.shape, np.int64)
    for view, sees in enumerate(visible):
        if sees.any():
            distance[view], _, source[view] = dijkstra(
                graph, directed=False, indices=np.flatnonzero(sees), min_only=True, return_predecessors=True
            )
    return distance, source
