"""What local networks are shown of all training frames, made once and kept in a file beside the run.

Making it takes several times as long as a step of the networks with it. The numbers are float16, memory-mapped: the
system keeps in memory what fits.
"""

from __future__ import annotations

import json
import logging
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from imgtransfer.training.patches import CHANNELS, PatchFrames, PatchTemplate
from imgtransfer.training.sampler import Frames
from render import InputError, Option
from render.files.atomic import errors_naming, written_whole

_log = logging.getLogger(__name__)

PREPARED_FILE, MARK_FILE = "prepared.f16", "prepared.json"
_BATCH = 16
_SPARE_BYTES = 10**9  # of the disk, left to others

Make = Callable[[int, Tensor], PatchFrames]


@dataclass(frozen=True)
class _Block:
    """Where an outfit's frames lie in the file.

    Args:
        frames: (n,) int64, ascending, of the training. start: float16 numbers before the block.
        local, residuals: shapes of a frame's two arrays.
    """

    frames: np.ndarray
    start: int
    local: tuple[int, ...]
    residuals: tuple[int, ...]

    @property
    def width(self) -> int:
        """Numbers of a frame."""
        return int(np.prod(self.local) + np.prod(self.residuals))

    @property
    def end(self) -> int:
        return self.start + len(self.frames) * self.width


class Prepared:
    """The frames of a training, for reading; see `prepare`.

    Args:
        path: of the file. blocks: of the outfits, by number.
    """

    def __init__(self, path: Path, blocks: list[_Block]) -> None:
        self._blocks = blocks
        self._values = np.memmap(path, np.float16, mode="r")

    def __call__(self, number: int, index: Tensor) -> PatchFrames:
        """Frames `index` (B,) of outfit `number`."""
        block = self._blocks[number]
        rows = np.searchsorted(block.frames, index.numpy())
        whole = self._values[block.start : block.end].reshape(-1, block.width)
        values = torch.from_numpy(whole[rows].astype(np.float32))
        cut = int(np.prod(block.local))
        return PatchFrames(
            values[:, :cut].unflatten(1, block.local), values[:, cut:].unflatten(1, block.residuals)
        )


@dataclass(frozen=True)
class Preparation:
    """How the frames of a training are prepared.

    Args:
        frames: of the training.
        template: of an outfit, by its number.
        make: outfit's number and frames (B,) of it -> what is kept of them.
        local: shape of what the networks are told of a patch.
        most_bytes: of a frame, whose template might fill its images.
        mark: says what the content hangs on.
    """

    frames: Frames
    template: Callable[[int], PatchTemplate]
    make: Make
    local: tuple[int, ...]
    most_bytes: int
    mark: str

    def __call__(self, folder: Path) -> tuple[list[PatchTemplate], Prepared]:
        """The templates of all outfits, and their frames from the file in `folder`, which is made if it is not there.

        Raises:
            InputError: too little room on the disk, or damaged data.
        """
        path = folder / PREPARED_FILE
        if not _is_there(folder, self.mark):
            self._check_room(path)
            with written_whole(path) as temporary, errors_naming(path), temporary.open("wb") as file:
                templates = self._write(file)
                size = file.tell()
            with written_whole(folder / MARK_FILE) as temporary:
                temporary.write_text(json.dumps({"mark": self.mark, "bytes": size}))
        else:
            templates = [self.template(number) for number in range(len(self.frames.outfits))]
        return templates, Prepared(path, self._blocks(templates))

    def _write(self, file: BinaryIO) -> list[PatchTemplate]:
        templates = []
        bar = tqdm(total=len(self.frames), desc="preparing", unit="frame", leave=False, delay=2, disable=None)
        with bar:
            for number in range(len(self.frames.outfits)):
                templates.append(self.template(number))
                for some in self.frames.of_outfit(number).split(_BATCH):
                    its = self.make(number, some)
                    rows = torch.cat([its.local.flatten(1), its.residuals.flatten(1)], dim=1)
                    file.write(rows.half().cpu().numpy().tobytes())
                    bar.update(len(some))
        return templates

    def _check_room(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        most, free = len(self.frames) * self.most_bytes, shutil.disk_usage(path.parent).free
        if most + _SPARE_BYTES > free:
            raise InputError(
                f"{path}: prepared frames take up to {most / 1e9:.1f} GB, and {free / 1e9:.1f} GB are free there; "
                f"choose another {Option('out')}, or fewer clips with data.train.names"
            )
        _log.info(
            "%s: what the networks are shown of %d frames, up to %.1f GB; removed at the end of the training",
            path,
            len(self.frames),
            most / 1e9,
        )

    def _blocks(self, templates: list[PatchTemplate]) -> list[_Block]:
        blocks: list[_Block] = []
        for number, template in enumerate(templates):
            count, height, width = template.mask.shape
            blocks.append(
                _Block(
                    self.frames.of_outfit(number).numpy(),
                    blocks[-1].end if blocks else 0,
                    (count, *self.local),
                    (count, height, width, CHANNELS),
                )
            )
        return blocks


def remove_prepared(folder: Path) -> None:
    """Remove the file of a training that has ended."""
    for name in (MARK_FILE, PREPARED_FILE):
        (folder / name).unlink(missing_ok=True)


def _is_there(folder: Path, mark: str) -> bool:
    path, said = folder / PREPARED_FILE, folder / MARK_FILE
    if not (path.is_file() and said.is_file()):
        return False
    try:
        known = json.loads(said.read_text())
    except ValueError:
        return False
    wanted = {"mark": mark, "bytes": path.stat().st_size}
    return bool(known == wanted)
