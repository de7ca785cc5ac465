"""Mirror images: what the cameras would have seen had the person's left been the right."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import fields, replace
from typing import Any, TypeVar

import torch
from torch import Tensor

from imgtransfer.network.base import Guess
from imgtransfer.network.local_view import TemplateView, mirrored_features, mirrored_template
from imgtransfer.network.maps import BodyMaps, ImagePair
from imgtransfer.network.residuals import mean_direction
from render import InputError, PositionBox, TemplateImager, decode_normals, encode_normals

Maps = TypeVar("Maps", ImagePair, BodyMaps)
Garment = ImagePair | TemplateView


class Mirror:
    """Mirrors images in the plane x = centre: columns are flipped, and the x of positions and normals turned round.

    All cameras must stand in that plane, as front and back do at any height and of any layer.

    Args:
        imager: of the garment.
        mask: (S, H, W) bool, the garment's silhouette on the device of the images.
        body_mask: (S, H, W) bool, the body's.
        box: of the encoded positions.

    Raises:
        InputError: a view that is not symmetric in itself.
    """

    def __init__(self, imager: TemplateImager, mask: Tensor, body_mask: Tensor, box: PositionBox) -> None:
        # A camera whose right is along x sees a mirror image as its own image flipped.
        asymmetric = [camera.name for camera in imager.cameras if abs(camera.view[0, 0]) != 1]
        if asymmetric:
            raise InputError(
                "training.mirror needs views from azimuth 0 or 180 only, such as front and back; found "
                f"{', '.join(asymmetric)}"
            )
        centre = float(imager.cameras[0].view[:3, :3].T[0] @ -imager.cameras[0].view[:3, 3])  # the camera's x
        self._twice_m = 2 * centre
        self._twice = 2 * (centre - float(box.lo[0])) / float(box.hi[0] - box.lo[0])
        self._garment, self._body = mask[..., None], body_mask[..., None]
        self.mask = _reversed(mask[..., None])[..., 0]

    @property
    def inverse(self) -> Mirror:
        """Mirrors back what this one has mirrored."""
        inverse = copy(self)
        inverse._garment, inverse._body = _reversed(self._garment), _reversed(self._body)
        inverse.mask = self._garment[..., 0]
        return inverse

    def garment(self, images: ImagePair, frames: Tensor | None = None) -> ImagePair:
        """Mirrored images of the garment, which are 0 off `mask`.

        Args:
            images: of B frames.
            frames: (B,) bool, those to mirror; the others stay as they are. None mirrors all.
        """
        return _of_frames(lambda some: self._pair(some, self._garment), images, frames)

    def body(self, maps: BodyMaps, frames: Tensor | None = None) -> BodyMaps:
        """Mirrored images of the body, and the mirrored first guess; `frames` as for `garment`."""
        return _of_frames(self._body_maps, maps, frames)

    def shown(self, maps: BodyMaps) -> BodyMaps:
        """What networks are shown of the mirrored body: without a first guess, and images only where they see them."""
        if maps.local is not None:
            return replace(maps, guess=None, local=mirrored_features(maps.local))
        return self._body_maps(replace(maps, guess=None))

    def residuals(self, mirrored: tuple[Tensor, Tensor]) -> tuple[Tensor, Tensor]:
        """Residuals (B, S, H, W, 3) to the mirrored scene's first guess -> to the first guess itself, in its axes."""
        first, second = (_reversed(each * each.new_tensor([-1.0, 1.0, 1.0])) for each in mirrored)
        return first, second

    def masks(self, frames: Tensor) -> Tensor:
        """(B, S, H, W) bool, the garment's silhouette in frames of which those where `frames` (B,) are mirrored."""
        return torch.where(frames[:, None, None, None], self.mask, self._garment[..., 0])

    def seen(self, garment: Garment) -> Garment:
        """The mirrored template, as the networks see it."""
        return mirrored_template(garment) if isinstance(garment, TemplateView) else self.garment(garment)

    def both(self, garment: Garment) -> Garment:
        """The template as the networks see it, (1, ...), and after it the mirrored one: (2, ...)."""
        both: Garment = _each(lambda *pair: torch.cat(pair), garment, self.seen(garment))
        return both

    def average(self, images: ImagePair, mirrored: ImagePair) -> ImagePair:
        """The mean of images of the garment and of what was predicted for the mirrored scene.

        Args:
            images: encoded, (B, S, H, W, 3) each; normals of any length.
            mirrored: the same, of the mirrored scene.

        Returns:
            encoded images: means of positions, which encoding does not change, and means of unit normals, made unit.
            Values off the silhouette mean nothing.
        """
        back = self.inverse.garment(mirrored)
        normals = mean_direction(decode_normals(images.normals), decode_normals(back.normals))
        return ImagePair((images.positions + back.positions) / 2, encode_normals(normals))

    def _body_maps(self, maps: BodyMaps) -> BodyMaps:
        return BodyMaps(
            images=self._pair(maps.images, self._body),
            guess=None if maps.guess is None else self._guess(maps.guess),
            local=None if maps.local is None else mirrored_features(maps.local),
            garment=None if maps.garment is None else self._pair(maps.garment, self._garment),
        )

    def _pair(self, images: ImagePair, kept: Tensor) -> ImagePair:
        return ImagePair(_flip(images.positions, self._twice, kept), _flip(images.normals, 1.0, kept))

    def _guess(self, guess: Guess) -> Guess:
        rotation = guess.rotation
        if rotation is not None:  # M R M with M = diag(-1, 1, 1)
            sign = rotation.new_tensor([-1.0, 1.0, 1.0])
            rotation = _reversed((rotation * sign[:, None] * sign).flatten(-2)).unflatten(-1, (3, 3))
        kept = self._garment
        return Guess(_flip(guess.positions, self._twice_m, kept), _flip(guess.normals, 0.0, kept), rotation)


def of_frames(both: Any, frames: Tensor) -> Any:
    """What frames show of a template in two versions.

    Args:
        both: tensors (2, ...), or data classes or tuples of them, the plain version first.
        frames: (B,) bool, which show the mirrored one.

    Returns:
        the same with tensors (B, ...).
    """
    # Not by index, whose gradient several threads would sum in any order.
    return _each(lambda pair: torch.where(frames.view(-1, *[1] * (pair.ndim - 1)), pair[1:], pair[:1]), both)


def _of_frames(mirrored: Callable[[Maps], Maps], maps: Maps, frames: Tensor | None) -> Maps:
    """`maps` with those frames replaced by what `mirrored` makes of them, all if None."""
    if frames is None:
        return mirrored(maps)
    index = frames.nonzero()[:, 0]
    if len(index) == 0:
        return maps
    changed = mirrored(_each(lambda tensor: tensor[index], maps))
    return _each(lambda tensor, values: tensor.index_copy(0, index, values), maps, changed)


def _each(function: Callable[..., Tensor], first: Any, *others: Any) -> Any:
    """Data classes and tuples of tensors with what `function` gives of their tensors; None stays None."""
    if first is None or isinstance(first, Tensor):
        return None if first is None else function(first, *others)
    if isinstance(first, tuple):
        return tuple(_each(function, *parts) for parts in zip(first, *others, strict=True))
    parts = {
        field.name: _each(function, *(getattr(one, field.name) for one in (first, *others)))
        for field in fields(first)
    }
    return type(first)(**parts)


def _flip(images: Tensor, twice: float, kept: Tensor) -> Tensor:
    """(..., H, W, 3): first channel c to `twice` - c where `kept`, then columns in reverse."""
    sign, shift = images.new_tensor([-1.0, 1.0, 1.0]), images.new_tensor([twice, 0.0, 0.0])
    return _reversed((images * sign + shift) * kept)


def _reversed(images: Tensor) -> Tensor:
    """(..., H, W, C): columns in reverse, laid out in memory as before: convolutions round by the layout."""
    from kornia.geometry.transform import hflip  # noqa: PLC0415  (most of a second that only mirroring need pay)

    flipped: Tensor = hflip(images.movedim(-1, -3))
    return flipped.movedim(-3, -1).contiguous()
