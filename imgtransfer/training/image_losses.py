"""The losses of networks that are shown the body's images (section 3.2, equation 3)."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

from torch import Tensor

from imgtransfer.network import TransferModel, masked_l1
from imgtransfer.network.maps import BodyMaps, ImagePair
from imgtransfer.network.mirror import of_frames
from imgtransfer.network.trunk_cache import TrunkCache, trunk_cache
from imgtransfer.training.outfits import Outfits
from imgtransfer.training.sampler import Frames


class ImageLosses:
    """Losses of training frames by outfit.

    Args:
        model: whose networks are trained.
        frames: of the training.
        outfits: of these frames.
        batch: what the networks are shown of frames (B,) of one outfit, and the true images.
        autocast: a context for the networks' products.
    """

    def __init__(
        self,
        model: TransferModel,
        frames: Frames,
        outfits: Outfits,
        *,
        batch: Callable[[Tensor], tuple[BodyMaps, ImagePair]],
        autocast: Callable[[], AbstractContextManager[object]],
    ) -> None:
        self._model, self._frames, self._outfits = model, frames, outfits
        self._batch, self._autocast = batch, autocast
        self._trunks: TrunkCache | None = None

    def cache_trunks(self, folder: Path, *, mirrored: bool, limit: float) -> None:
        """Compute what is frozen of pretrained encoders once a frame; arguments as of `TrunkCache`."""
        shown = self._outfits[0].shown
        with self._autocast():
            self._trunks = trunk_cache(
                self._model, shown, frames=len(self._frames), mirrored=mirrored, folder=folder, limit=limit
            )

    def __call__(self, number: int, index: Tensor, mirrored: Tensor | None) -> tuple[Tensor, Tensor]:
        """Both networks' losses for frames `index` (B,) of outfit `number`, those where `mirrored` (B,) mirrored."""
        outfit = self._outfits[number]
        body, truth = self._batch(index)
        mask, hidden = outfit.model.mask, None
        if outfit.mirror is not None:
            assert mirrored is not None
            body, truth = outfit.mirror.body(body, mirrored), outfit.mirror.garment(truth, mirrored)
            mask = outfit.mirror.masks(mirrored)
        with self._autocast():
            if self._trunks is not None:
                hidden, body = self._trunks.template, self._trunks.body(body, index, mirrored)
            garment, tokens = outfit.shown, outfit.model.encode_garment(outfit.shown, hidden)
            if mirrored is not None:
                garment, tokens = of_frames((garment, tokens), mirrored)
            predicted = outfit.model(body, garment=garment, tokens=tokens)
        return (
            masked_l1(predicted.positions, truth.positions, mask),
            masked_l1(predicted.normals, truth.normals, mask),
        )
