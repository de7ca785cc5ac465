"""Faults of any file: its bytes, and other things in its place."""

from __future__ import annotations

import os
import random
import shutil
from pathlib import Path

from tests.bad_inputs.case import Fault


def _flip(path: Path, rng: random.Random) -> None:
    content = bytearray(path.read_bytes())
    for _ in range(rng.choice((1, 1, 3, 20))):
        content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
    path.write_bytes(content)


def _flip_head(path: Path, rng: random.Random) -> None:
    content = bytearray(path.read_bytes())
    content[rng.randrange(min(len(content), 200))] ^= 1 << rng.randrange(8)
    path.write_bytes(content)


def _head_word(path: Path, rng: random.Random) -> None:
    """Counts and sizes stand in the first bytes of most binary files."""
    content = bytearray(path.read_bytes())
    at = 4 * rng.randrange(min(len(content), 96) // 4)
    content[at : at + 4] = rng.choice(
        (b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\x7f\xff\xff\xff", bytes(4))
    )
    path.write_bytes(content)


def _cut(path: Path, rng: random.Random) -> None:
    content = path.read_bytes()
    path.write_bytes(content[: rng.randrange(1, len(content))])


def _cut_end(path: Path, rng: random.Random) -> None:
    content = path.read_bytes()
    path.write_bytes(content[: -rng.randrange(1, min(40, len(content)))])


def _zeros(path: Path, rng: random.Random) -> None:
    content = bytearray(path.read_bytes())
    start = rng.randrange(len(content))
    stop = min(len(content), start + rng.choice((8, 64, 4096)))
    content[start:stop] = bytes(stop - start)
    path.write_bytes(content)


def _noise(path: Path, rng: random.Random) -> None:
    path.write_bytes(rng.randbytes(rng.choice((1, 10, 1000, 20000))))


def _inserted(path: Path, rng: random.Random) -> None:
    content = path.read_bytes()
    at = rng.randrange(len(content))
    path.write_bytes(content[:at] + rng.randbytes(rng.randrange(1, 30)) + content[at:])


def _fifo(path: Path, _: random.Random) -> None:
    path.unlink()
    os.mkfifo(path)


def _folder(path: Path, _: random.Random) -> None:
    path.unlink()
    path.mkdir()


def _link(target: str) -> object:
    def spoil(path: Path, _: random.Random) -> None:
        path.unlink()
        path.symlink_to(path if target == "itself" else target)

    return spoil


def _remove(path: Path, _: random.Random) -> None:
    shutil.rmtree(path) if path.is_dir() else path.unlink()


WHOLE = (
    Fault("empty", lambda path, _: path.write_bytes(b"")),
    Fault("missing", _remove),
    Fault("fifo", _fifo),
    Fault("folder", _folder),
    Fault("endless-device", _link("/dev/zero")),
    Fault("empty-device", _link("/dev/null")),
    Fault("link-to-itself", _link("itself")),
    Fault("noise", _noise),
)
PARTS = (
    Fault("cut", _cut, harmless=True),
    Fault("cut-end", _cut_end, harmless=True),
    Fault("bit-flip", _flip, harmless=True),
    Fault("bit-flip-head", _flip_head, harmless=True),
    Fault("head-word", _head_word, harmless=True),
    Fault("zeros", _zeros, harmless=True),
    Fault("inserted", _inserted, harmless=True),
)
