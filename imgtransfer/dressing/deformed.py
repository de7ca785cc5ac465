"""A dressed body's frames with the garment that a network moves: predicted and fused, some frames at a time.

Maps go from the network to the fusion as they are made, and are never all in memory or on disk.
"""

from __future__ import annotations

import itertools
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fusion import BatchResult, FusionConfig, FusionInputs, MovingSurface, fuse_map_parts
from imgtransfer.data.canonical import RootFrames
from imgtransfer.data.clip import Clip
from imgtransfer.data.clip_parts import Garment
from imgtransfer.data.reader import Reader
from imgtransfer.network.model import FRAMES_AT_ONCE, TransferModel
from imgtransfer.pipeline.predict import maps_of
from render import MapFile
from render.threads import one_blas_thread


@dataclass(frozen=True)
class Deformed:
    """What was done.

    Args:
        report: of the fusion, see `fusion.FusionResult`.
        predict_seconds: that the body was posed and the network worked for.
        fuse_seconds: that the fusion's stages worked for, on all threads together.
    """

    report: dict[str, Any]
    predict_seconds: float

    @property
    def fuse_seconds(self) -> float:
        return float(sum(self.report["stage_seconds"].values()))


@one_blas_thread()
def predict_and_fuse(
    model: TransferModel,
    reader: Reader,
    take: Callable[[Clip], object],
    config: FusionConfig | None = None,
    *,
    hangs: np.ndarray | None = None,
    progress: Callable[[int], object] | None = None,
) -> Deformed:
    """Move a clip's garment as the model does; memory is needed for a few batches, not for the clip.

    The vertices are those that `imgtransfer predict` and `imgtransfer fuse` give.

    Args:
        model: of the clip's garment, or general.
        reader: of a body in motion with its garment at rest; how that moves is not looked at.
        take: gets the frames in order, some at a time, with the garment in them.
        config: of the fusion; the default if None.
        hangs: see `imgtransfer.network.shapes.as_it_hangs`.
        progress: called with a number of frames when they are done.

    Raises:
        InputError: the clip's garment is not the model's, frames that cannot be read, or what the fusion refuses.
    """
    stream = _Stream(model, reader, hangs)

    def took(batch: BatchResult) -> None:
        clip, frames = stream.taken()
        take(replace(clip, garment=Garment(frames.to_world(batch.vertices))))

    report = fuse_map_parts(stream, stream.fusible, took, config, progress=progress)
    return Deformed(report, stream.seconds)


class _Stream:
    """Frames that are predicted when the fusion asks for them, and what belongs to those that it has not given back."""

    def __init__(self, model: TransferModel, reader: Reader, hangs: np.ndarray | None) -> None:
        self._reader, self.n_frames, self.seconds = reader, reader.n_frames, 0.0
        self._under_way: deque[tuple[Clip, RootFrames]] = deque()
        self._batches = self._predicted(model, hangs)
        self._first = next(self._batches)

    def parts(self, count: int) -> Iterator[MapFile]:
        """All maps in order, `count` frames at a time; once, but for the first batch, which can be looked at before."""
        return (maps for _, maps in self._in_turn(count))

    def fusible(self, count: int) -> Iterator[tuple[MapFile, FusionInputs]]:
        """The same, each part with the body that the garment must stay outside of."""
        self._under_way.clear()
        for clip, maps in self._in_turn(count):
            frames = RootFrames(maps.rotation, maps.translation)
            self._under_way.append((clip, frames))
            body = MovingSurface(frames.to_canonical(clip.body.vertices), clip.body.faces)
            yield maps, FusionInputs(body=body)

    def taken(self) -> tuple[Clip, RootFrames]:
        """The frames that the fusion gives back next."""
        return self._under_way.popleft()

    def _predicted(self, model: TransferModel, hangs: np.ndarray | None) -> Iterator[tuple[Clip, MapFile]]:
        """Batches as `imgtransfer predict` makes them."""
        started = time.perf_counter()
        predictor = model.predictor(self._reader.clip(0, 1), hangs=hangs)
        for clip in self._reader.parts(FRAMES_AT_ONCE):
            maps = maps_of(predictor(clip))
            self.seconds += time.perf_counter() - started
            yield clip, maps
            started = time.perf_counter()

    def _in_turn(self, count: int) -> Iterator[tuple[Clip, MapFile]]:
        """The batches, cut again into parts of `count` frames; those of the last batch may be fewer."""
        for clip, maps in itertools.chain([self._first], self._batches):
            for first in range(0, maps.n_frames, count):
                part = slice(first, first + count)
                yield clip.slice(part), maps.part(part)
