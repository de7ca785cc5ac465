"""Which pixels of position maps do not fit their neighbours, and what lies elsewhere as a whole."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from fusion.robust.map_fault import MapFault, MapFindings
from fusion.robust.pixel_links import PixelLinks
from fusion.robust.regions import Regions
from fusion.robust.whole_maps import WholeMaps
from render.maps.imager import TemplateImager
from render.mesh.mesh import Mesh

# Where more of a frame does not fit than this, nothing tells what is right, and nothing is left out.
_MOST_LEFT_OUT = 0.5
# What a pixel of a region counts that was brought back to its surroundings: how it lies in itself is known, where it
# lies only roughly, and edges shall have the last word.
_BROUGHT_BACK = 0.1


@dataclass(frozen=True, eq=False)
class JudgedMaps:
    """Position maps of T frames, and what their pixels count.

    Args:
        positions: (T, S, H, W, 3) metres; regions that lay elsewhere are brought back to their surroundings.
        confidence: (T, S, H, W), what was given times what was found; None: 1 everywhere.
        findings: what was wrong; None where nothing was looked for.
    """

    positions: torch.Tensor
    confidence: torch.Tensor | None
    findings: MapFindings | None = None


class AutomaticConfidence:
    """Finds pixels that do not fit their neighbours. Frames are judged one by one; most need no more than a look.

    A pixel fits a neighbour if the map's step between them is as long as cloth allows (`PixelLinks`). It is kept if it
    fits more than half of its neighbours, and again more than half of those that are kept; one without neighbours is
    kept. Regions that hold together, but not with what is around them, are brought back to it (`Regions`); those that
    are too small for that are left out. Maps in which every step along rows and columns fits are returned as they are.

    Args:
        imager: of the template.
        rest: the garment whose lengths count; same faces.
        device: of the maps.
    """

    def __init__(self, imager: TemplateImager, rest: Mesh, device: torch.device) -> None:
        self._links = PixelLinks(imager, rest, device)
        self._regions = Regions(imager, rest, self._links)
        self._whole = WholeMaps(imager, self._links, rest, device)
        self._pixels = torch.from_numpy(self._links.pixels).to(device)

    def judge(self, positions: torch.Tensor, confidence: torch.Tensor | None) -> JudgedMaps:
        """Judge the position maps of some frames.

        Args:
            positions: (T, S, H, W, 3) metres, finite, on the device.
            confidence: (T, S, H, W) at least 0; pixels with 0 are not looked at. None: 1 everywhere.

        Returns:
            The same tensors where nothing was left out or brought back.
        """
        known = None if confidence is None else confidence > 0
        left_out, faults = np.zeros(len(positions)), self._whole.faults(positions, known)
        judged: dict[int, _JudgedFrame] = {}
        for frame in self._links.unfit(positions, known).nonzero()[:, 0].tolist():
            points = positions[frame].reshape(-1, 3)[self._pixels].cpu().numpy()
            counted = None if known is None else known[frame].reshape(-1)[self._pixels].cpu().numpy()
            result = self._frame(points, counted)
            if result is not None:
                judged[frame] = result
                left_out[frame] = result.left_out
                faults[frame] += result.faults
        findings = MapFindings(left_out, faults)
        if not judged:
            return JudgedMaps(positions, confidence, findings)
        if any(result.points is not None for result in judged.values()):
            positions = positions.clone()
        confidence = torch.ones_like(positions[..., 0]) if confidence is None else confidence.clone()
        for frame, result in judged.items():
            if result.points is not None:
                positions[frame].view(-1, 3)[self._pixels] = torch.from_numpy(result.points).to(positions)
            confidence[frame].view(-1)[self._pixels] *= torch.from_numpy(result.confidence).to(confidence)
        return JudgedMaps(positions, confidence, findings)

    def _frame(self, points: np.ndarray, known: np.ndarray | None) -> _JudgedFrame | None:
        """One frame's covered pixels (P, 3), those known (P,); None if nothing in it is to be changed."""
        counts, fits = self._links.fitting(points, known)
        kept = self._fitting_most(counts, fits, all_known=known is None)
        found = self._regions.find(points, counts, fits, kept)
        dropped = ~kept | found.scraps
        if known is not None:
            dropped &= known
        left_out = float(dropped.sum() / (len(points) if known is None else known.sum()))
        if left_out > _MOST_LEFT_OUT or not (left_out or found.faults):
            return None
        confidence = np.where(dropped, 0.0, np.where(found.moved, _BROUGHT_BACK, 1.0))
        moved = found.points if found.moved.any() else None
        return _JudgedFrame(moved, confidence, left_out, found.faults)

    def _fitting_most(
        self, counts: np.ndarray, fits: np.ndarray, *, all_known: bool = False
    ) -> NDArray[np.bool_]:
        """(P,) pixels that fit more than half of their neighbours; links (L,) that count, and that fit.

        `all_known` says that those that count are all that are joined.
        """
        links = self._links
        unfit = np.flatnonzero(counts & ~fits)
        neighbours = links.joined_per_pixel if all_known else links.per_pixel(counts)
        alone = neighbours == 0
        kept: NDArray[np.bool_] = (2 * links.per_pixel(unfit) < neighbours) | alone
        if kept.all():
            return kept
        # A second time, without neighbours that are wrong themselves.
        dropped = ~kept
        bordering = np.flatnonzero(counts & (dropped[links.first] | dropped[links.second]))
        neighbours = neighbours - links.per_pixel(bordering, dropped)
        kept = (2 * links.per_pixel(unfit, kept) < neighbours) | alone
        return kept


@dataclass(frozen=True, eq=False)
class _JudgedFrame:
    points: np.ndarray | None  # None: as they were
    confidence: np.ndarray
    left_out: float
    faults: list[MapFault]
