"""Which files of a clip's folder are its garment, its body and their rest pose."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from imgtransfer.importers.job import ImportOptions
from imgtransfer.importers.sequences import is_there, mesh_beside, mesh_file
from render import InputError
from render.files.frame_files import FRAMES
from render.files.point_caches import SUFFIXES as CACHES
from render.files.scenes.reader import SUFFIXES as SCENES
from render.files.scenes.reader import is_scene
from render.files.sequence import sequence_files


@dataclass(frozen=True)
class Source:
    """Where one clip comes from: moving meshes, and meshes in the rest pose (None takes the first frame)."""

    garment: Path
    body: Path
    template: Path | None
    body_rest: Path | None

    def files(self) -> tuple[Path, ...]:
        """Every file that is read."""
        frames = [file for moving in (self.garment, self.body) for file in sequence_files(moving)]
        return (*frames, *(file for file in (self.template, self.body_rest) if file is not None))


def find_source(folder: Path, options: ImportOptions) -> Source:
    """The files of one clip in its folder, or the one file with all; `options.template` and `options.body_rest` come
    before what is there.

    Raises:
        InputError: no such folder, or no garment or body in it.
    """
    if is_scene(folder) and folder.exists():
        return Source(folder, folder, options.template, options.body_rest)
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; one with garment and body frames is wanted")
    garment, body = (_wanted(folder, what) for what in ("garment", "body"))
    return Source(
        garment,
        body,
        options.template or mesh_file(folder, "template") or mesh_beside(garment, "garment"),
        options.body_rest or mesh_file(folder, "body_rest") or mesh_beside(body, "body"),
    )


def find_body(folder: Path, body_rest: Path | None = None) -> tuple[Path, Path | None]:
    """The moving body in a clip's folder or scene, and its rest pose (None takes the first frame); `body_rest` comes
    first.

    Raises:
        InputError: no body in it.
    """
    if is_scene(folder):
        return folder, body_rest
    body = _wanted(folder, "body")
    return body, body_rest or mesh_file(folder, "body_rest") or mesh_beside(body, "body")


def _wanted(folder: Path, what: str) -> Path:
    found = moving_in(folder, what)
    if found is None:
        raise InputError(
            f"{folder}: no {what} in it; wanted is a folder {what}/ of OBJ or PLY frames, frames "
            f"{what}_0000.obj and so on, a point cache {what}.pc2 (.mdd, .pc16), or {what}.abc or {what}.usd"
        )
    return found


def moving_in(folder: Path, what: str) -> Path | None:
    """Where a clip's folder has its "garment" or "body": a folder, a file, or a pattern of frames; None if nowhere."""
    if (folder / what).is_dir():
        return folder / what
    for suffix in (*CACHES, *SCENES):
        if is_there(file := folder / f"{what}{suffix}", "a point cache or a scene"):
            return file
    for suffix in (*FRAMES, *map(str.upper, FRAMES)):
        if any(folder.glob(f"{what}*[0-9]{suffix}")):
            return folder / f"{what}*[0-9]{suffix}"
    return None
