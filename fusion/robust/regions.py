"""Parts of a position map that hold together, but lie off what is around them."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import scipy.sparse
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from fusion.robust.map_fault import Kind, MapFault, place_on
from fusion.robust.pixel_links import PixelLinks
from render.maps.imager import TemplateImager
from render.mesh.mesh import Mesh
from render.mesh.rigid import rigid_rotation

_LEAST_PIXELS = 9  # of a region: below, a shift would be a guess, and the pixels are left out
_LEAST_FRACTION = 0.005  # of its view's covered pixels, the same for finer maps
_CLOSE_BY = 4  # pixels
_SCALED = (
    1.15  # a region is scaled if its steps, against the frame's, are longer or shorter by more than this
)


@dataclass(frozen=True, eq=False)
class FoundRegions:
    """What was found in one frame.

    Args:
        points: (P, 3) metres, with the regions where their surroundings want them.
        moved: (P,) bool, pixels of those regions.
        scraps: (P,) bool, pixels of parts that are too small to be regions.
        faults: the regions, and the parts whose pixels fit neither each other nor others.
    """

    points: NDArray[np.float32]
    moved: NDArray[np.bool_]
    scraps: NDArray[np.bool_]
    faults: list[MapFault]


class Regions:
    """Finds them in position maps of a template.

    Args:
        imager: of the template, S views of H × W pixels.
        rest: the garment whose shape counts; same faces.
        links: between its P covered pixels.
    """

    def __init__(self, imager: TemplateImager, rest: Mesh, links: PixelLinks) -> None:
        self._imager, self._links = imager, links
        mask = imager.raster.mask
        self._view, self._row, self._column = np.nonzero(mask)
        self._template, self._rest = (links.points_of(mesh) for mesh in (imager.mesh, rest))
        least = np.maximum(_LEAST_PIXELS, _LEAST_FRACTION * mask.sum((1, 2)))
        self._least = least[self._view]  # (P,), by the view that a pixel is of

    def find(
        self, points: np.ndarray, counts: np.ndarray, fits: np.ndarray, kept: np.ndarray
    ) -> FoundRegions:
        """The regions of one frame.

        A part of a map is what fitting links hold together. The largest part of each surface stays where it is. Every
        other that borders on one that stays is a region: if its steps are longer or shorter than the frame's, it is
        scaled about its middle, and it is shifted by the median of what its border is off. The largest come first,
        and then stay themselves.

        Args:
            points: (P, 3) metres.
            counts, fits: (L,) bool, links that count, and those of them that fit.
            kept: (P,) bool, pixels that fit most of their neighbours.
        """
        faults = self._unfit(points, counts, kept)
        moved, scraps = np.zeros(len(points), bool), np.zeros(len(points), bool)
        torn, part = self._tears(counts & kept[self._links.first] & kept[self._links.second], fits)
        if not len(torn):
            return FoundRegions(points, moved, scraps, faults)
        size = np.bincount(part[kept], minlength=len(points))
        stays = _largest(part[kept], self._parts(counts)[kept], size)
        bordering = np.unique(part[torn])
        pixels_of = {int(label): kept & (part == label) for label in bordering[~stays[bordering]]}
        for label, pixels in list(pixels_of.items()):
            if size[label] < self._least[pixels].max():
                scraps |= pixels_of.pop(label)
        points, usual = points.copy(), self._links.scale(points)
        while pixels_of:
            borders = {
                label: torn[(part[torn[:, 0]] == label) & stays[part[torn[:, 1]]]] for label in pixels_of
            }
            reached = [label for label, border in borders.items() if len(border)]
            if not reached:  # it borders on nothing that stays but by pixels that are left out
                break
            label = max(reached, key=lambda label: (size[label], -label))
            pixels = pixels_of.pop(label)
            scale = self._links.scale(points, fits & (part[self._links.first] == label)) / usual
            offset = self._bring_back(points, pixels, borders[label], scale)
            faults.append(self._fault("offset", pixels, offset, scale))
            moved |= pixels
            stays[label] = True
        return FoundRegions(points, moved, scraps, faults)

    def _tears(self, links: np.ndarray, fits: np.ndarray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Where a map is torn, by its links (L,) bool and those that fit.

        Returns:
            (2 K, 2) neighbouring pixels of different parts, each pair both ways; (P,) the number of each pixel's part.
        """
        first, second = self._links.first, self._links.second
        apart = np.flatnonzero(links & ~fits)
        # Most pixels that lie too far apart hang together by others close by; only then all are looked at.
        near = self._near(first[apart])
        close = np.flatnonzero(near[first] & near[second])
        for some in (close[links[close] & fits[close]], None):
            part = self._parts(np.flatnonzero(links & fits) if some is None else some)
            torn = apart[part[first[apart]] != part[second[apart]]]
            if not len(torn):
                break
        pairs = np.stack([first[torn], second[torn]], axis=1)
        return np.concatenate([pairs, pairs[:, ::-1]]), part

    def _near(self, pixels: np.ndarray) -> NDArray[np.bool_]:
        """(P,) bool, pixels close to some pixels (K,)."""
        image = np.zeros(self._imager.raster.face_id.shape, np.uint8)
        image[self._view[pixels], self._row[pixels], self._column[pixels]] = 1
        kernel = np.ones((2 * _CLOSE_BY + 1,) * 2, np.uint8)
        near = np.stack([cv2.dilate(view, kernel) for view in image])
        return near[self._view, self._row, self._column] > 0

    def _bring_back(self, points: np.ndarray, pixels: np.ndarray, border: np.ndarray, scale: float) -> float:
        """Scale a region and shift it to where its border (K, 2), inner and outer pixels, belongs.

        Returns:
            How far it was shifted, metres.
        """
        inside, rest = points[pixels].astype(np.float64), self._rest[pixels]
        middle = inside.mean(0)
        if not 1 / _SCALED <= scale <= _SCALED:
            inside = middle + (inside - middle) / scale
            points[pixels] = inside
        turn = rigid_rotation(rest, inside)
        inner, outer = border.T
        wanted = points[outer] + (self._rest[inner] - self._rest[outer]) @ turn.T
        offset = np.median(points[inner] - wanted, axis=0)
        points[pixels] = inside - offset
        return float(np.linalg.norm(offset))

    def _unfit(self, points: np.ndarray, counts: np.ndarray, kept: np.ndarray) -> list[MapFault]:
        """Parts of pixels that are left out, deep enough to have pixels of which all neighbours are left out, too."""
        first, second = self._links.first, self._links.second
        dropped = ~kept
        if 2 * dropped.sum() < self._least.min():
            return []
        deep = dropped.copy()
        for one, other in ((first, second), (second, first)):
            deep[one[counts & kept[other]]] = False
        if not deep.any():
            return []
        among = counts & dropped[first] & dropped[second]
        part = self._parts(among)
        faults = []
        for label in np.unique(part[deep]):
            pixels = dropped & (part == label)
            if 2 * (deep & pixels).sum() >= self._least[pixels].max():
                faults.append(
                    self._fault("unfit", pixels, 0.0, self._links.scale(points, among & pixels[first]))
                )
        return faults

    def _parts(self, links: np.ndarray) -> NDArray[np.int64]:
        """(P,) which pixels some links connect, (L,) bool or their numbers in order: a number a part."""
        n = len(self._view)
        starts = np.concatenate([[0], np.cumsum(np.bincount(self._links.first[links], minlength=n))])
        ends = self._links.second[links]
        graph = scipy.sparse.csr_matrix((np.ones(len(ends), bool), ends, starts), shape=(n, n))
        labels: NDArray[np.int64] = connected_components(graph, directed=False)[1].astype(np.int64)
        return labels

    def _fault(self, kind: Kind, pixels: np.ndarray, offset: float, scale: float) -> MapFault:
        row, column = self._row[pixels], self._column[pixels]
        vertex, place = place_on(self._imager.mesh, self._template[pixels])
        return MapFault(
            kind=kind,
            view=self._imager.cameras[self._view[pixels][0]].name,
            pixels=len(row),
            rows=(int(row.min()), int(row.max())),
            columns=(int(column.min()), int(column.max())),
            vertex=vertex,
            place=place,
            offset_m=offset,
            scale=scale,
        )


def _largest(part: np.ndarray, surface: np.ndarray, size: np.ndarray) -> NDArray[np.bool_]:
    """Which parts are the largest of their surface: (as many as `size`) bool.

    Args:
        part, surface: (K,) numbers of each pixel.
        size: pixels of each part, by its number.
    """
    ascending = np.argsort(size[part], kind="stable")
    largest = np.zeros(len(size), np.int64)
    largest[surface[ascending]] = part[ascending]  # the last one stays
    stays = np.zeros(len(size), bool)
    stays[largest[surface]] = True
    return stays
