"""What a BVH file must be before bvhio reads it, which hangs at a missing end and believes every number."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from render import InputError
from render.files.atomic import check_regular

DEEPEST = 200  # joints from the root to a hand's last finger are about 15; each level is a call of the reader
LARGEST = 1e9  # of an offset, an angle or a place, in whatever unit the file has
_MOTION = re.compile(
    r"^[ \t]*MOTION[ \t]*\n\s*Frames:[ \t]*([0-9]+)[ \t]*\n\s*Frame Time:[ \t]*\S+[ \t]*\n", re.M
)
_NUMBERS = re.compile(r"^[ \t]*OFFSET[ \t]+(.*)$", re.M)
_CHANNELS = re.compile(r"^[ \t]*CHANNELS[ \t]+([0-9]{1,3})\b(.*)$", re.M)
_KNOWN = {f"{axis}{kind}" for axis in "XYZ" for kind in ("position", "rotation")}


def check_bvh(path: Path) -> None:
    """Check a BVH file's form and numbers.

    Raises:
        InputError: no such file, none of text, one without its end or with other numbers of values than channels,
            joints nested without end, or numbers that are none or beyond ±10⁹.
    """
    check_regular(path, "a BVH file")
    try:
        text = path.read_text()
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a BVH file, which would be text") from error
    match = _MOTION.search(text)
    if not text.lstrip().startswith("HIERARCHY") or match is None:
        raise InputError(
            f"{path}: not a whole BVH file, which has HIERARCHY, MOTION, Frames: and Frame Time: in this order"
        )
    hierarchy = text[: match.start()]
    _check_braces(path, hierarchy)
    for offset in _NUMBERS.findall(hierarchy):
        _numbers(path, offset, "OFFSET")
    # By the ends of lines only: other signs, at which `splitlines` also cuts, end no line for a reader of files.
    lines = [line for line in text[match.end() :].split("\n") if line.strip()]
    announced = int(match[1][:12])
    if len(lines) < announced:
        raise InputError(f"{path}: cut off, it announces {announced} frames and holds {len(lines)}")
    channels = 0
    for count, names in _CHANNELS.findall(hierarchy):
        channels += int(count)
        unknown = [name for name in names.split() if name not in _KNOWN]
        if unknown:  # bvhio would give its values to the channels that follow
            raise InputError(
                f"{path}: a channel is called '{unknown[0]}'; known are {', '.join(sorted(_KNOWN))}"
            )
    for number, line in enumerate(lines[:announced]):
        values = _numbers(path, line, f"frame {number}")
        if len(values) != channels:
            raise InputError(f"{path}: frame {number} has {len(values)} values for {channels} channels")


def _check_braces(path: Path, hierarchy: str) -> None:
    depth = deepest = 0
    for brace in re.findall(r"[{}]", hierarchy):
        depth += 1 if brace == "{" else -1
        deepest = max(deepest, depth)
        if depth < 0:
            break
    if depth != 0:
        raise InputError(f"{path}: the hierarchy's braces do not match; the file is damaged")
    if deepest > DEEPEST:
        raise InputError(f"{path}: joints are nested {deepest} deep, at most {DEEPEST} can be read")


def _numbers(path: Path, text: str, what: str) -> np.ndarray:
    try:
        values = np.array(text.split(), np.float64)
    except ValueError as error:
        raise InputError(f"{path}: not a readable BVH file ({what}: {error})") from error
    if not (np.abs(values) <= LARGEST).all():
        bad = values[~(np.abs(values) <= LARGEST)][0]
        raise InputError(f"{path}: {what} holds {bad:g}; finite numbers up to {LARGEST:g} are wanted")
    return values
