"""Faults of position maps as wholes: larger or smaller than the garment, or one view elsewhere than another."""

from __future__ import annotations

import itertools

import numpy as np
import torch
from numpy.typing import NDArray

from fusion.robust.map_fault import MapFault
from fusion.robust.pixel_links import PixelLinks
from render.maps.imager import TemplateImager
from render.mesh.measures import edge_lengths
from render.mesh.mesh import Mesh

# Spans of some edges have a median of 0.991 to 1.007 of the garment's in true maps of simulated clips, at 32² to 256²
# pixels, and of 0.98 to 0.993 in those that a trained network predicts.
_LARGER = 1.07
_SPAN, _STRAIGHT, _MOST_SPANS = (
    3.0,
    0.2,
    512,
)  # edges; by how much a span may differ from its pixels' footprints
# Two views disagree if half of what both see is farther apart than the garment allows by so many times the slack of
# neighbouring pixels. They see it along the surface, where a blur by two pixels parts them by up to two slacks.
_APART = 2.5
_FEWEST, _MOST = 8, 128  # pairs of pixels, for a median that means something and costs nothing
_NEAR = 2.0  # footprints: a pixel shows a vertex's own cloth if it is no farther from it on the template


class WholeMaps:
    """What can be told of whole maps, in every frame.

    Args:
        imager: of the template, S views of H × W pixels.
        links: between neighbouring pixels.
        rest: the garment whose lengths count; same faces.
        device: of the maps.
    """

    def __init__(self, imager: TemplateImager, links: PixelLinks, rest: Mesh, device: torch.device) -> None:
        self._apart_m = _APART * links.slack
        self._n_pixels = len(links.pixels)
        pairs = {}
        spans = _spans(imager.raster.mask, links, rest)
        if len(spans) >= _FEWEST:
            pairs[""] = spans
        own = _own_pixels(imager, links)
        for one, other in itertools.combinations(range(len(own)), 2):
            shared = _shared(imager.mesh, own[one], own[other])
            if len(shared) >= _FEWEST:
                pairs[f"{imager.cameras[one].name} and {imager.cameras[other].name}"] = shared
        self._ends = {name: torch.from_numpy(links.pixels[ends]).to(device) for name, ends in pairs.items()}
        points = torch.from_numpy(links.points_of(rest))
        self._lengths = {
            name: torch.linalg.vector_norm(points[ends[:, 0]] - points[ends[:, 1]], dim=-1).float().to(device)
            for name, ends in pairs.items()
        }

    def faults(self, positions: torch.Tensor, known: torch.Tensor | None) -> list[list[MapFault]]:
        """What is wrong in each of some frames.

        Args:
            positions: (T, S, H, W, 3) metres.
            known: (T, S, H, W) bool, pixels that count; None: all.
        """
        faults: list[list[MapFault]] = [[] for _ in positions]
        points = positions.flatten(1, 3)
        for view, ends in self._ends.items():
            first, second = ends.T
            steps = torch.linalg.vector_norm(points[:, first] - points[:, second], dim=-1)
            if known is not None:
                counts = known.flatten(1)
                steps = torch.where(counts[:, first] & counts[:, second], steps, torch.nan)
            if view:
                measured = (steps - self._lengths[view]).nanmedian(1).values
                wrong = measured > self._apart_m
            else:
                measured = (steps / self._lengths[view].clamp(min=1e-12)).nanmedian(1).values
                wrong = (measured > _LARGER) | (measured < 1 / _LARGER)
            for frame in wrong.nonzero()[:, 0].tolist():
                value = float(measured[frame])
                if view:
                    fault = MapFault("views", view, self._n_pixels, offset_m=value)
                else:
                    fault = MapFault("scale", view, self._n_pixels, scale=value)
                faults[frame].append(fault)
        return faults


def _spans(mask: np.ndarray, links: PixelLinks, rest: Mesh) -> NDArray[np.int64]:
    """Pixels of one row or column that are some edges apart on the garment, (K, 2) of them, at most _MOST_SPANS.

    Steps between neighbours would not do: noise in every pixel makes all of them longer.
    """
    number = np.where(mask, np.cumsum(mask).reshape(mask.shape) - 1, -1)
    points = links.points_of(rest)
    edge = float(np.median(edge_lengths(rest.vertices, rest.edges)))
    apart = max(1, round(_SPAN * edge / max(links.footprint, 1e-9)))
    rows = np.stack([number[:, :, :-apart].ravel(), number[:, :, apart:].ravel()], axis=1)
    columns = np.stack([number[:, :-apart].ravel(), number[:, apart:].ravel()], axis=1)
    pairs = np.concatenate([rows, columns])
    pairs = pairs[(pairs >= 0).all(1)]
    pairs = pairs[np.linspace(0, len(pairs) - 1, min(len(pairs), 4 * _MOST_SPANS)).astype(np.int64)]
    length = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
    straight = np.abs(length / (apart * max(links.footprint, 1e-9)) - 1) < _STRAIGHT
    spans: NDArray[np.int64] = pairs[straight][:: max(1, int(straight.sum()) // _MOST_SPANS)]
    return spans


def _own_pixels(imager: TemplateImager, links: PixelLinks) -> NDArray[np.int64]:
    """(S, N) the covered pixel that shows the cloth at each vertex in each view, -1 where there is none."""
    mask, vertices = imager.raster.mask, imager.mesh.vertices
    number = np.where(mask, np.cumsum(mask).reshape(mask.shape) - 1, -1)
    points, height, width = links.points_of(imager.mesh), *imager.size
    own = np.full(imager.visible.shape, -1)
    for view, camera in enumerate(imager.cameras):
        seen = np.flatnonzero(imager.visible[view])
        column, row = np.floor(camera.project(imager.places[seen])[:, :2]).astype(np.int64).T
        pixel = number[view, row.clip(0, height - 1), column.clip(0, width - 1)]
        far = np.linalg.norm(points[pixel] - vertices[seen], axis=1) > _NEAR * links.footprint
        own[view, seen] = np.where(far, -1, pixel)
    return own


def _shared(mesh: Mesh, one: np.ndarray, other: np.ndarray) -> NDArray[np.int64]:
    """Pixels of two views that show the same vertex or the ends of an edge, (K, 2) of them, at most _MOST.

    Args:
        one, other: (N,) the pixel of each vertex, -1 where there is none.
    """
    vertices = np.arange(len(mesh.vertices))[:, None].repeat(2, 1)
    ends = np.concatenate([vertices, mesh.edges, mesh.edges[:, ::-1]])
    pairs = np.stack([one[ends[:, 0]], other[ends[:, 1]]], axis=1)
    pairs = pairs[(pairs >= 0).all(1)]
    if len(pairs) <= _MOST:
        return pairs
    return pairs[np.linspace(0, len(pairs) - 1, _MOST).astype(np.int64)]
