"""Clips and predictions in motion, read frame by frame, with their truth and their maps."""

from __future__ import annotations

from functools import cached_property, partial

import numpy as np
import torch

from imgtransfer.data.canonical import root_frames
from imgtransfer.data.clip import Clip
from imgtransfer.viewing.frame import Dress, Frame, MapImages
from imgtransfer.viewing.sources import Showing
from imgtransfer.viewing.window import clip_window, map_window
from render import InputError, Mesh, PositionBox, TemplateImager, open_maps

_SIZE = (192, 192)  # of the maps that are made of clips without any


class ClipMotion:
    """A clip's garment, its own or a predicted one; only what is shown is read.

    Args:
        showing: what it is.
        truth: where the garment should be; None, and the showing itself, are nothing to compare with.

    Raises:
        InputError: it cannot be read, or its truth is of another garment.
    """

    def __init__(self, showing: Showing, truth: Showing | None = None) -> None:
        reader = showing.reader()
        self.title, self.n_frames = showing.title, reader.n_frames
        self._window = clip_window(reader)
        first, _ = self._window(0)
        self.fps = first.fps
        self._maps = None if showing.maps is None else open_maps(showing.maps)
        if self._maps is not None:
            self._map_window = map_window(self._maps)
        self._truth, self._truth_frames = None, 0
        if truth is not None and truth != showing:
            true = truth.reader()
            self._truth, self._truth_frames = clip_window(true), true.n_frames
            if not _same_garment(self._truth(0)[0], first):
                raise InputError(
                    f"{showing.ref.source}: clip {showing.clip} is of another garment than in {truth.ref.source}, so "
                    "their vertices cannot be compared; leave one of the two out"
                )
        rest = Mesh(first.template.vertices.astype(np.float64), first.template.faces, showing.title)
        body = Mesh(first.body.rest.astype(np.float64), first.body.faces, f"{showing.title}: body")
        self.dress = Dress(rest, body, lambda: self._imager)

    @cached_property
    def _imager(self) -> TemplateImager:
        if self._maps is None:
            return TemplateImager.build(self.dress.rest, size=_SIZE)
        maps, _ = self._map_window(0)
        return maps.imager()

    @cached_property
    def _box(self) -> PositionBox:
        """For maps that are made here: around the garment at rest."""
        return PositionBox.around(self.dress.rest.vertices)

    def frame(self, number: int) -> Frame:
        """See `Motion`."""
        clip, row = self._window(number)
        truth = None
        if self._truth is not None and number < self._truth_frames:
            true, true_row = self._truth(number)
            truth = None if true.garment is None else true.garment.vertices[true_row]
        garment = None if clip.garment is None else clip.garment.vertices[row]
        return Frame(garment, clip.body.vertices[row], truth, partial(self._images, clip, number, row))

    def _images(self, clip: Clip, number: int, row: int) -> MapImages | None:
        """The maps that were predicted for a frame, or those of a clip's own garment."""
        if self._maps is not None:
            if number >= self._maps.n_frames:
                return None
            part, map_row = self._map_window(number)
            position, normal = (None if a is None else a[map_row] for a in (part.position, part.normal))
            return MapImages(part.views, position, normal, part.mask)
        if clip.garment is None:
            return None
        one = clip.slice(slice(row, row + 1))
        assert one.garment is not None
        vertices = root_frames(one, "root").to_canonical(one.garment.vertices)
        position, normal = self._imager.maps(torch.from_numpy(vertices), self._box)
        names = tuple(camera.name for camera in self._imager.cameras)
        return MapImages(names, position[0].numpy(), normal[0].numpy(), self._imager.mask.numpy())


def motions_of(showings: tuple[Showing, ...], truth: Showing | None) -> list[ClipMotion]:
    """All that is shown of a clip.

    Raises:
        InputError: as `ClipMotion`.
    """
    return [ClipMotion(showing, truth) for showing in showings]


def _same_garment(one: Clip, other: Clip) -> bool:
    return one.template.vertices.shape == other.template.vertices.shape and np.array_equal(
        one.template.faces, other.template.faces
    )
