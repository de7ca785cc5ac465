"""Mirror images: what the cameras would have seen had the person's left been the right."""

from __future__ import annotations

from torch import Tensor

from imgtransfer.network.base import Guess
from imgtransfer.network.local_view import TemplateView, mirrored_features, mirrored_template
from imgtransfer.network.maps import BodyMaps, ImagePair
from render import InputError, PositionBox, TemplateImager


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

    def garment(self, images: ImagePair) -> ImagePair:
        """Mirrored images of the garment; their silhouette is `mask`."""
        return self._pair(images, self._garment)

    def body(self, maps: BodyMaps) -> BodyMaps:
        """Mirrored images of the body, and the mirrored first guess."""
        guess = None if maps.guess is None else self._guess(maps.guess)
        local = None if maps.local is None else mirrored_features(maps.local)
        return BodyMaps(self._pair(maps.images, self._body), guess, local)

    def seen(self, garment: ImagePair | TemplateView) -> ImagePair | TemplateView:
        """The mirrored template, as the networks see it."""
        if isinstance(garment, TemplateView):
            return mirrored_template(garment)
        return self.garment(garment)

    def _pair(self, images: ImagePair, kept: Tensor) -> ImagePair:
        return ImagePair(_flip(images.positions, self._twice, kept), _flip(images.normals, 1.0, kept))

    def _guess(self, guess: Guess) -> Guess:
        rotation = guess.rotation
        if rotation is not None:  # M R M with M = diag(-1, 1, 1)
            sign = rotation.new_tensor([-1.0, 1.0, 1.0])
            rotation = _reversed((rotation * sign[:, None] * sign).flatten(-2)).unflatten(-1, (3, 3))
        kept = self._garment
        return Guess(_flip(guess.positions, self._twice_m, kept), _flip(guess.normals, 0.0, kept), rotation)


def _flip(images: Tensor, twice: float, kept: Tensor) -> Tensor:
    """(..., H, W, 3): first channel c to `twice` - c where `kept`, then columns in reverse."""
    sign, shift = images.new_tensor([-1.0, 1.0, 1.0]), images.new_tensor([twice, 0.0, 0.0])
    return _reversed((images * sign + shift) * kept)


def _reversed(images: Tensor) -> Tensor:
    """(..., H, W, C): columns in reverse, laid out in memory as before: convolutions round by the layout."""
    from kornia.geometry.transform import hflip  # noqa: PLC0415  (most of a second that only mirroring need pay)

    flipped: Tensor = hflip(images.movedim(-1, -3))
    return flipped.movedim(-3, -1).contiguous()
