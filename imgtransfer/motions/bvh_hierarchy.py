"""The hierarchy of a BVH file: its joints, their offsets and channels."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from render import InputError

DEEPEST = 200  # joints from the root to a hand's last finger are about 15
LARGEST = 1e9  # of an offset, an angle or a place, in whatever unit the file has
_JOINT = re.compile(r"[ \t]*(?:ROOT|JOINT)(?:[ \t]+(.*?))?[ \t]*(?:((?<=[ \t])\{.*)|(\{))?", re.I)
_CHANNELS = {f"{axis}{kind}" for axis in "XYZ" for kind in ("position", "rotation")}
_CHANNEL_OF = {channel.lower(): channel for channel in _CHANNELS}
_KEYWORDS = ("OFFSET", "CHANNELS", "END")
_END_SITE = -2


@dataclass
class Joint:
    """A joint as the file has it; `announced` is the number that CHANNELS gives."""

    name: str
    parent: int
    offset: Sequence[float] = (0.0, 0.0, 0.0)
    announced: int = 0
    channels: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Name:
    """A joint's name, which may hold any characters: among the hierarchy's words, one that is none of them."""

    text: str


def read_hierarchy(text: str, path: Path) -> list[Joint]:
    """The joints of a hierarchy, parents first, from what stands between HIERARCHY and MOTION.

    Raises:
        InputError: a word where none such may stand, braces that do not match, joints nested without end, channels
            that there are not, or numbers that are none.
    """
    tokens = list(_tokens(text))
    _check_braces(path, tokens)
    joints: list[Joint] = []
    within: list[int] = []  # numbers of the joints whose braces are open, _END_SITE for an end site's
    coming: int | None = None  # the same of what was named and has no brace yet
    rest = _Words(tokens)
    for token in rest:
        inside = within[-1] if within else -1
        keyword = token.upper() if isinstance(token, str) else ""
        if isinstance(token, _Name) and inside != _END_SITE and coming is None:
            coming = len(joints)
            joints.append(Joint(token.text, inside))
        elif keyword == "END" and inside >= 0 and coming is None:
            rest.values()
            coming = _END_SITE
        elif keyword == "{" and coming is not None:
            within.append(coming)
            coming = None
        elif keyword == "}" and within and coming is None:
            within.pop()
        elif keyword == "OFFSET" and within:
            offset = numbers(path, rest.values(), "OFFSET")
            if len(offset) != 3:
                raise InputError(f"{path}: an OFFSET has {len(offset)} numbers, 3 are wanted")
            if inside >= 0:
                joints[inside].offset = offset
        elif keyword == "CHANNELS" and inside >= 0:
            joints[inside].announced, joints[inside].channels = _channels(path, rest.values())
        else:
            word = token if isinstance(token, str) else f"JOINT {token.text}"
            raise InputError(f"{path}: not a readable BVH file ('{word[:40]}' stands where no such word may)")
    if not joints:
        raise InputError(f"{path}: not a readable BVH file (no ROOT)")
    return joints


def _tokens(text: str) -> Iterator[str | _Name]:
    for line in text.split("\n"):
        joint = _JOINT.fullmatch(line)
        rest = line
        if joint is not None:
            yield _Name((joint[1] or "").strip())
            rest = joint[2] or joint[3] or ""
        yield from rest.replace("{", " { ").replace("}", " } ").split()


class _Words:
    """Words in turn, of which those that belong to a keyword can be taken together."""

    def __init__(self, tokens: Sequence[str | _Name]) -> None:
        self._tokens = tokens
        self._position = 0

    def __iter__(self) -> Iterator[str | _Name]:
        while self._position < len(self._tokens):
            self._position += 1
            yield self._tokens[self._position - 1]

    def values(self) -> list[str]:
        """The words up to the next brace, name or keyword."""
        taken = []
        for token in self._tokens[self._position :]:
            if isinstance(token, _Name) or token in "{}" or token.upper() in _KEYWORDS:
                break
            taken.append(token)
        self._position += len(taken)
        return taken


def _check_braces(path: Path, tokens: Sequence[str | _Name]) -> None:
    depth = deepest = 0
    for token in tokens:
        depth += (token == "{") - (token == "}")
        deepest = max(deepest, depth)
        if depth < 0:
            break
    if depth != 0:
        raise InputError(f"{path}: the hierarchy's braces do not match; the file is damaged")
    if deepest > DEEPEST:
        raise InputError(f"{path}: joints are nested {deepest} deep, at most {DEEPEST} can be read")


def _channels(path: Path, words: Sequence[str]) -> tuple[int, tuple[str, ...]]:
    """The announced number of channels, and their names."""
    if not words or not words[0].isdecimal():
        raise InputError(f"{path}: not a readable BVH file (CHANNELS without their number)")
    unknown = [word for word in words[1:] if word.lower() not in _CHANNEL_OF]
    if unknown:  # its values would go to the channels that follow
        raise InputError(
            f"{path}: a channel is called '{unknown[0]}'; known are {', '.join(sorted(_CHANNELS))}"
        )
    return int(words[0][:6]), tuple(_CHANNEL_OF[word.lower()] for word in words[1:])


def numbers(path: Path, words: Sequence[str], what: str) -> list[float]:
    """Words as numbers.

    Raises:
        InputError: one that is none, or beyond ±10⁹; `what` says where it stands.
    """
    try:
        values = list(map(float, words))
    except ValueError as error:
        raise InputError(f"{path}: not a readable BVH file ({what}: {error})") from error
    for value in values:
        if not abs(value) <= LARGEST:
            raise InputError(f"{path}: {what} holds {value:g}; finite numbers up to {LARGEST:g} are wanted")
    return values
