"""Pairs of neighbouring pixels that show one surface, and whether a position map keeps them together."""

from __future__ import annotations

from functools import cached_property
from threading import Lock
from typing import Any

import numpy as np
import scipy.sparse
import torch
from numpy.typing import NDArray

from render.maps.imager import TemplateImager
from render.mesh.measures import edge_lengths
from render.mesh.mesh import Mesh

# Rows down and columns to the right of a pixel's neighbours; the other four have it as theirs. The first two are
# the axes.
_OFFSETS = ((0, 1), (1, 0), (1, 1), (1, -1))
_AXES = 2
# Of images (S, H, W): first and second pixels of the links along rows, then of those along columns.
_AXIS_PARTS = ((np.s_[:, :, :-1], np.s_[:, :, 1:]), (np.s_[:, :-1], np.s_[:, 1:]))
# Limits are in pixel footprints, what neighbouring pixels are apart on the template, and in edges, so that they mean
# the same for every size of a garment.
_SURFACE = (
    4.0  # neighbours farther apart on the template show two surfaces, or one so edge-on that steps say little
)
# A step of a map fits if it is below twice the template's and a slack. Cloth does not stretch by as much: steps of
# clips simulated by two programs, of four garments at 32² to 512² pixels, are below twice the template's. The slack is
# for maps that are wrong a little everywhere, such as those blurred by two pixels where one surface ends before
# another. It is an edge's length, because the edge stage takes out what is less; in fine maps no more than five
# footprints, in coarse ones at least one.
_STRETCH, _FINE, _COARSE = 2.0, 5.0, 1.0
# A step to less than a fiftieth of the template's does not fit either: two pixels with one value, such as 0.
_COLLAPSED = 0.02
# Maps that are noisy all over are no reason to leave everything out: the slack is this many times the median by
# which their steps differ from the template's, if that is more.
_NOISE = 4.0
_SAMPLE = 2048  # links by which a map's noise is told
_MOST_RINGS = 6  # of faces, looked through to find how one pixel's face is joined to another's


class PixelLinks:
    """The links between neighbouring pixels of S views of H × W pixels.

    A link is a pixel and one of its eight neighbours, both covered and at most four footprints apart on the template.
    Those whose faces are not joined by few other faces, such as a sleeve and the shirt behind it, are no links either.

    Args:
        imager: of the template, N vertices.
        rest: the garment whose lengths count; same faces.
        device: on which `unfit` is asked.

    Attributes:
        pixels: (P,) int64, the covered pixels, counted through (S, H, W). All others are numbers of these, 0 to P - 1.
        first, second: (L,) int64, the pixels of each link; the first ones ascend.
        length: (L,) float64 metres, between them at rest.
        sample: (K,) int64, some of the links, evenly over all.
        footprint: metres, the median length of the links along rows and columns; 0 if there is none.
        slack: metres by which a step may be longer than twice the template's.
    """

    def __init__(self, imager: TemplateImager, rest: Mesh, device: torch.device) -> None:
        self._imager, self._device = imager, device
        self._points: list[tuple[Mesh, NDArray[np.float64]]] = []  # of meshes that were asked about
        self.pixels = np.flatnonzero(imager.raster.mask)
        first, second, direction = _neighbours(imager.raster.mask)
        apart = self._apart(imager.mesh, first, second)
        near = np.flatnonzero(apart <= _SURFACE * _median(apart[direction < _AXES]))
        near = near[np.argsort(first[near], kind="stable")]
        self.first, self.second, self._direction = first[near], second[near], direction[near]
        self.length = self._apart(rest, self.first, self.second)
        self.footprint = _median(self.length[self._direction < _AXES])
        edge = _median(edge_lengths(rest.vertices, rest.edges))
        self.slack = float(np.clip(edge, _COARSE * self.footprint, _FINE * self.footprint))
        self.sample = (
            np.unique(np.linspace(0, len(near) - 1, _SAMPLE).astype(np.int64)) if len(near) else near
        )
        rows, columns = (np.asarray(imager.raster.mask.any(axis=axes)) for axes in ((0, 2), (0, 1)))
        self._crop = (slice(None), _extent(rows), _extent(columns))  # of images: what any view covers
        # Squares of the steps between which all fit, in maps that are not noisy.
        self._squares = tuple(
            np.square(limit).astype(np.float32)
            for limit in (_COLLAPSED * self.length, _STRETCH * self.length + self.slack)
        )
        # Squared longest steps along rows and columns of the crop, infinite where there is no link.
        self._limits = self._limit_images(np.ones(len(self.first), bool))
        self._joined: NDArray[np.bool_] | None = None
        self._lock = Lock()

    def unfit(self, positions: torch.Tensor, known: torch.Tensor | None = None) -> torch.Tensor:
        """Which frames have a step along a row or a column that does not fit: a quick look at all of them.

        Args:
            positions: (T, S, H, W, 3) metres, on the device.
            known: (T, S, H, W) bool, pixels that count; None: all.

        Returns:
            (T,) bool.
        """
        limits, crop = self._limits, self._crop
        frames = []
        for frame, image in enumerate(positions):
            # One frame's numbers, component by component, stay in the processor's cache.
            points = image[crop].movedim(-1, 0).contiguous()
            counts = None if known is None else known[frame][crop]
            unfit = torch.zeros((), dtype=torch.bool, device=positions.device)
            for (before, after), limit in zip(_AXIS_PARTS, limits, strict=True):
                step = points[(slice(None), *after)] - points[(slice(None), *before)]
                step *= step
                far = step[0].add_(step[1]).add_(step[2]) > limit
                if counts is not None:
                    far &= counts[before] & counts[after]
                unfit |= far.any()
            frames.append(unfit)
        return torch.stack(frames)

    def fitting(
        self, points: np.ndarray, known: np.ndarray | None = None
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Which links count in one frame, and which of them its map keeps together.

        Args:
            points: (P, 3) metres, what the map says of the covered pixels.
            known: (P,) bool, pixels that count; None: all.

        Returns:
            (L,) bool each; those that fit are among those that count.
        """
        counts = self.joined if known is None else self.joined & known[self.first] & known[self.second]
        sample = self.sample[counts[self.sample]]
        off = np.abs(_steps(points, self.first[sample], self.second[sample]) - self.length[sample])
        slack = max(self.slack, _NOISE * _median(off))
        steps = _squared_steps(points, self.first, self.second)
        if slack == self.slack:
            shortest, longest = self._squares
            return counts, counts & (steps < longest) & (steps > shortest)
        # In a noisy map, two pixels may have one value by chance.
        return counts, counts & (steps < (_STRETCH * self.length + slack) ** 2)

    def scale(self, points: np.ndarray, links: np.ndarray | None = None) -> float:
        """Median of a map's steps over the template's; 1 of none.

        Args:
            points: (P, 3) metres.
            links: (L,) bool, those that are looked at; None: a sample of all that are joined.
        """
        chosen = self.sample[self.joined[self.sample]] if links is None else np.flatnonzero(links)
        steps = _steps(points, self.first[chosen], self.second[chosen])
        return _median(steps / self.length[chosen].clip(min=1e-12)) if len(chosen) else 1.0

    def per_pixel(self, links: np.ndarray, others: np.ndarray | None = None) -> NDArray[np.int64]:
        """(P,) how many of some links each pixel has; only those to some other pixels (P,) bool if given.

        Args:
            links: (L,) bool, or the numbers of a few.
        """
        first, second = self.first[links], self.second[links]
        count = np.zeros(len(self.pixels), np.int64)
        for one, other in ((first, second), (second, first)):
            count += np.bincount(one if others is None else one[others[other]], minlength=len(count))
        return count

    @cached_property
    def joined_per_pixel(self) -> NDArray[np.int64]:
        """(P,) how many links that are `joined` each pixel has."""
        return self.per_pixel(self.joined)

    @property
    def joined(self) -> NDArray[np.bool_]:
        """(L,) links whose faces are joined by few other faces. Looked up when a map first has something unfit."""
        with self._lock:
            if self._joined is None:
                faces = self._imager.raster.face_id.reshape(-1)[self.pixels]
                self._joined = _joined(self._imager.mesh, faces[self.first], faces[self.second], self.length)
                self._limits = self._limit_images(self._joined)  # what is no link cannot be unfit
            return self._joined

    def _limit_images(self, links: np.ndarray) -> tuple[torch.Tensor, ...]:
        """Of the links (L,) bool that are chosen."""
        images = []
        for direction, (before, _) in enumerate(_AXIS_PARTS):
            limit = np.full(self._imager.raster.face_id.shape, np.inf, np.float32)
            chosen = links & (self._direction == direction)
            longest = _STRETCH * self.length[chosen] + self.slack
            limit.reshape(-1)[self.pixels[self.first[chosen]]] = longest**2
            images.append(torch.from_numpy(limit[self._crop][before].copy()).to(self._device))
        return tuple(images)

    def _apart(self, mesh: Mesh, first: np.ndarray, second: np.ndarray) -> NDArray[np.float64]:
        """(L,) metres between the points of a mesh that covered pixels (L,) and others show."""
        return _steps(self.points_of(mesh), first, second)

    def points_of(self, mesh: Mesh) -> NDArray[np.float64]:
        """(P, 3) metres, the point of a mesh that each covered pixel shows; its faces are the template's."""
        for known, points in self._points:
            if known is mesh:
                return points
        vertices = torch.from_numpy(np.asarray(mesh.vertices, np.float64))
        points = self._imager.operator(vertices).reshape(-1, 3).numpy()[self.pixels]
        self._points.append((mesh, points))
        return points


def _steps(points: np.ndarray, first: np.ndarray, second: np.ndarray) -> NDArray[Any]:
    """(L,) metres between points (P, 3), in their dtype."""
    steps: NDArray[Any] = np.sqrt(_squared_steps(points, first, second))
    return steps


def _squared_steps(points: np.ndarray, first: np.ndarray, second: np.ndarray) -> NDArray[Any]:
    """(L,) square metres between points (P, 3), in their dtype."""
    squared: NDArray[Any] = np.zeros(len(first), points.dtype)
    for component in np.ascontiguousarray(points.T):
        step = component.take(second)  # faster than by index
        step -= component.take(first)
        step *= step
        squared += step
    return squared


def _neighbours(mask: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pairs of neighbouring covered pixels (L,), (L,), and the offset (L,) by which the second lies from the first."""
    number = np.cumsum(mask).reshape(mask.shape) - 1
    height, width = mask.shape[1:]
    parts = []
    for direction, (down, right) in enumerate(_OFFSETS):
        before = np.s_[:, : height - down, max(-right, 0) : width - max(right, 0)]
        after = np.s_[:, down:, max(right, 0) : width + min(right, 0)]
        both = mask[before] & mask[after]
        first = number[before][both]
        parts.append((first, number[after][both], np.full(len(first), direction)))
    firsts, seconds, directions = (np.concatenate(part) for part in zip(*parts, strict=True))
    return firsts, seconds, directions


def _extent(covered: np.ndarray) -> slice:
    """From the first to the last that is."""
    places = np.flatnonzero(covered)
    return slice(places[0], places[-1] + 1) if len(places) else slice(0, 0)


def _median(values: np.ndarray) -> float:
    return float(np.median(values)) if len(values) else 0.0


def _joined(mesh: Mesh, first: np.ndarray, second: np.ndarray, length: np.ndarray) -> NDArray[np.bool_]:
    """Whether faces are joined by as many rings of faces as lie within a length, and half as many more.

    Args:
        first, second: (L,) faces. length: (L,) metres.
    """
    corners = mesh.faces
    joined = np.zeros(len(first), bool)
    for corner in range(3):
        joined |= (corners[first] == corners[second][:, [corner]]).any(1)
    edge = max(_median(edge_lengths(mesh.vertices, mesh.edges)), 1e-9)
    rings = np.minimum(np.ceil(1.5 * length / edge) + 1, _MOST_RINGS)
    n = len(mesh.vertices)
    ends = np.concatenate([mesh.edges, mesh.edges[:, ::-1], np.arange(n)[:, None].repeat(2, 1)])
    ring = scipy.sparse.csr_matrix((np.ones(len(ends), bool), (ends[:, 0], ends[:, 1])), shape=(n, n))
    # Neighbours ask about the same two faces again and again.
    pairs, place = np.unique(np.stack([first, second], 1)[~joined], axis=0, return_inverse=True)
    allowed = np.zeros(len(pairs))
    np.maximum.at(allowed, place.reshape(-1), rings[~joined])
    reached, open_pairs = np.zeros(len(pairs), bool), np.arange(len(pairs))
    area, target = (_rows(corners[pairs[:, side]], n) for side in (0, 1))
    for grown in range(1, _MOST_RINGS + 1):
        area = area @ ring
        met = np.asarray(area.multiply(target).sum(1)).reshape(-1) > 0
        reached[open_pairs[met]] = True
        still = ~met & (allowed[open_pairs] > grown)
        open_pairs, area, target = open_pairs[still], area[still], target[still]
        if not len(open_pairs):
            break
    joined[~joined] = reached[place.reshape(-1)]
    return joined


def _rows(vertices: np.ndarray, n: int) -> scipy.sparse.csr_matrix:
    """(P, n) bool: the three vertices (P, 3) of each row."""
    rows = np.repeat(np.arange(len(vertices)), 3)
    return scipy.sparse.csr_matrix(
        (np.ones(len(rows), bool), (rows, vertices.reshape(-1))), shape=(len(vertices), n)
    )
