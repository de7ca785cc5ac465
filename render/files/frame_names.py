"""Which number in the names of files is the frame's, and what it is."""

from __future__ import annotations

import glob
import re
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

from render.files.naming import natural

# A minus is a sign where nothing or a separator stands before it, as in shirt_-3; in take-3 it may be a hyphen.
_NUMBER = re.compile(r"((?:(?<![^\W_])-)?\d+)")


@dataclass(frozen=True)
class NumberedName:
    """A file's name, taken apart.

    Args:
        file: whose name it is.
        texts: between the numbers; the last one ends with the suffix in lower case.
        numbers: by value, one fewer than the texts.
    """

    file: Path
    texts: tuple[str, ...]
    numbers: tuple[int, ...]

    @classmethod
    def of(cls, file: Path) -> NumberedName:
        """The name of a file; digits of any script are numbers."""
        parts = _NUMBER.split(file.stem)
        texts = (*parts[0:-1:2], parts[-1] + file.suffix.lower())
        return cls(file, texts, tuple(int(number) for number in parts[1::2]))

    def signed(self, column: int) -> NumberedName:
        """The same with a hyphen before a number taken for its sign, if there is one."""
        text = self.texts[column]
        if not text.endswith("-"):
            return self
        texts = (*self.texts[:column], text[:-1], *self.texts[column + 1 :])
        return NumberedName(
            self.file, texts, (*self.numbers[:column], -self.numbers[column], *self.numbers[column + 1 :])
        )

    def without(self, column: int | None, sign: str) -> str:
        """The name with a sign in place of a number."""
        spelled = _NUMBER.split(self.file.stem)[1::2]
        shown = [sign if number == column else text for number, text in enumerate(spelled)]
        return "".join(part for pair in zip(self.texts, [*shown, ""], strict=True) for part in pair)


@dataclass(frozen=True)
class FrameNames:
    """Names that differ by one number, the frame's.

    Args:
        names: of one sequence.
        column: which of their numbers is the frame's; None where they have none.
    """

    names: list[NumberedName]
    column: int | None

    @property
    def title(self) -> str:
        """The names with # in place of the frame's number."""
        return self.names[0].without(self.column, "#")

    def pattern(self, others: Sequence[FrameNames]) -> str:
        """A pattern for these names and, where that can be said by one, for none of the others.

        Brackets and the like in the names are those, and no signs of the pattern.
        """
        parts = [glob.escape(part) for part in self.names[0].without(self.column, "\0").split("\0")]
        strange = [name.file.name for other in others if other is not self for name in other.names]
        patterns = [number.join(parts) for number in ("*", "*[0-9]")]
        return next(
            (one for one in patterns if not any(fnmatchcase(name, one) for name in strange)), patterns[0]
        )


def sequences_of(files: Sequence[Path]) -> list[FrameNames]:
    """The files by their kinds of names. The frame's number is the one that differs, the last of several."""
    alike: dict[tuple[str, ...], list[NumberedName]] = {}
    for name in _taken_apart(files):
        alike.setdefault(name.texts, []).append(name)
    sequences = []
    for names in alike.values():
        count = len(names[0].numbers)
        differing = [column for column in range(count) if len({name.numbers[column] for name in names}) > 1]
        column = differing[-1] if differing else (count - 1 if count else None)
        by_others: dict[tuple[int, ...], list[NumberedName]] = {}
        for name in names:
            others = tuple(number for place, number in enumerate(name.numbers) if place != column)
            by_others.setdefault(others, []).append(name)
        sequences += [FrameNames(those, column) for those in by_others.values()]
    return sorted(sequences, key=lambda sequence: natural(sequence.title))


def _taken_apart(files: Sequence[Path]) -> list[NumberedName]:
    """The files' names; where some have a hyphen before a number and others have none, it is a minus."""
    names = [NumberedName.of(file) for file in files]
    for column in range(max(len(name.numbers) for name in names)):
        signed = [name.signed(column) if column < len(name.numbers) else name for name in names]
        if len({name.texts for name in signed}) < len({name.texts for name in names}):
            names = signed
    return names
