"""Folders that are wrong as a whole: names of frames, links in circles, pictures of other people, titles with codes."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from pathlib import Path

from tests.bad_inputs.case import CONTENT, SECRET, Case


def _renamed(names: dict[str, str]) -> Callable[[Path, random.Random], object]:
    def spoil(folder: Path, _: random.Random) -> None:
        for old, new in names.items():
            (folder / old).rename(folder / new)

    return spoil


def _linked(file: str, target: str) -> Callable[[Path, random.Random], object]:
    def spoil(folder: Path, _: random.Random) -> None:
        (folder / file).unlink(missing_ok=True)
        (folder / file).symlink_to(target)

    return spoil


def _frames(form: str) -> dict[str, str]:
    days = ("20240101120000", "20240215120000", "20240301120000")
    return {f"garment_{n:04d}.obj": form.format(day) for n, day in enumerate(days)}


def _picture(line: str) -> Callable[[Path, random.Random], object]:
    """A material library that names an image; {outside} stands for a folder that is nobody's business."""

    def spoil(file: Path, _: random.Random) -> object:
        outside = file.parents[3]
        (outside / SECRET).write_bytes((file.parent / "weave.png").read_bytes() + CONTENT)
        return file.write_text("newmtl cloth\n" + line.format(outside=outside) + "\n")

    return spoil


def _linked_picture(file: Path, _: random.Random) -> None:
    outside = file.parents[3]
    (outside / SECRET).write_bytes(file.read_bytes() + CONTENT)
    file.unlink()
    file.symlink_to(outside / SECRET)


def _titled(file: Path, _: random.Random) -> None:
    stored = json.loads(file.read_text())
    stored["attributes"] |= dict.fromkeys(("title", "source", "licence"), "\x1b]0;red\x07\x9b31m")
    file.write_text(json.dumps(stored))


_MESHES = "fuse --maps maps.npz --template walk/template.obj --meshes obj --config fusion.yaml --out out"
# name: command line, what is spoiled, how, what the message may name
SPECIAL: dict[str, tuple[str, str, Callable[[Path, random.Random], object], str]] = {
    "import-time-stamps": (
        "import meshes walk --split train --anyway --to out",
        "walk/garment",
        _renamed(_frames("garment_{}.obj")),
        "walk",
    ),
    "render-time-stamps": (
        "render frames --template template.obj --size 24 --out out",
        "frames",
        _renamed(_frames("g{}.obj")),
        "frames",
    ),
    "render-frame-digits": (
        "render frames --template template.obj --size 24 --out out",
        "frames",
        _renamed({"garment_0002.obj": f"garment_{'9' * 200}.obj"}),
        "frames",
    ),
    "fuse-folder-loop": (
        "fuse --maps maps.npz --body walk --config fusion.yaml --out out",
        "walk",
        _linked("again.obj", "again.obj"),
        "again.obj",
    ),
    "import-set-loop": ("import set --split train --to out", "set/tube", _linked("again", "../tube"), "set"),
    "inspect-set-loop": ("inspect set", "set", _linked("again", "."), "set"),
    "fuse-picture-elsewhere": (
        _MESHES,
        "walk/cloth.mtl",
        _picture(f"map_Kd {{outside}}/{SECRET}"),
        "cloth.mtl",
    ),
    "fuse-picture-above": (_MESHES, "walk/cloth.mtl", _picture(f"map_Kd ../../../{SECRET}"), "cloth.mtl"),
    "fuse-picture-of-the-system": (_MESHES, "walk/cloth.mtl", _picture("map_Kd /dev/zero"), "cloth.mtl"),
    "fuse-picture-link": (_MESHES, "walk/weave.png", _linked_picture, "weave.png"),
    "inspect-title": ("inspect set", "set/zarr.json", _titled, "set"),
    "inspect-title-page": ("inspect set --html out/page.html", "set/zarr.json", _titled, "set"),
}


def _special(
    name: str, line: str, file: str, spoil: Callable[[Path, random.Random], object], named: str
) -> Case:
    return Case(
        f"special-{name}",
        tuple(line.split()),
        ("cloth.mtl", "weave.png", file.split("/", maxsplit=1)[0]),
        named=(named,),
        harmless=not name.endswith(("stamps", "digits")),
        file=file,
        spoil=spoil,
    )


def special_cases() -> list[Case]:
    """All of them."""
    return [_special(name, *entry) for name, entry in SPECIAL.items()]
