"""Map files and what belongs to them into fused vertices on disk: what stands behind `imgtransfer fuse`."""

from __future__ import annotations

import itertools
import json
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fusion import (
    BatchResult,
    FusionConfig,
    FusionInputs,
    MapReading,
    MovingSurface,
    PinnedVertices,
    fuse_map_parts,
)
from imgtransfer.data.canonical import RootFrames
from imgtransfer.data.clip import Clip, written_clip
from imgtransfer.data.clip_parts import Garment, Template
from imgtransfer.data.mesh_output import MeshKind, written_mesh_frames
from imgtransfer.data.reader import Reader
from imgtransfer.pipeline.folder import FUSED_FILE, HISTORY_FILE, MESHES_FOLDER, REPORT_FILE
from imgtransfer.pipeline.fuse_notes import note_apart
from imgtransfer.pipeline.pins import Pins
from imgtransfer.running.fingerprint import MADE, made_anew
from render import InputError, MapFile, Mesh, MeshSequence, Option, write_png
from render.files.atomic import written_whole
from render.files.npz_writer import NpzWriter
from render.maps.map_file import Maps
from render.mesh.mesh import check_finite


@dataclass(frozen=True, kw_only=True, eq=False)
class FuseInputs:
    """What a map file may be fused with, in world coordinates, metres.

    Args:
        template: in place of the map file's.
        initial: garment to start from in place of the position maps; T frames.
        body: what the garment must stay outside of; T frames.
        clip: the clip that the body is of, if it is of one.
        inner: another garment, worn beneath; T frames.
        pins: vertices that stay in place.
    """

    template: Mesh | None = None
    initial: MeshSequence | None = None
    body: MeshSequence | None = None
    clip: Reader | None = None
    inner: MeshSequence | None = None
    pins: Pins | None = None


@dataclass(frozen=True, kw_only=True)
class FuseOptions:
    """How to fuse: the choices that, with the maps, decide the result; see `fusion.MapReading`."""

    config: FusionConfig
    positions_only: bool = False
    erode: int = 0

    def as_text(self) -> str:
        """One line, for results to say what they were made with."""
        choices = {"positions_only": self.positions_only, "erode": self.erode}
        return json.dumps(self.config.model_dump() | choices, sort_keys=True)


def fuse_into(
    folder: Path,
    maps: Maps,
    inputs: FuseInputs,
    options: FuseOptions,
    *,
    meshes: MeshKind | None = None,
    device: str = "cpu",
    history: bool = False,
    made: str | None = None,
    progress: Callable[[int], object] | None = None,
) -> dict[str, Any]:
    """Fuse maps in their canonical frames, put these back, and write what was fused as it comes.

    Written are the report, its picture if it has a history, the meshes if asked for, and last fused.npz; each appears
    whole or not at all. fused.npz is the body's clip with the fused garment, and says how it was fused.
    Without a clip it holds the garment's arrays, and those of the body if there is one.

    Args:
        folder: is there already.
        maps: whose frames are read when their turn comes.
        inputs: what belongs to them.
        options: what else decides the result.
        meshes: also write one mesh file a frame, of this kind.
        device: that computes, as PyTorch calls it.
        history: also report every term at every iteration.
        made: the fingerprint that fused.npz shall keep, where it is a clip; None keeps none.
        progress: called with a number of frames when they are done.

    Returns:
        The report.

    Raises:
        InputError: something given has another number of frames, or what `fuse_maps` refuses.
    """
    for name in ("body", "inner", "initial"):
        moving = getattr(inputs, name)
        if moving is not None and moving.n_frames != maps.n_frames:
            raise InputError(
                f"{Option(name)}: {maps.n_frames} frames are wanted, as the maps have {maps.n_frames}; "
                f"found {moving.n_frames}"
            )
    stream = _Stream(maps, inputs)
    first = next(maps.parts(1))
    if inputs.body is not None and inputs.clip is None:
        note_apart(first, inputs.body)
    if inputs.pins is not None:
        inputs.pins.check(len(first.template_vertices))
    template = inputs.template or _with_look(first.template, inputs.clip)
    if first.rest_vertices is not None:
        template = replace(template, vertices=first.rest_vertices)
    with ExitStack() as stack:  # what is entered first appears last
        add = stack.enter_context(
            _written_fused(folder / FUSED_FILE, template, first.fps, inputs, _record(options, made))
        )
        frames = None
        if meshes:
            frames = stack.enter_context(written_mesh_frames(folder / MESHES_FOLDER, template, meshes))

        def take(batch: BatchResult) -> None:
            part = stream.taken()
            vertices = part.frames.to_world(batch.vertices)
            add(vertices, part)
            if frames is not None:
                frames.add(vertices)

        report = fuse_map_parts(
            maps,
            stream.parts,
            take,
            options.config,
            reading=MapReading(
                template=inputs.template, positions_only=options.positions_only, erode=options.erode
            ),
            device=device,
            history=history,
            progress=progress,
        )
        report |= {
            "positions_only": options.positions_only,
            "erode": options.erode,
            "config": options.config.model_dump(),
        }
        _save_report(folder, report, options)
    return report


@dataclass(frozen=True, eq=False)
class _Part:
    """What is needed of some frames once they are fused."""

    frames: RootFrames
    body: np.ndarray | None
    clip: Clip | None


class _Stream:
    """Frames on their way into the fusion, in canonical frames, and out of it again."""

    def __init__(self, maps: Maps, inputs: FuseInputs) -> None:
        self._maps, self._inputs = maps, inputs
        self._pins = None if inputs.pins is None else inputs.pins.over(maps.n_frames)
        self._under_way: deque[_Part] = deque()

    def parts(self, count: int) -> Iterator[tuple[MapFile, FusionInputs]]:
        """All frames, from the first on whenever this is called."""
        self._under_way.clear()
        inputs, first = self._inputs, 0
        initials, bodies, inners = (
            _parts(sequence, count) for sequence in (inputs.initial, inputs.body, inputs.inner)
        )
        clips: Iterator[Clip | None] = itertools.repeat(None)
        if inputs.clip is not None:  # it has the body's frames: they are read once
            clips, of_body = itertools.tee(inputs.clip.parts(count))
            bodies = (clip.body.vertices for clip in of_body)
        for maps, initial, body, inner, clip in zip(
            self._maps.parts(count), initials, bodies, inners, clips, strict=False
        ):
            frames = RootFrames(maps.rotation, maps.translation)
            self._under_way.append(_Part(frames, body, clip))
            yield (
                maps,
                FusionInputs(
                    initial=None if initial is None else _canonical(initial, frames, "initial", first),
                    body=_surface(inputs.body, body, frames, "body", first),
                    inner=_surface(inputs.inner, inner, frames, "inner", first),
                    pins=self._pinned(frames, first, maps.n_frames),
                ),
            )
            first += maps.n_frames

    def _pinned(self, frames: RootFrames, first: int, count: int) -> PinnedVertices | None:
        """The pins of `count` frames from number `first` on."""
        if self._inputs.pins is None:
            return None
        positions = None if self._pins is None else self._pins[first : first + count]
        return PinnedVertices(
            self._inputs.pins.indices, None if positions is None else frames.to_canonical(positions)
        )

    def taken(self) -> _Part:
        """What belongs to the frames that are fused next."""
        return self._under_way.popleft()


def _parts(sequence: MeshSequence | None, count: int) -> Iterator[np.ndarray | None]:
    return itertools.repeat(None) if sequence is None else sequence.parts(count)


def _canonical(vertices: np.ndarray, frames: RootFrames, option: str, first: int) -> np.ndarray:
    """Vertices (T, B, 3) in the frames of the maps; InputError, which names the frame, where they are not finite."""
    check_finite(vertices, str(Option(option)), first=first)
    return frames.to_canonical(vertices)


def _surface(
    sequence: MeshSequence | None, vertices: np.ndarray | None, frames: RootFrames, option: str, first: int
) -> MovingSurface | None:
    if sequence is None or vertices is None:
        return None
    return MovingSurface(_canonical(vertices, frames, option, first), sequence.faces)


def _with_look(template: Mesh, reader: Reader | None) -> Mesh:
    """The template with the texture coordinates and numbering of the body's clip, if that is of the same garment."""
    clip = None if reader is None else reader.clip(0, 1)
    if clip is None or not np.array_equal(clip.template.faces, template.faces):
        return template
    return replace(template, surface=clip.template.surface)


def _save_report(folder: Path, report: dict[str, Any], options: FuseOptions) -> None:
    if "history" in report:
        from imgtransfer.report.fusion_history import history_picture  # noqa: PLC0415

        write_png(folder / HISTORY_FILE, history_picture(report["history"], options.config))
    else:
        (folder / HISTORY_FILE).unlink(missing_ok=True)
    with written_whole(folder / REPORT_FILE) as temporary:
        temporary.write_text(json.dumps(report, indent=2) + "\n")


def _record(options: FuseOptions, made: str | None) -> dict[str, str]:
    """What a fused.npz keeps in its `info`."""
    return {"fusion": options.as_text()} | ({} if made is None else {MADE: made})


@contextmanager
def _written_fused(
    path: Path, template: Mesh, fps: float, inputs: FuseInputs, record: dict[str, str]
) -> Iterator[Callable[[np.ndarray, _Part], None]]:
    """Yield what takes frames of fused vertices (T, N, 3), world, and of the body; for the fused.npz at `path`.

    `record` is added to the clip's `info`.
    """
    constant: dict[str, Any] = {
        "template_vertices": np.asarray(template.vertices, np.float32),
        "garment_faces": template.faces,
    }
    if inputs.clip is not None:
        with written_clip(path) as add_clip:

            def add_to_clip(vertices: np.ndarray, part: _Part) -> None:
                assert part.clip is not None
                clip = replace(
                    part.clip,
                    template=Template(constant["template_vertices"], template.faces, template.surface),
                    garment=Garment(vertices),
                    info=made_anew(part.clip.info) | record,
                )
                add_clip(clip)

            yield add_to_clip
        return
    with NpzWriter(path) as out:
        for name, values in constant.items():
            out.write(name, values)
        if inputs.body is not None:
            out.write("body_faces", inputs.body.faces)
        out.write("fps", np.float64(fps))

        def add_rows(vertices: np.ndarray, part: _Part) -> None:
            out.append("garment_vertices", vertices)
            if part.body is not None:
                out.append("body_vertices", part.body)

        yield add_rows
