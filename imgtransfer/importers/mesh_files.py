"""Which files of a clip's folder are its garment, its body and their rest pose."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from imgtransfer.importers.job import ImportOptions
from render import InputError
from render.files.atomic import check_regular
from render.files.frame_files import MESHES, frame_files
from render.files.mesh_files import SUFFIXES as SINGLE
from render.files.point_caches import SUFFIXES as CACHES


@dataclass(frozen=True)
class Source:
    """Where one clip comes from: moving meshes, and meshes in the rest pose (None takes the first frame)."""

    garment: Path
    body: Path
    template: Path | None
    body_rest: Path | None

    def files(self) -> tuple[Path, ...]:
        """Every file that is read."""
        frames = [
            file
            for moving in (self.garment, self.body)
            for file in ([moving] if moving.suffix.lower() in CACHES else frame_files(moving))
        ]
        return (*frames, *(file for file in (self.template, self.body_rest) if file is not None))


def find_source(folder: Path, options: ImportOptions) -> Source:
    """The files of one clip in its folder; `options.template` and `options.body_rest` come before what is there.

    Raises:
        InputError: no such folder, or no garment or body in it.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; one with garment and body frames is wanted")
    garment, body = (_wanted(folder, what) for what in ("garment", "body"))
    return Source(
        garment,
        body,
        options.template or _single(folder, "template"),
        options.body_rest or _single(folder, "body_rest"),
    )


def find_body(folder: Path, body_rest: Path | None = None) -> tuple[Path, Path | None]:
    """The moving body in a clip's folder, and its rest pose (None takes the first frame); `body_rest` comes first.

    Raises:
        InputError: no body in it.
    """
    return _wanted(folder, "body"), body_rest or _single(folder, "body_rest")


def _wanted(folder: Path, what: str) -> Path:
    found = moving_in(folder, what)
    if found is None:
        raise InputError(
            f"{folder}: no {what} in it; wanted is a folder {what}/ of OBJ or PLY frames, frames "
            f"{what}_0000.obj and so on, or a point cache {what}.pc2 (.mdd, .pc16)"
        )
    return found


def moving_in(folder: Path, what: str) -> Path | None:
    """Where a clip's folder has its "garment" or "body": a folder, a cache, or a pattern of frames; None if nowhere."""
    if (folder / what).is_dir():
        return folder / what
    for suffix in CACHES:
        if _there(cache := folder / f"{what}{suffix}", "a point cache"):
            return cache
    for suffix in MESHES:
        if any(folder.glob(f"{what}*[0-9]{suffix}")):
            return folder / f"{what}*[0-9]{suffix}"
    return None


def _single(folder: Path, what: str) -> Path | None:
    """A mesh file of this name in the folder, or in the one above."""
    places = [place / f"{what}{suffix}" for place in (folder, folder.resolve().parent) for suffix in SINGLE]
    return next((place for place in places if _there(place, "a mesh file")), None)


def _there(path: Path, wanted: str) -> bool:
    """Whether there is such a file; InputError for anything else of that name, which nobody would be told of."""
    if not os.path.lexists(path):
        return False
    check_regular(path, wanted)
    return True


def check_frames(source: Source) -> None:
    """Compare the frames' files before any is read; caches are compared when they are read.

    Raises:
        InputError: garment and body have different numbers of frames.
    """
    if any(moving.suffix.lower() in CACHES for moving in (source.garment, source.body)):
        return
    garment, body = frame_files(source.garment), frame_files(source.body)
    if len(garment) != len(body):
        raise InputError(
            f"{source.garment}: {len(garment)} frames ({garment[0].name} to {garment[-1].name}), but {source.body} has "
            f"{len(body)} ({body[0].name} to {body[-1].name}); both must have the same frames"
        )
