"""What a bad input is: a command line, one file of it spoiled in one way, and what may happen then."""

from __future__ import annotations

import random
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

# A file outside of the input, and what it ends with, which must not come into an output.
SECRET, CONTENT = "secret.png", b"nobody's business"
Spoil = Callable[[Path, random.Random], object]


@dataclass(frozen=True)
class Fault:
    """One way to spoil a file.

    Args:
        name: in the names of cases.
        spoil: changes the file in place; all it draws comes from the generator.
        harmless: what comes out may be good input, which the command then may use.
    """

    name: str
    spoil: Spoil
    harmless: bool = False


@dataclass(frozen=True)
class Reading:
    """A command that reads a file.

    Args:
        name: of the command, in the names of cases.
        argv: its words, relative to the folder of the good input.
        file: that is spoiled.
        needs: what else it reads, but for what `argv` names.
        writes: what it may change.
        named: what the message may name in place of the file's own name or of its folder in `argv`.
        optional: the command can do without the file.
    """

    name: str
    argv: str
    file: str
    needs: tuple[str, ...] = ()
    writes: tuple[str, ...] = ("out",)
    named: tuple[str, ...] = ()
    optional: bool = False


@dataclass(frozen=True)
class Case:
    """A reading with a fault, or a command line that is wrong in itself.

    Args:
        name: says which, and is the seed.
        argv: the words.
        needs, writes: as of `Reading`.
        named: one of these must stand in the message.
        harmless: the command may succeed.
        file, spoil: what is spoiled, and how.
    """

    name: str
    argv: tuple[str, ...]
    needs: tuple[str, ...] = ()
    writes: tuple[str, ...] = ("out",)
    named: tuple[str, ...] = ()
    harmless: bool = False
    file: str | None = None
    spoil: Spoil | None = field(default=None, repr=False)

    def prepare(self, folder: Path) -> None:
        """Spoil the file in a copy of the good input."""
        if self.spoil is not None and self.file is not None:
            self.spoil(folder / self.file, random.Random(zlib.crc32(self.name.encode())))


def case_of(reading: Reading, fault: Fault, number: int = 0) -> Case:
    """The reading with the fault; `number` makes another of the same kind."""
    label = reading.file.replace("/", "-").replace(".", "-")
    name = f"{reading.name}-{label}-{fault.name}" + (f"-{number}" if number else "")
    file = Path(reading.file)
    own: tuple[str, ...] = () if file.name == "zarr.json" or "/c/" in reading.file else (file.name,)
    if file.name == "clip.npz":
        own += (f"error: {file.stem}: ",)  # a clip goes by its file's name
    if fault.name in ("missing", "folder", "link-to-itself"):
        own += (reading.file.split("/")[0],)
    no_settings = fault.name.startswith("empty") and file.suffix == ".yaml"  # so the defaults hold
    return Case(
        name=name,
        argv=tuple(reading.argv.split()),
        needs=(reading.file.split("/")[0], *reading.needs),
        writes=reading.writes,
        named=(*own, *reading.named) or (reading.file,),
        harmless=fault.harmless or reading.optional or no_settings,
        file=reading.file,
        spoil=fault.spoil,
    )
