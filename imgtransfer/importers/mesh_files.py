"""Which files of a clip's folder are its garment, its body and their rest pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

from imgtransfer.data.sequences import Kind
from imgtransfer.importers.job import ImportOptions
from imgtransfer.importers.sequences import REST, is_there, mesh_beside, mesh_file
from render import InputError
from render.files.frame_files import FRAMES, is_rest_name
from render.files.mesh_files import SUFFIXES as MESHES
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
        options.template or rest_mesh(folder, garment, "garment"),
        options.body_rest or rest_mesh(folder, body, "body"),
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
    return body, body_rest or rest_mesh(folder, body, "body")


def rest_mesh(folder: Path, moving: Path, kind: Kind) -> Path | None:
    """The rest pose of what moves in a clip's folder: there or above, among its frames, or what its cache moves."""
    named = mesh_file(folder, REST[kind])
    if named is None and moving.is_dir():
        among = [
            file
            for file in moving.iterdir()
            if is_rest_name(file) and file.suffix.lower() in (*MESHES, *SCENES)
        ]
        if len(among) > 1:
            raise InputError(
                f"{moving}: {among[0].name} and {among[1].name} are both called as a rest pose; keep one"
            )
        named = next((file for file in among if is_there(file, "a mesh file")), None)
    return named or mesh_beside(moving, kind)


def _wanted(folder: Path, what: str) -> Path:
    singles = (file for suffix in MESHES if is_there(file := folder / f"{what}{suffix}", "a mesh file"))
    found = moving_in(folder, what) or next(singles, None)
    if found is None:
        raise InputError(
            f"{folder}: no {what} in it; wanted is a folder {what}/ of OBJ or PLY frames, frames "
            f"{what}_0000.obj and so on, a point cache {what}.pc2 (.mdd, .pc16), {what}.abc or {what}.usd, or one "
            f"{what}.obj that stays still"
        )
    return found


def moving_in(folder: Path, what: str) -> Path | None:
    """Where a clip's folder has its "garment" or "body": a folder, a file, or a pattern of frames; None if nowhere."""
    if (folder / what).is_dir():
        return folder / what
    for suffix in (*CACHES, *SCENES):
        if is_there(file := folder / f"{what}{suffix}", "a point cache or a scene"):
            return file
    frames = [
        file for file in folder.iterdir() if file.suffix.lower() in FRAMES and file.name.startswith(what)
    ]
    for numbers in ("*[0-9]", "*[0-9]*"):  # the second for names such as garment (1).obj
        names = [file for file in frames if fnmatchcase(file.stem, what + numbers)]
        if names:
            return folder / f"{what}{numbers}{_any_case(names)}"
    return None


def _any_case(files: Sequence[Path]) -> str:
    """A pattern for the files' suffix, however it is spelled; the first of `FRAMES` where they have several."""
    suffixes = {file.suffix for file in files}
    wanted = next(suffix for suffix in FRAMES if suffix in {one.lower() for one in suffixes})
    spelled = {one for one in suffixes if one.lower() == wanted}
    if len(spelled) == 1:
        return spelled.pop()
    return "." + "".join(f"[{letter}{letter.upper()}]" for letter in wanted[1:])
