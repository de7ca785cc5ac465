"""What is constant in training for an outfit: a garment on a body, in all shapes that the clips have it in."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

from imgtransfer.network.local_view import TemplateView
from imgtransfer.network.maps import BodyImager
from imgtransfer.network.mirror import Garment, Mirror
from imgtransfer.network.model import TransferModel
from imgtransfer.network.reading import Version
from imgtransfer.training.sampler import Frames

KEPT = 64  # what is constant for an outfit takes some tens of megabytes


@dataclass(frozen=True, eq=False)
class Outfit:
    """What is constant for an outfit.

    Args:
        model: the networks with the outfit's template, or the run's model itself where it has one garment.
        imager: of the outfit's bodies.
        garment: the template as the networks see it.
        mirror: of the outfit; None where the run does not mirror.
        shown: of networks that see images, `garment`, and after it the mirrored one where the run mirrors.
    """

    model: TransferModel
    imager: BodyImager
    garment: Garment
    mirror: Mirror | None
    shown: Garment

    @classmethod
    def of(cls, model: TransferModel, frames: Frames, number: int, *, mirrored: bool) -> Outfit:
        """Outfit `number` of some frames.

        Raises:
            InputError: it is not the model's, or its views cannot be mirrored.
        """
        shapes = frames.outfits[number]
        worn = model.dressed(shapes[0])
        imager = worn.body_imager(*shapes)
        garment = worn.seen(imager)
        mirror = Mirror(worn.imager, worn.mask, imager.mask, worn.box) if mirrored else None
        both = mirror is not None and not isinstance(garment, TemplateView)
        return cls(worn, imager, garment, mirror, mirror.both(garment) if mirror and both else garment)

    def versions(self) -> list[Version]:
        """The template as the networks see it, and where the run mirrors the mirrored one, each with its tokens."""
        return self.model.versions(self.garment, self.mirror)


class Outfits:
    """The outfits of some frames by number; the last used are kept, so that there may be any number of them."""

    def __init__(self, model: TransferModel, frames: Frames, *, mirrored: bool) -> None:
        self._model, self._frames, self._mirrored = model, frames, mirrored
        self._kept: OrderedDict[int, Outfit] = OrderedDict()

    def __getitem__(self, number: int) -> Outfit:
        if number in self._kept:
            self._kept.move_to_end(number)
            return self._kept[number]
        self._kept[number] = outfit = Outfit.of(self._model, self._frames, number, mirrored=self._mirrored)
        if len(self._kept) > KEPT:
            self._kept.popitem(last=False)
        return outfit
