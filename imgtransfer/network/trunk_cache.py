"""What the frozen trunks of pretrained encoders make of the same images again and again, computed once."""

from __future__ import annotations

import logging
import os
import shutil
from dataclasses import replace
from math import prod
from pathlib import Path
from tempfile import NamedTemporaryFile

import torch
from torch import Tensor

from imgtransfer.network.maps import BodyMaps, ImagePair
from imgtransfer.network.mirror import Garment
from imgtransfer.network.model import TransferModel
from imgtransfer.network.transfer import TransferNet
from render.errors import said_by

_log = logging.getLogger(__name__)

Hidden = tuple[Tensor, Tensor]  # of the position and the normal network, (B, S, ...) each


class TrunkCache:
    """Keeps what the trunks make of the template in memory, and of each training frame's body in a file.

    Frames are computed one by one when they are first asked for, so that what is kept of a frame does not hang on the
    batch that it came in. The file has no name any more once it is open: it is gone with the process.

    Args:
        model: whose encoders have a frozen trunk.
        garment: the template's images, as a step shows them.
        frames: how many there are.
        mirrored: whether frames are shown mirrored, too.
        folder: of the run, where the file is.
        limit: of the file, bytes; bodies are computed anew each time where it takes more.
    """

    def __init__(
        self,
        model: TransferModel,
        garment: ImagePair,
        *,
        frames: int,
        mirrored: bool,
        folder: Path,
        limit: float,
    ) -> None:
        self._networks = _trunks(model)
        self.template = self._computed(garment)
        self._versions = 1 + mirrored
        rows = frames * self._versions
        self._there = torch.zeros(rows, dtype=torch.bool)
        self.kept = _kept(self.template, rows, folder, limit)

    @property
    def filled(self) -> int:
        """How many frames, plain and mirrored ones, have been computed and kept."""
        return int(self._there.sum())

    def body(self, body: BodyMaps, index: Tensor, mirrored: Tensor | None) -> BodyMaps:
        """The same maps with what the trunks make of their images.

        Args:
            body: maps of B frames, mirrored where they are to be.
            index: (B,) int64, on the CPU, the frames' numbers.
            mirrored: (B,) bool, which of them are mirrored; None for none.
        """
        if self.kept is None:
            return body
        rows = index * self._versions + (0 if mirrored is None else mirrored.cpu())
        for place in (~self._there[rows]).nonzero()[:, 0].tolist():
            one = slice(place, place + 1)
            images = ImagePair(body.images.positions[one], body.images.normals[one])
            for kept, hidden in zip(self.kept, self._computed(images), strict=True):
                kept[rows[place]] = hidden[0].cpu()
            self._there[rows[place]] = True
        device = body.images.positions.device
        first, second = (kept[rows].to(device) for kept in self.kept)
        return replace(body, hidden=(first, second))

    @torch.no_grad()
    def _computed(self, images: ImagePair) -> Hidden:
        first, second = self._networks
        return first.hidden(images.positions), second.hidden(images.normals)


def trunk_cache(
    model: TransferModel, garment: Garment, *, frames: int, mirrored: bool, folder: Path, limit: float
) -> TrunkCache | None:
    """The cache for a run, with arguments as of `TrunkCache`; None where nothing of the encoders is frozen."""
    if model.architecture is None:
        return None
    assert isinstance(garment, ImagePair)  # such encoders see images
    return TrunkCache(model, garment, frames=frames, mirrored=mirrored, folder=folder, limit=limit)


def _trunks(model: TransferModel) -> tuple[TransferNet, TransferNet]:
    first, second = model.position_net, model.normal_net
    assert isinstance(first, TransferNet)
    assert isinstance(second, TransferNet)
    return first, second


def _kept(like: Hidden, rows: int, folder: Path, limit: float) -> Hidden | None:
    """Room for `rows` of each, (rows, S, ...) in a file; None, with a note, where there is none or it is too much."""
    needed = rows * sum(hidden[0].numel() * hidden.element_size() for hidden in like)
    size = f"what the frozen part of the encoders makes of {rows} bodies takes {needed / 1e9:.2f} GB"
    if needed > limit:
        if limit:
            _log.info("%s, more than training.trunk_cache_gb (%g), and is computed anew", size, limit / 1e9)
        return None
    free = shutil.disk_usage(folder).free
    if needed > free:
        _log.warning(
            "note: %s, %.2f GB are free in %s, and it is computed anew in each step", size, free / 1e9, folder
        )
        return None
    try:
        first, second = (_room((rows, *hidden.shape[1:]), hidden.dtype, folder) for hidden in like)
    except (OSError, RuntimeError) as error:
        _log.warning("note: %s; there is no room (%s), and it is computed anew", size, said_by(error))
        return None
    _log.info("%s in %s until the run ends", size, folder)
    return first, second


def _room(shape: tuple[int, ...], dtype: torch.dtype, folder: Path) -> Tensor:
    """A tensor in a file that has its room on the disk already: running out of it later would end the process."""
    with NamedTemporaryFile(dir=folder, prefix=".trunk-") as file:
        os.posix_fallocate(file.fileno(), 0, prod(shape) * dtype.itemsize)
        mapped = torch.from_file(file.name, shared=True, size=prod(shape), dtype=dtype)
    return mapped.view(shape)
