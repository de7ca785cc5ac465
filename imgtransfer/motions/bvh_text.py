"""Parser of BVH files: the text of every tool to joints and numbers, damaged files refused in one line."""

from __future__ import annotations

import codecs
import logging
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from imgtransfer.motions.bvh_hierarchy import numbers, read_hierarchy
from render import InputError
from render.files.atomic import check_regular

_log = logging.getLogger(__name__)

_MARKS = ((codecs.BOM_UTF8, "utf-8"), (codecs.BOM_UTF16_LE, "utf-16-le"), (codecs.BOM_UTF16_BE, "utf-16-be"))
_MOTION = re.compile(
    r"^[ \t]*MOTION[ \t]*\n\s*Frames[ \t]*:?[ \t]*([0-9]+)[ \t]*\n\s*Frame[ \t]*Time[ \t]*:?[ \t]*(\S+)[ \t]*(?:\n|\Z)",
    re.M | re.I,
)


@dataclass(frozen=True, eq=False)
class BvhText:
    """What stands in a BVH file, nothing derived.

    names: of the J joints, as written, parents first. parents: their numbers, -1 for a root; there may be several
    roots. offsets: (J, 3). channels: of each joint, `Xposition` to `Zrotation`, in the file's order. values: (T, C)
    of all channels, joint by joint. frame_time: as written, seconds.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: np.ndarray
    channels: tuple[tuple[str, ...], ...]
    values: np.ndarray
    frame_time: str


def parse_bvh(path: Path) -> BvhText:
    """Parse a BVH file in UTF-8, UTF-16 or any 8-bit encoding, with a byte order mark or without.

    Keywords may have any case, names any characters, and a frame may go over several lines.

    Raises:
        InputError: no such file, none of text, one without its end or with other numbers of values than channels,
            joints nested without end, or numbers that are none or beyond ±10⁹.
    """
    check_regular(path, "a BVH file")
    text = _decoded(path)
    match = _MOTION.search(text)
    if text.lstrip()[:9].upper() != "HIERARCHY" or match is None:
        raise InputError(
            f"{path}: not a whole BVH file, which has HIERARCHY, MOTION, Frames: and Frame Time: in this order"
        )
    hierarchy = read_hierarchy(text[: match.start()].lstrip()[9:], path)
    # By the ends of lines only: other signs, at which `splitlines` also cuts, end no line for a reader of files.
    lines = [line for line in text[match.end() :].split("\n") if line.strip()]
    values = _frames(path, lines, int(match[1][:12]), sum(joint.announced for joint in hierarchy))
    for joint in hierarchy:
        if joint.announced != len(joint.channels):
            raise InputError(
                f"{path}: joint {joint.name} announces {joint.announced} channels and names {len(joint.channels)}"
            )
    return BvhText(
        tuple(joint.name for joint in hierarchy),
        tuple(joint.parent for joint in hierarchy),
        np.array([joint.offset for joint in hierarchy], np.float64),
        tuple(joint.channels for joint in hierarchy),
        values,
        match[2],
    )


def _decoded(path: Path) -> str:
    """The file's text with \\n at the ends of lines."""
    content = path.read_bytes()
    refusal = f"{path}: not a BVH file, which would be text"
    for mark, encoding in _MARKS:
        if content.startswith(mark):
            try:
                text = content[len(mark) :].decode(encoding)
            except UnicodeDecodeError as error:
                raise InputError(refusal) from error
            if encoding != "utf-8" and text.lstrip()[:9].upper() != "HIERARCHY":
                raise InputError(refusal)
            break
    else:
        if b"\0" in content:
            raise InputError(refusal)
        try:
            text = content.decode("utf-8")
        except UnicodeDecodeError:
            # Names in an encoding that nobody tells: as bytes they stay different, and all else is ASCII.
            text = content.decode("latin-1")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _frames(path: Path, lines: list[str], announced: int, channels: int) -> np.ndarray:
    """(T, C) values; a frame is a line, or several that hold its values."""
    if len(lines) < announced:
        raise InputError(f"{path}: cut off, it announces {announced} frames and holds {len(lines)}")
    frames: list[list[float]] = []
    begun: list[float] = []
    for number, line in enumerate(lines):
        if len(frames) == announced:
            _log.warning(
                "note: %s: %d lines follow the %d frames that it announces, and are left out",
                path,
                len(lines) - number,
                announced,
            )
            break
        begun += numbers(path, line.split(), f"frame {len(frames)}")
        if len(begun) == channels:
            frames.append(begun)
            begun = []
        elif len(begun) > channels:
            break
    if begun:
        raise InputError(f"{path}: frame {len(frames)} has {len(begun)} values for {channels} channels")
    if len(frames) < announced:
        raise InputError(f"{path}: cut off, it announces {announced} frames and holds {len(frames)}")
    return np.array(frames, np.float64).reshape(announced, channels)
