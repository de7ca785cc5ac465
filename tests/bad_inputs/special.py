"""Folders that are wrong as a whole: names of frames, links in circles."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path

from bad_inputs.case import Case


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
}


def _special(
    name: str, line: str, file: str, spoil: Callable[[Path, random.Random], object], named: str
) -> Case:
    return Case(
        f"special-{name}",
        tuple(line.split()),
        ("cloth.mtl", "weave.png", file.split("/", maxsplit=1)[0]),
        named=(named,),
        harmless=name.endswith("loop"),
        file=file,
        spoil=spoil,
    )


def special_cases() -> list[Case]:
    """All of them."""
    return [_special(name, *entry) for name, entry in SPECIAL.items()]
