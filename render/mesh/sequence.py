"""A mesh in motion, whose frames are read when their turn comes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from render.errors import InputError
from render.mesh.mesh import Mesh

_FRAMES_AT_ONCE = 16  # that are read between two steps of a progress bar
_ON_A_FRAME = 1e-3  # of a step between frames; nearer to one, it is that one


@dataclass(frozen=True, eq=False)
class MeshSequence:
    """One mesh in T frames, wherever these come from.

    Args:
        mesh: which vertices make which triangles, with its surface: at rest where a rest pose is known, else in the
            first frame.
        n_frames: T.
        parts: all frames in order, so many at a time as it is given: (t, N, 3) float32 or float64, of which the last
            part may be shorter. Frames are read, and what is wrong with them raised, when their part is asked for.
        source: what messages call it.
        fps: frames a second, where the source says so. start: seconds of the first frame, where it says when that is.
        frame_names: of each frame, for messages; None where frames have only numbers.
        read_frames: some frames (t, N, 3) by their numbers, where that takes less than reading all up to them; else
            None.
    """

    mesh: Mesh
    n_frames: int
    parts: Callable[[int], Iterator[np.ndarray]]
    source: str = "mesh sequence"
    fps: float | None = None
    frame_names: Sequence[str] | None = None
    read_frames: Callable[[Sequence[int]], np.ndarray] | None = None
    start: float | None = None

    @classmethod
    def of_array(
        cls, mesh: Mesh, vertices: np.ndarray, *, source: str = "mesh sequence", fps: float | None = None
    ) -> MeshSequence:
        """The frames (T, N, 3) of a mesh that are in memory already; its parts are views of them.

        Raises:
            InputError: another number of vertices than the mesh has.
        """
        if vertices.ndim != 3 or vertices.shape[1:] != mesh.vertices.shape:
            raise InputError(
                f"{source}: frames must have shape (frames, {len(mesh.vertices)}, 3), found {vertices.shape}"
            )

        def parts(count: int) -> Iterator[np.ndarray]:
            return (vertices[first : first + count] for first in range(0, len(vertices), count))

        return cls(
            mesh, len(vertices), parts, source, fps, read_frames=lambda numbers: vertices[list(numbers)]
        )

    @property
    def faces(self) -> np.ndarray:
        """(F, 3) int64 of the mesh."""
        return self.mesh.faces

    def vertices(self, progress: Callable[[int], object] | None = None) -> np.ndarray:
        """All frames (T, N, 3); without a copy where they are in memory.

        Args:
            progress: called with a number of frames when they are read.
        """
        whole: np.ndarray | None = None
        done = 0
        for part in self.parts(self.n_frames if progress is None else _FRAMES_AT_ONCE):
            if len(part) == self.n_frames:
                whole = part
            else:
                whole = np.empty((self.n_frames, *part.shape[1:]), part.dtype) if whole is None else whole
                whole[done : done + len(part)] = part
            done += len(part)
            if progress is not None:
                progress(len(part))
        assert whole is not None
        return whole

    def frames(self, numbers: Sequence[int]) -> np.ndarray:
        """Some frames (t, N, 3), by their numbers in rising order."""
        if self.read_frames is not None:
            return self.read_frames(numbers)
        wanted = set(numbers)
        parts = enumerate(islice(self.parts(1), max(numbers) + 1))
        return np.concatenate([part for number, part in parts if number in wanted])

    def frame(self, number: int) -> np.ndarray:
        """One frame, (N, 3)."""
        frame: np.ndarray = self.frames([number])[0]
        return frame

    def loaded(self, progress: Callable[[int], object] | None = None) -> MeshSequence:
        """The same with all frames in memory."""
        loaded = self.of_array(self.mesh, self.vertices(progress), source=self.source, fps=self.fps)
        return replace(loaded, frame_names=self.frame_names, start=self.start)

    def mapped(self, function: Callable[[np.ndarray, int], np.ndarray], mesh: Mesh) -> MeshSequence:
        """The sequence with every part passed through a function.

        Args:
            function: (t, N, 3) vertices and the number of their first frame -> (t, M, 3).
            mesh: the mesh with M vertices that is then in motion.
        """

        def parts(count: int) -> Iterator[np.ndarray]:
            first = 0
            for part in self.parts(count):
                yield function(part, first)
                first += len(part)

        def read_frames(numbers: Sequence[int]) -> np.ndarray:
            frames = zip(self.frames(numbers), numbers, strict=True)
            return np.concatenate([function(frame[None], number) for frame, number in frames])

        return replace(self, mesh=mesh, parts=parts, read_frames=read_frames if self.read_frames else None)

    def selected(self, frames: slice) -> MeshSequence:
        """The sequence with only some frames, in their order."""
        numbers = range(self.n_frames)[frames]
        if numbers == range(self.n_frames):
            return self

        def parts(count: int) -> Iterator[np.ndarray]:
            vertices = self._in_turn(numbers)
            while part := list(islice(vertices, count)):
                yield np.stack(part)

        read_frames = self.read_frames
        names = self.frame_names
        return replace(
            self,
            n_frames=len(numbers),
            parts=parts,
            frame_names=None if names is None else [names[number] for number in numbers],
            read_frames=None
            if read_frames is None
            else lambda chosen: read_frames([numbers[number] for number in chosen]),
        )

    def _in_turn(self, numbers: range) -> Iterator[np.ndarray]:
        """(N, 3) vertices of rising frames; those between them are not read where that can be."""
        if self.read_frames is not None and (len(numbers) == 1 or numbers.step > 1):
            for first in range(0, len(numbers), _FRAMES_AT_ONCE):
                yield from self.read_frames(numbers[first : first + _FRAMES_AT_ONCE])
            return
        first = 0
        for part in self.parts(_FRAMES_AT_ONCE):
            yield from (
                part[number - first] for number in range(first, first + len(part)) if number in numbers
            )
            first += len(part)
            if first >= numbers.stop:
                return

    def at(self, places: np.ndarray) -> MeshSequence:
        """The sequence at other places between its frames, on straight lines; nobody says at what times these are.

        Args:
            places: (T,) rising, 0 the first frame and `n_frames` - 1 the last.
        """
        before = np.minimum(places.astype(np.int64), self.n_frames - 1)
        weights = places - before
        after = np.where(weights > _ON_A_FRAME, before + 1, before)

        def between(frames: Callable[[int], np.ndarray], place: int) -> np.ndarray:
            first, second = frames(int(before[place])), frames(int(after[place]))
            return first if first is second else (1 - weights[place]) * first + weights[place] * second

        def parts(count: int) -> Iterator[np.ndarray]:
            rising = enumerate(frame for part in self.parts(_FRAMES_AT_ONCE) for frame in part)
            last: dict[int, np.ndarray] = {}  # two frames

            def frame(number: int) -> np.ndarray:
                while number not in last:
                    following, vertices = next(rising)
                    last.pop(following - 2, None)
                    last[following] = vertices
                return last[number]

            for first in range(0, len(places), count):
                yield np.stack(
                    [between(frame, place) for place in range(first, min(first + count, len(places)))]
                )

        def read_frames(numbers: Sequence[int]) -> np.ndarray:
            chosen = np.asarray(numbers, np.int64)
            needed = np.unique([before[chosen], after[chosen]]).tolist()
            read = dict(zip(needed, self.frames(needed), strict=True))
            return np.stack([between(read.__getitem__, number) for number in numbers])

        return MeshSequence(self.mesh, len(places), parts, self.source, read_frames=read_frames)

    def at_rest(self, rest: Mesh, owner: str = "sequence") -> MeshSequence:
        """The sequence with its mesh in the rest pose.

        Args:
            rest: the same mesh. owner: whose rest pose it is, for messages.

        Raises:
            InputError: another number of vertices, or other triangles.
        """
        mesh = self.mesh
        if len(mesh.vertices) != len(rest.vertices) or not np.array_equal(mesh.faces, rest.faces):
            raise InputError(
                f"{mesh.source}: {len(mesh.vertices)} vertices and {len(mesh.faces)} triangles, but the template "
                f"{rest.source} has {len(rest.vertices)} and {len(rest.faces)}, or others; the rest "
                f"pose must be the {owner}'s own mesh, with its vertices in the same order"
            )
        return replace(self, mesh=rest)

    def frame_name(self, frame: int) -> str:
        """What messages call a frame: its file's name, or "frame 3"."""
        return f"frame {frame}" if self.frame_names is None else self.frame_names[frame]
