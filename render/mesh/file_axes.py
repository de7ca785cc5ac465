"""What a file says of the coordinates in it."""

from __future__ import annotations

from dataclasses import dataclass

from render.errors import InputError


@dataclass(frozen=True)
class FileAxes:
    """How a file's coordinates lie, by its own word.

    Args:
        up: the axis that points up, such as "z". metres: of one unit of the file.

    Raises:
        InputError: another axis than y or z, or a unit that no length is measured in.
    """

    up: str
    metres: float

    def __post_init__(self) -> None:
        if self.up not in ("y", "z"):
            raise InputError(f"its up axis is {self.up}; y or z is wanted")
        if not 1e-6 <= self.metres <= 1e6:
            raise InputError(f"its unit is {self.metres:g} m; from a micrometre to 1000 km is wanted")
