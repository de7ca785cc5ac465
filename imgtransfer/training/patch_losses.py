"""The losses of local networks, from prepared frames."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import torch
from torch import Tensor

from imgtransfer.network.local_transfer import LocalTransferNet
from imgtransfer.network.loss import masked_l1
from imgtransfer.network.maps import BodyMaps, ImagePair
from imgtransfer.network.model import TransferModel
from imgtransfer.network.places import PLACES
from imgtransfer.training.outfits import Outfits
from imgtransfer.training.patches import CHANNELS, PatchFrames, PatchTemplate, patch_masks
from imgtransfer.training.prepared import Preparation, Prepared
from imgtransfer.training.sampler import Frames

Batch = Callable[[Tensor], tuple[BodyMaps, ImagePair]]


class PatchLosses:
    """Losses of training frames by outfit.

    Args:
        model: whose networks are trained.
        frames: of the training.
        outfits: of these frames.
        batch: what the networks are shown of frames (B,) of one outfit, and the true images.
    """

    def __init__(self, model: TransferModel, frames: Frames, outfits: Outfits, batch: Batch) -> None:
        self._model, self._frames, self._outfits, self._batch = model, frames, outfits, batch
        self._templates: dict[int, PatchTemplate] = {}
        self._prepared: Prepared | None = None

    def prepare(self, folder: Path, mark: str) -> None:
        """Make what is shown of all frames, in a file in `folder`, which is removed at the end (`remove_prepared`).

        Args:
            folder: of the run. mark: says what the frames hang on, such as the head.

        Raises:
            InputError: too little room on the disk, or damaged data.
        """
        views, rows, columns = self._model.mask.shape
        patches = views * rows * columns // self._model.network.vit.patch**2
        told = (PLACES + 1, 1 + len(self._model.network.history_s), 3)
        most = patches * int(torch.tensor(told).prod()) + views * rows * columns * CHANNELS
        preparation = Preparation(self._frames, self._template, self._make, told, 2 * most, mark)
        templates, self._prepared = preparation(folder)
        self._templates = dict(enumerate(templates))

    def __call__(self, number: int, index: Tensor, mirrored: Tensor | None) -> tuple[Tensor, Tensor]:
        """Both networks' losses for frames `index` (B,) of outfit `number`, those where `mirrored` (B,) mirrored.

        Masked L1 (equation 3) of residuals in the first guess's axes, in the units of `network.residuals`.
        """
        template = self._template(number)
        assert self._prepared is not None  # `prepare` comes first
        made = self._prepared(number, index)
        device = template.mask.device
        made = PatchFrames(made.local.to(device), made.residuals.to(device))
        mask = template.mask.expand(len(index), -1, -1, -1)
        if mirrored is not None:
            made, mask = made.mirrored(template, mirrored), patch_masks(template, mirrored)
        losses = []
        for network, wanted in zip(
            (self._model.position_net, self._model.normal_net), made.residuals.split(3, dim=-1), strict=True
        ):
            assert isinstance(network, LocalTransferNet)
            tokens = _tokens(network, template, mirrored)
            losses.append(masked_l1(network.patches(tokens, made.local), wanted, mask))
        return losses[0], losses[1]

    def _template(self, number: int) -> PatchTemplate:
        if number not in self._templates:
            self._templates[number] = PatchTemplate.of(self._outfits[number])
        return self._templates[number]

    def _make(self, number: int, index: Tensor) -> PatchFrames:
        return PatchFrames.of(self._outfits[number], *self._batch(index))


def _tokens(network: LocalTransferNet, template: PatchTemplate, mirrored: Tensor | None) -> Tensor:
    """(1 or B, P, dim), of the template as each frame shows it."""
    plain = network.encode(template.views[0])
    if mirrored is None:
        return plain
    # Not by index, whose gradient several threads would sum in any order.
    return torch.where(mirrored[:, None, None], network.encode(template.views[1]), plain)
