"""Training frames: those of all clips, by one running number."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from imgtransfer.data.cache import FrameCache
from imgtransfer.data.canonical import RootFrames, RootMode, root_frames
from imgtransfer.data.clip import Clip
from imgtransfer.data.contact_offset import FRAMES, Worn, contact_offset
from imgtransfer.data.reader import LoadedReader, Reader
from imgtransfer.network.history import earlier_steps, vertical
from imgtransfer.network.shapes import misfit, same_faces
from imgtransfer.network.skinned import skinned_garment
from imgtransfer.running.fingerprint import fingerprint
from imgtransfer.running.task import in_worker
from imgtransfer.training.order import Order
from render import InputError, Mesh


class Frames:
    """The frames of clips, in the canonical frame, read when they are needed.

    Garment and body of an outfit may come in several shapes: faces are the same in all its clips, templates and rest
    bodies need not be.

    Args:
        readers: the clips.
        root: what of the root's motion the canonical frame removes.
        several: whether the clips may be of several outfits.
        history_s: how long before each frame `earlier` gives the body as well, seconds.
        skins: whether `skinned` is asked for.
        cache_bytes: memory for frames that have been read. Data that fit are read once; of larger data `order` shuffles
            neighbouring parts, so that each chunk of frames is read about once an epoch.

    Raises:
        InputError: a clip without garment vertices, or, unless `several`, with a garment or body that is not the
            first's in its own or another shape.

    Attributes:
        outfits: of each one frame of the first clip in each shape, in the order of the clips.
        readers: the clips.
        mark: a text that changes with the clips' names, lengths, first frames, templates and bodies.
    """

    def __init__(
        self,
        readers: Sequence[Reader],
        root: RootMode,
        cache_bytes: int = 2**33,
        *,
        several: bool = False,
        history_s: Sequence[float] = (),
        skins: bool = False,
    ) -> None:
        self._root, self._several, self._skins = root, several, skins
        self.readers = readers
        self.outfits: list[list[Clip]] = []
        known: dict[bytes, tuple[int, int]] = {}
        kinds, steps, marks = [], [], []
        for reader in readers:
            still = reader.clip(0, 1)
            kinds.append(self._kind(still, known))
            steps.append(earlier_steps(history_s, still.fps))
            marks.append(fingerprint(_marks(reader, still)))
        kind_of = np.array(kinds)  # (clips, 2): which outfit, and which of its shapes
        self.mark = fingerprint(marks)
        self._cache = FrameCache(readers, self._canonical, cache_bytes)
        self._cache_bytes = cache_bytes
        chunks = np.array(self._cache.chunks)
        self._clip_start = self._cache.clip_starts
        lengths = chunks[:, 2] - chunks[:, 1]
        # (frames, L - 1, 3): near, far, weight of the second.
        self._steps = np.repeat(np.array(steps).reshape(len(readers), -1, 3)[chunks[:, 0]], lengths, axis=0)
        self._outfit_of_frame, self._shape_of_frame = np.repeat(kind_of[chunks[:, 0]], lengths, axis=0).T
        firsts = [shapes[0] for shapes in self.outfits]
        self._bytes_per_frame = 12 * max(
            (1 + 4 * skins) * len(clip.template.vertices) + len(clip.body.rest) for clip in firsts
        )

    @classmethod
    def from_clips(cls, clips: Sequence[Clip], root: RootMode, *, history_s: Sequence[float] = ()) -> Frames:
        """The frames of clips that are in memory."""
        return cls([LoadedReader(clip) for clip in clips], root, history_s=history_s)

    def __len__(self) -> int:
        return len(self._cache)

    @property
    def first(self) -> Clip:
        """One frame of the first clip."""
        return self.shapes[0]

    @property
    def shapes(self) -> list[Clip]:
        """The first outfit's, which are all where there is one."""
        return self.outfits[0]

    def by_outfit(self, index: Tensor) -> list[tuple[int, Tensor]]:
        """The outfits that frames `index` (B,) are of, ascending, each with the places in `index` that are of it."""
        outfits = torch.from_numpy(self._outfit_of_frame[index.numpy()])
        return [(int(number), (outfits == number).nonzero()[:, 0]) for number in outfits.unique()]

    def of_outfit(self, number: int) -> Tensor:
        """The frames of an outfit, ascending, int64."""
        return torch.from_numpy(np.flatnonzero(self._outfit_of_frame == number))

    def read(self, index: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Frames `index` (B,) of one outfit: garment (B, N, 3), body (B, V, 3), metres, and (B,) which shape.

        Raises:
            InputError: damaged data.
        """
        garment, body = self._cache.frames(index.numpy(), slice(2))
        shape = torch.from_numpy(self._shape_of_frame[index.numpy()])
        return torch.from_numpy(garment), torch.from_numpy(body), shape

    def earlier(self, index: Tensor) -> tuple[Tensor, Tensor]:
        """The bodies of frames `index` (B,) of one outfit at the earlier times, and the vertical.

        All are in the canonical frame of the frame itself. Before a clip's first frame the body stood as it does there.

        Returns:
            (B, L - 1, V, 3) float32, metres; (B, 3) float32.

        Raises:
            InputError: damaged data.
        """
        numbers = index.numpy()
        rotation, translation = self._cache.frames(numbers, slice(2, 4))
        here = RootFrames(rotation, translation)
        bodies = []
        for step in range(self._steps.shape[1]):
            near, far, weight = self._steps[numbers, step].T
            ends = [
                self._world(np.maximum(numbers - back.astype(np.int64), self._clip_start[numbers]))
                for back in (near, far)
            ]
            world = ends[0] + weight[:, None, None] * (ends[1] - ends[0])
            bodies.append(here.to_canonical(world))
        stacked = np.stack(bodies, axis=1) if bodies else np.empty((len(numbers), 0, 0, 3), np.float32)
        return torch.from_numpy(stacked), torch.from_numpy(vertical(here))

    def skinned(self, index: Tensor) -> Tensor:
        """(B, N, 12) float32, `skinned_garment` of frames `index` (B,) of one outfit.

        Raises:
            InputError: damaged data.
        """
        (moved,) = self._cache.frames(index.numpy(), slice(4, 5))
        return torch.from_numpy(moved)

    def _world(self, numbers: np.ndarray) -> np.ndarray:
        body, rotation, translation = self._cache.frames(numbers, slice(1, 4))
        return RootFrames(rotation, translation).to_world(body).astype(np.float64)

    def _kind(self, clip: Clip, known: dict[bytes, tuple[int, int]]) -> tuple[int, int]:
        """The numbers of the clip's outfit and shape; new ones are checked, and added to `outfits` and `known`."""
        if clip.garment is None:
            raise InputError(f"{clip.name}: no garment_vertices; training needs the deformed garment")
        meshes = (clip.template.vertices, clip.body.rest, clip.template.faces, clip.body.faces)
        key = b"".join(part.tobytes() for part in meshes)
        if key not in known:
            number = self._outfit(clip)
            known[key] = (number, len(self.outfits[number]))
            self.outfits[number].append(clip)
        return known[key]

    def _outfit(self, clip: Clip) -> int:
        """Which outfit a clip's is in another shape; a new one where there may be several."""
        if not self._several and self.outfits:
            _check_same(clip, self.first)
            _check_shape(clip, self.first)
            return 0
        for number, shapes in enumerate(self.outfits):
            if _same(clip, shapes[0]) and _misfit(clip, shapes[0]) is None:
                return number
        self.outfits.append([])
        return len(self.outfits) - 1

    def garment_bounds(self) -> np.ndarray:
        """(2, 3): the least and the greatest coordinates of the garment in any frame. Reads all of them."""
        bounds = []
        numbers = range(len(self._cache.chunks))
        for number in tqdm(
            numbers, desc="data", unit="chunk", leave=False, delay=2, disable=in_worker() or None
        ):
            garment = self._cache.chunk(number)[0]
            bounds.append((garment.min(axis=(0, 1)), garment.max(axis=(0, 1))))
        lows, highs = zip(*bounds, strict=True)
        return np.stack([np.min(lows, axis=0), np.max(highs, axis=0)])

    def label(self, frame: int) -> str:
        """What a frame is called: "walk, frame 12"."""
        starts = np.unique(self._clip_start)
        clip = int(np.searchsorted(starts, frame, side="right")) - 1
        return f"{self.readers[clip].name}, frame {frame - starts[clip]}"

    @property
    def clip_starts(self) -> np.ndarray:
        """(frames,) int64: of each frame, the number of its clip's first."""
        return self._clip_start

    @property
    def n_chunks(self) -> int:
        """Number of chunks that the frames are read in."""
        return len(self._cache.chunks)

    @property
    def chunk_reads(self) -> int:
        """How many chunks have been read so far."""
        return self._cache.reads

    def order(self, batch: int, seed: int) -> Order:
        """The order that training sees the frames in: fully random if they fit into the cache.

        Those of several outfits a few frames of one after another.
        """
        if len(self) * self._bytes_per_frame <= self._cache_bytes:
            if len(self.outfits) > 1:
                groups = [self.of_outfit(number) for number in range(len(self.outfits))]
                return Order(len(self), batch, seed, groups=groups)
            return Order(len(self), batch, seed)
        window = max(batch, int(self._cache_bytes / self._bytes_per_frame / 2))
        return Order(len(self), batch, seed, chunks=self._cache.lengths, window=window)

    def contact_offset(self) -> float | None:
        """How far off the skin the cloth rests (`imgtransfer.data.contact_offset`).

        Raises:
            InputError: damaged data.
        """
        chosen = self.spread(FRAMES)

        def worn() -> Iterator[Worn]:
            for number, places in self.by_outfit(chosen):
                garment, body, _ = self.read(chosen[places])
                yield garment.numpy(), body.numpy(), self.outfits[number][0].body.faces

        return contact_offset(worn())

    def spread(self, count: int) -> Tensor:
        """Indices of at most `count` frames, evenly spread, int64."""
        return torch.linspace(0, len(self) - 1, min(count, len(self))).round().long()

    def _canonical(self, clip: Clip) -> tuple[np.ndarray, ...]:
        frames = root_frames(clip, self._root)
        assert clip.garment is not None  # _kind saw to it
        garment, body = (frames.to_canonical(mesh.vertices) for mesh in (clip.garment, clip.body))
        moved = (skinned_garment(clip, frames),) if self._skins else ()
        return garment, body, frames.rotation, frames.translation, *moved


def _marks(reader: Reader, still: Clip) -> Iterator[str | bytes]:
    """What tells a clip from another: not its frames, which would all have to be read."""
    assert still.garment is not None  # _kind saw to it
    yield f"{reader.name} {reader.n_frames} {still.fps!r}"
    for array in (
        still.template.vertices,
        still.template.faces,
        still.body.rest,
        still.body.faces,
        still.garment.vertices,
        still.body.vertices,
    ):
        yield np.ascontiguousarray(array).tobytes()


def _same(clip: Clip, first: Clip) -> bool:
    """Whether garment and body have the faces of the first's."""
    return same_faces(clip.template.faces, first.template.faces) and same_faces(
        clip.body.faces, first.body.faces
    )


def _check_same(clip: Clip, first: Clip) -> None:
    """Raise InputError unless garment and body have the faces of the first's."""
    for key, faces, wanted in (
        ("garment_faces", clip.template.faces, first.template.faces),
        ("body_faces", clip.body.faces, first.body.faces),
    ):
        if not same_faces(faces, wanted):
            raise InputError(
                f"{clip.name}: its {key} differ from those of {first.name}; one run trains on one garment and "
                "one body, in any shapes, unless network.body is local; choose clips with data.train.names, such as "
                "[tshirt/*]"
            )


def _misfit(clip: Clip, first: Clip) -> str | None:
    """Why garment and body cannot be the first's in another shape; None where they can."""
    template = Mesh(first.template.vertices, first.template.faces, first.name)
    return misfit(clip, template, Mesh(first.body.rest, first.body.faces, first.name))


def _check_shape(clip: Clip, first: Clip) -> None:
    """Raise InputError unless the clip's garment and body may be the first's in another shape."""
    if fault := _misfit(clip, first):
        raise InputError(f"{clip.name}: {fault} {first.name}; choose clips with data.train.names")
