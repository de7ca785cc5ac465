"""Point caches, written here byte by byte; truncated, mislabelled and wrong ones are named."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from render import InputError
from render.files.point_caches import open_cache
from tests.helpers.import_examples import write_mdd, write_pc2

MOVING = np.random.default_rng(0).normal(size=(4, 5, 3)).astype(np.float32)


def test_pc2_by_hand(tmp_path: Path) -> None:
    # Two points, one sample: the header of 32 bytes, then x y z, x y z.
    content = (
        b"POINTCACHE2\0" + struct.pack("<iiffi", 1, 2, 0.0, 1.0, 1) + struct.pack("<6f", 1, 2, 3, 4, 5, 6)
    )
    assert len(content) == 32 + 24
    (tmp_path / "a.pc2").write_bytes(content)
    cache = open_cache(tmp_path / "a.pc2")
    np.testing.assert_array_equal(cache.vertices(), [[[1, 2, 3], [4, 5, 6]]])
    assert cache.fps is None


def test_every_format_comes_back(tmp_path: Path) -> None:
    np.testing.assert_array_equal(open_cache(write_pc2(tmp_path / "a.pc2", MOVING)).vertices(), MOVING)
    halves = open_cache(write_pc2(tmp_path / "a.pc16", MOVING, half=True)).vertices()
    np.testing.assert_array_equal(halves, MOVING.astype(np.float16))
    timed = open_cache(write_mdd(tmp_path / "a.mdd", MOVING, 24.0))
    np.testing.assert_array_equal(timed.vertices(), MOVING)
    assert timed.fps == pytest.approx(24, abs=0.01)
    assert timed.vertices().dtype == np.float32


@pytest.mark.parametrize("suffix", [".pc2", ".pc16", ".mdd"])
@pytest.mark.parametrize(("cut", "message"), [(-7, "truncated"), (5, "longer than it says")])
def test_wrong_lengths(tmp_path: Path, suffix: str, cut: int, message: str) -> None:
    path = tmp_path / f"a{suffix}"
    if suffix == ".mdd":
        write_mdd(path, MOVING, 30)
    else:
        write_pc2(path, MOVING, half=suffix == ".pc16")
    content = path.read_bytes()
    path.write_bytes(content[:cut] if cut < 0 else content + b"\0" * cut)
    with pytest.raises(InputError, match=rf"a\{suffix}: {message}; 4 frames of 5 points need"):
        open_cache(path)


def test_mislabelled_caches(tmp_path: Path) -> None:
    write_pc2(tmp_path / "a.pc2", MOVING, half=True)
    with pytest.raises(
        InputError, match=r"mislabelled, it holds PC16 with 16-bit floats; rename it to \.pc16"
    ):
        open_cache(tmp_path / "a.pc2")
    write_pc2(tmp_path / "a.pc16", MOVING)
    with pytest.raises(InputError, match=r"mislabelled, it holds PC2 with 32-bit floats; rename it to \.pc2"):
        open_cache(tmp_path / "a.pc16")
    write_pc2(tmp_path / "a.mdd", MOVING)
    with pytest.raises(InputError, match="not an MDD point cache"):
        open_cache(tmp_path / "a.mdd")
    (tmp_path / "b.pc2").write_bytes(b"v 0 0 0\n" * 10)
    with pytest.raises(InputError, match="first bytes must be POINTCACHE2"):
        open_cache(tmp_path / "b.pc2")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            b"POINTCACHE2\0" + struct.pack("<iiffi", 1, -3, 0.0, 1.0, 1),
            "says that it has 1 frames of -3 points",
        ),
        (b"POINTCACHE2\0" + struct.pack("<iiffi", 1, 3, 0.0, 1.0, 0), "0 frames"),
        (b"POINTCACHE2\0", "not a point cache"),
        (b"", "empty"),
    ],
)
def test_headers_without_sense(tmp_path: Path, content: bytes, message: str) -> None:
    (tmp_path / "a.pc2").write_bytes(content)
    with pytest.raises(InputError, match=message):
        open_cache(tmp_path / "a.pc2")


def test_values_that_are_not_finite_are_named(tmp_path: Path) -> None:
    broken = MOVING.copy()
    broken[2, 3, 1] = np.nan
    with pytest.raises(InputError, match="frame 2, vertex 3 is"):
        open_cache(write_pc2(tmp_path / "a.pc2", broken)).vertices()


def test_other_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"must be one of \.pc2"):
        open_cache(tmp_path / "a.abc")
    with pytest.raises(InputError, match="no such file"):
        open_cache(tmp_path / "a.pc2")
