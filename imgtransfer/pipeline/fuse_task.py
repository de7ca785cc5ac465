"""Fusing one map file, or a predicted clip's folder: a task that any process can do, unless it is done already."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tqdm import tqdm

from imgtransfer.data.mesh_output import MeshKind, written_mesh_frames
from imgtransfer.data.reader import NpzReader
from imgtransfer.data.sequences import clip_reader, open_clip_arrays
from imgtransfer.pipeline.folder import (
    FUSED_FILE,
    HISTORY_FILE,
    MAPS_FILE,
    MESHES_FOLDER,
    POSITION_ONLY_FILE,
)
from imgtransfer.pipeline.fuse import FuseInputs, FuseOptions, fuse_into
from imgtransfer.pipeline.fuse_summary import FusedClip, notes_of
from imgtransfer.pipeline.standing import clip_stands
from imgtransfer.running import in_worker
from imgtransfer.running.fingerprint import files_fingerprint, fingerprint
from render import InputError, open_maps

_TOGETHER = 32  # frames of a result that are read together


@dataclass(frozen=True, kw_only=True)
class FuseTask:
    """One clip's folder in a prediction, and how to fuse it.

    Args:
        folder: with the clip's maps and its body; what is made is put beside them.
        options: what decides the result.
        meshes: also write one mesh file a frame, of this kind.
        device: that computes, as PyTorch calls it.
        history: also report every term at every iteration.
        overwrite: whether to fuse again what is fused already.
    """

    folder: Path
    options: FuseOptions
    meshes: MeshKind | None = None
    device: str = "cpu"
    history: bool = False
    overwrite: bool = False

    @property
    def name(self) -> str:
        """The folder's."""
        return self.folder.name

    def fingerprint(self) -> str:
        """A text that changes with whatever decides how the clip comes out: the maps, the body, the options."""
        files = [self.folder / MAPS_FILE, self.folder / POSITION_ONLY_FILE]
        return fingerprint([files_fingerprint(files), self.options.as_text()])


def frames_to_fuse(task: FuseTask) -> int:
    """How many frames the clip's maps have; 0 where they cannot be read, of which the task itself will tell."""
    try:
        return open_maps(task.folder / MAPS_FILE).n_frames
    except InputError:
        return 0


def fuse_clip(task: FuseTask) -> FusedClip:
    """Fuse one clip's folder, unless that is done already.

    Raises:
        InputError: maps or a body that cannot be read, or that do not belong together.
    """
    folder, target, made = task.folder, task.folder / FUSED_FILE, task.fingerprint()
    drawn = (folder / HISTORY_FILE).is_file() or not task.history
    if drawn and not task.overwrite and clip_stands(target, made):
        if task.meshes:
            _write_meshes(target, folder / MESHES_FOLDER, task.meshes)
        return FusedClip(str(folder))
    body = folder / POSITION_ONLY_FILE
    report = fuse_file(
        folder / MAPS_FILE,
        folder,
        FuseInputs(body=open_clip_arrays(body, "body"), clip=clip_reader(body)),
        task.options,
        sources=[body],
        meshes=task.meshes,
        device=task.device,
        history=task.history,
        made=made,
    )
    return FusedClip(str(folder), report["frames"], report["seconds"], notes_of(report))


def fuse_file(
    path: Path,
    folder: Path,
    inputs: FuseInputs,
    options: FuseOptions,
    *,
    sources: Sequence[Path] = (),
    meshes: MeshKind | None = None,
    device: str = "cpu",
    history: bool = False,
    made: str | None = None,
) -> dict[str, Any]:
    """Fuse one map file into a folder, with a bar.

    Args:
        path: the maps; an error that names neither these nor one of the `sources` is said of these.
        folder: that what is made is put into.
        inputs, options, meshes, device, history, made: as for `fuse_into`.
        sources: the files that `inputs` came from.

    Returns:
        The report.

    Raises:
        InputError: maps that cannot be read, or what `fuse_into` refuses.
    """
    maps = open_maps(path)
    name = path.parent.name if path.name == MAPS_FILE else path.stem
    hidden = True if in_worker() else None
    with tqdm(total=maps.n_frames, desc=name, unit="frame", leave=False, disable=hidden) as bar:
        try:
            return fuse_into(
                folder,
                maps,
                inputs,
                options,
                meshes=meshes,
                device=device,
                history=history,
                made=made,
                progress=bar.update,
            )
        except InputError as error:
            bar.close()
            if str(error).startswith(tuple(str(file) for file in (path, *sources))):
                raise
            raise InputError(f"{path}: {error}") from error


def _write_meshes(fused: Path, folder: Path, kind: MeshKind) -> None:
    """Write the garment of a fused.npz as one mesh file a frame; the folder appears whole or not at all."""
    reader = NpzReader(fused)
    with written_mesh_frames(folder, reader.clip(0, 1).template_mesh, kind) as frames:
        for part in reader.parts(_TOGETHER):
            assert part.garment is not None
            frames.add(part.garment.vertices)
