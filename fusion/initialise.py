"""Vertices from position maps: section 3.3 of the paper, "Vertex Position Initialization"."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from fusion.filling import Filling
from render.cameras import Camera
from render.errors import InputError
from render.maps.imager import TemplateImager
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
    weighted by how frontally each sees the template there. A vertex that no view sees, or that is read from pixels more
    than one away from it at a silhouette, is put where the template's
    shape, turned as the visible cloth around it is, wants it (`fusion.filling`). The paper interpolates between the
    closest visible vertices of two views, linearly by distance; that gives the chord in place of the surface, even on
    the template itself.

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
    """What is constant in `initial_vertices` (section 3.3): the weights of the readings, and the filling of the rest.

    Args:
        imager: of the template, S views and N vertices.
        shape: the garment at rest where it is another than the template, with the same faces; what is not seen keeps
            its offsets.

    Raises:
        InputError: no view sees any vertex.
    """

    def __init__(self, imager: TemplateImager, shape: Mesh | None = None) -> None:
        views, n = imager.visible.shape
        self._visible = imager.visible & _reads_its_place(imager)
        #: (N,) bool, vertices that at least one view sees, and reads at their place.
        self.seen = np.asarray(self._visible.any(axis=0))
        if not self.seen.any():
            raise InputError(
                f"{imager.mesh.source}: no view sees any of its {n} vertices; "
                "use larger maps or frame the cameras on it"
            )
        self._imager = imager
        frontal = np.stack([_frontality(imager.mesh, camera) for camera in imager.cameras])
        self._frontal = np.where(self._visible, frontal, 0)
        weight = self._frontal / self._frontal.sum(0).clip(min=_GRAZING)
        view, vertex = np.nonzero(self._visible)
        self._product = SparseProduct(vertex, view * n + vertex, weight[view, vertex], (n, views * n))
        shape = imager.mesh if shape is None else shape
        maps = imager.operator(torch.from_numpy(shape.vertices))
        self._filling = Filling(shape, self.seen, self._read(imager.sample(maps)).numpy())

    def __call__(self, readings: torch.Tensor) -> torch.Tensor:
        """Readings (..., S, N, 3) of `TemplateImager.sample` -> vertices (..., N, 3)."""
        vertices = self._read(readings)
        frames = vertices.reshape(-1, *vertices.shape[-2:])
        seen = torch.from_numpy(self.seen).to(frames.device).expand(len(frames), -1)
        return self._filling(frames, seen).reshape(vertices.shape)

    def put_back(self, vertices: torch.Tensor) -> torch.Tensor:
        """Vertices (T, N, 3) with the layers that no view sees against the cloth next to them (`Filling.put_back`)."""
        return self._filling.put_back(vertices)

    def _read(self, readings: torch.Tensor) -> torch.Tensor:
        """The mean of each vertex's readings, 0 where there is none."""
        return self._product(readings.reshape(*readings.shape[:-3], -1, 3))

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
        visible = torch.from_numpy(self._visible).to(positions.device)
        if confidence is None:
            vertices = self(self._imager.sample(positions))
            return Readings(vertices, visible.any(0).expand(len(positions), -1))
        known = (confidence > 0).to(positions)[..., None]
        # One sampling for all: positions, fraction of the reading that is known, confidence.
        images = positions.new_empty(*positions.shape[:-1], 5)
        torch.mul(positions, known, out=images[..., :3])
        images[..., 3:4], images[..., 4] = known, confidence
        sampled = self._imager.sample(images)
        fraction = sampled[..., 3]
        usable = visible & (fraction > _KNOWN)
        fraction = torch.where(usable, fraction, 1)
        trust = torch.where(usable, sampled[..., 4] / fraction, 0).clamp(min=0)
        weight = trust * torch.from_numpy(self._frontal).to(trust)
        seen = (weight > 0).any(1)
        weight = weight / torch.where(seen, weight.sum(1), 1)[:, None]
        vertices = (weight[..., None] * sampled[..., :3] / fraction[..., None]).sum(1)
        if not seen.any(1).all():
            raise InputError(
                "confidence: a frame has no pixel with a confidence above 0 at any vertex; leave it out"
            )
        mean = trust.sum(1) / visible.sum(0).clamp(min=1)
        return Readings(self._filling(vertices, seen), seen, torch.where(seen, mean, 0))


def _reads_its_place(imager: TemplateImager) -> np.ndarray:
    """(S, N) bool, vertices that a view reads within a pixel of where they are on the template's own maps.

    Where the silhouette or another surface leaves no pixel near, a visible vertex is read from farther ones.
    """
    rest = imager.mesh.vertices
    readings = imager.sample(imager.operator(torch.from_numpy(rest))).numpy()
    # Metres that a pixel spans at each vertex's depth.
    pixel = np.stack(
        [
            camera.project(imager.places)[:, 2] / (camera.projection[1, 1] * camera.size[0] / 2)
            for camera in imager.cameras
        ]
    )
    near: np.ndarray = np.linalg.norm(readings - rest, axis=-1) <= pixel
    return near


def _frontality(mesh: Mesh, camera: Camera) -> np.ndarray:
    """(N,) how frontally a camera sees each vertex of the template: |cos| of the angle, at least _GRAZING."""
    centre = -camera.view[:3, :3].T @ camera.view[:3, 3]
    sight = centre - mesh.vertices
    sight /= np.linalg.norm(sight, axis=1, keepdims=True)
    normals = vertex_normals(torch.from_numpy(mesh.vertices), torch.from_numpy(mesh.faces)).numpy()
    cosines: np.ndarray = np.abs((normals * sight).sum(1)).clip(min=_GRAZING)
    return cosines
