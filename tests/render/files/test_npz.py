from __future__ import annotations

import io
import os
import struct
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pytest

from render import InputError
from render.files.npz import open_npz, read_npy, read_npz
from render.files.npz_writer import NpzWriter, joined_crc32, write_npz


def header(text: str, version: tuple[int, int] = (1, 0)) -> bytes:
    body = text.encode() + b"\n"
    return b"\x93NUMPY" + bytes(version) + struct.pack("<H" if version == (1, 0) else "<I", len(body)) + body


def archive(path: Path, **members: bytes) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in members.items():
            file.writestr(f"{name}.npy", content)
    return path


def test_what_numpy_writes_is_read_as_numpy_reads_it(tmp_path: Path) -> None:
    arrays = {
        "floats": np.arange(24, dtype=np.float32).reshape(2, 3, 4),
        "columns": np.asfortranarray(np.arange(6.0).reshape(2, 3)),
        "whole": np.arange(5),
        "swapped": np.arange(3, dtype=">i2"),
        "one": np.float64(30),
        "text": np.str_("ä name"),
        "yes": np.array([True, False]),
        "empty": np.zeros((0, 3)),
    }
    path = tmp_path / "a.npz"
    np.savez(path, **arrays)
    found = read_npz(path)
    assert tuple(found) == tuple(arrays)
    for name, wanted in arrays.items():
        assert found[name].dtype == wanted.dtype
        np.testing.assert_array_equal(found[name], wanted)


def test_numpy_reads_what_is_written(tmp_path: Path) -> None:
    path = tmp_path / "b.npz"
    values = np.arange(30, dtype=np.float32).reshape(5, 2, 3)
    with NpzWriter(path) as out:
        out.append("rows", values[:2])
        out.write("text", np.str_("x"))
        out.append("others", values[:1, 0])
        out.append("rows", values[2:])
    with np.load(path, allow_pickle=False) as stored:
        np.testing.assert_array_equal(stored["rows"], values)
        np.testing.assert_array_equal(stored["others"], values[:1, 0])
        assert str(stored["text"]) == "x"
    assert [entry.name for entry in tmp_path.iterdir()] == ["b.npz"]


def test_the_same_arrays_give_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        with NpzWriter(tmp_path / f"{name}.npz") as out:
            out.write("x", np.arange(4))
            out.append("rows", np.arange(6.0).reshape(2, 3))
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("count", [1, 2, 7, 100])
def test_rows_are_the_array_in_parts(tmp_path: Path, order: str, count: int) -> None:
    values = np.array(np.arange(42.0).reshape(7, 2, 3), order=order)  # type: ignore[call-overload]
    write_npz(tmp_path / "a.npz", {"x": values})
    with open_npz(tmp_path / "a.npz") as npz:
        assert npz.shape("x") == (7, 2, 3)
        parts = list(npz.rows("x", count))
    assert [len(part) for part in parts] == [len(values[i : i + count]) for i in range(0, 7, count)]
    np.testing.assert_array_equal(np.concatenate(parts), values)


def test_two_arrays_are_read_by_rows_at_once(tmp_path: Path) -> None:
    write_npz(tmp_path / "a.npz", {"x": np.arange(6), "y": 10 * np.arange(6)})
    with open_npz(tmp_path / "a.npz") as npz:
        pairs = list(zip(npz.rows("x", 2), npz.rows("y", 2), strict=True))
    np.testing.assert_array_equal([y for _, y in pairs], [[0, 10], [20, 30], [40, 50]])


def test_an_error_leaves_what_stood_there(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    write_npz(path, {"x": np.arange(3)})

    def half_written() -> None:
        with NpzWriter(path) as out:
            out.append("x", np.arange(4))
            raise RuntimeError("in between")

    with pytest.raises(RuntimeError, match="in between"):
        half_written()
    np.testing.assert_array_equal(read_npz(path)["x"], [0, 1, 2])
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.npz"]


FLOATS = "{'descr': '<f4', 'fortran_order': False, 'shape': %s, }"


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (header(FLOATS % "(10000000000, 3)") + bytes(12), "12 are there"),  # 112 GiB, says the header
        (header(FLOATS % "(1, 3)") + bytes(8), "8 are there"),
        (header(FLOATS % "(1, 3)") + bytes(16), "16 are there"),
        (header(FLOATS % "(-1, 3)") + bytes(12), "not a readable plain array"),
        (header(FLOATS % f"({10**30}, 0)"), "not a readable plain array"),
        (header(FLOATS % ("(" * 4000)), "not a readable plain array"),
        (
            header("{'descr': '|O', 'fortran_order': False, 'shape': (1,), }") + b"cos\nsystem\n.",
            "plain numbers",
        ),
        (
            header("{'descr': [('a', '<f4')], 'fortran_order': False, 'shape': (1,), }") + bytes(4),
            "plain numbers",
        ),
        (header("{'descr': '<U0', 'fortran_order': False, 'shape': (1000000000,), }"), "not a readable"),
        (header(FLOATS % "(1, 3)", (9, 9)) + bytes(12), "npy version"),
        (b"not an array", "not a readable plain array"),
        (b"", "not a readable plain array"),
    ],
)
def test_members_that_are_no_arrays_are_refused_in_one_line(
    tmp_path: Path, content: bytes, said: str
) -> None:
    path = archive(tmp_path / "bad.npz", x=content)
    with pytest.raises(InputError, match=said) as caught:
        read_npz(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def encrypted(content: bytes) -> bytes:
    """The flag of encryption set in both headers."""
    changed = bytearray(content)
    changed[6] |= 1
    changed[content.index(b"PK\x01\x02") + 8] |= 1
    return bytes(changed)


def unknown_compression(content: bytes) -> bytes:
    changed = bytearray(content)
    changed[8] = 77
    changed[content.index(b"PK\x01\x02") + 10] = 77
    return bytes(changed)


def flipped(content: bytes) -> bytes:
    """A bit of the data, whose checksum no longer fits."""
    changed = bytearray(content)
    changed[200] ^= 4
    return bytes(changed)


@pytest.mark.parametrize(
    "damage",
    [encrypted, unknown_compression, flipped, lambda c: c[: len(c) // 2], lambda c: b"", lambda c: b"hello"],
)
def test_damaged_archives_are_refused_in_one_line(tmp_path: Path, damage: object) -> None:
    buffer = io.BytesIO()
    np.savez(buffer, x=np.random.default_rng(0).normal(size=100))
    path = tmp_path / "bad.npz"
    path.write_bytes(damage(buffer.getvalue()))  # type: ignore[operator]
    with pytest.raises(InputError) as caught:
        read_npz(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_two_members_of_one_name_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "bad.npz"
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("x.npy", b"")
        file.writestr("x", b"")
    with pytest.raises(InputError, match="two arrays of one name"):
        read_npz(path)


def test_what_is_no_regular_file_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.npz")
    for path, said in (("pipe.npz", "a pipe"), ("", "is a folder"), ("none.npz", "no such file")):
        with pytest.raises(InputError, match=said):
            read_npz(tmp_path / path)


def test_more_than_the_memory_is_refused_before_it_is_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_npz(tmp_path / "a.npz", {"x": np.zeros(1000)})
    monkeypatch.setattr("render.files.npz.available_bytes", lambda: 7999)
    with pytest.raises(InputError, match="memory"):
        read_npz(tmp_path / "a.npz")
    monkeypatch.setattr("render.files.npz.available_bytes", lambda: 8000)
    assert len(read_npz(tmp_path / "a.npz")["x"]) == 1000


@pytest.mark.parametrize(
    "values", [np.arange(6, dtype=">f4"), np.asfortranarray(np.arange(6).reshape(2, 3)), np.float64(3)]
)
def test_an_npy_file_is_read_as_numpy_reads_it(tmp_path: Path, values: np.ndarray) -> None:
    np.save(tmp_path / "a.npy", values)
    np.testing.assert_array_equal(read_npy(tmp_path / "a.npy"), values)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (
            header(FLOATS % "(10000000000, 3)") + bytes(12),
            "120000000000 bytes by its header, and 12 are there",
        ),
        (header(FLOATS % "(1, 3)") + bytes(16), "and 16 are there"),
        (b"PK", "not a readable npy array"),
        (header("{'descr': '|O', 'fortran_order': False, 'shape': (1,), }") + b"cos.", "plain numbers"),
    ],
)
def test_a_damaged_npy_file_is_refused_in_one_line(tmp_path: Path, content: bytes, said: str) -> None:
    (tmp_path / "a.npy").write_bytes(content)
    with pytest.raises(InputError, match=said) as caught:
        read_npy(tmp_path / "a.npy")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("sizes", [(0, 0), (5, 0), (0, 5), (1, 1), (128, 100_003)])
def test_the_checksum_of_two_texts_follows_from_theirs(sizes: tuple[int, int]) -> None:
    first, second = (np.random.default_rng(size).bytes(size) for size in sizes)
    joined = joined_crc32(zlib.crc32(first), zlib.crc32(second), len(second))
    assert joined == zlib.crc32(first + second)


def test_rows_that_wait_are_compressed(tmp_path: Path) -> None:
    with NpzWriter(tmp_path / "r.npz") as out:
        for _ in range(20):
            out.append("rows", np.zeros((1, 1000)))
    with zipfile.ZipFile(tmp_path / "r.npz") as file:
        assert file.testzip() is None
        info = file.getinfo("rows.npy")
    assert info.file_size > 160_000 > 100 * info.compress_size
    assert read_npz(tmp_path / "r.npz")["rows"].shape == (20, 1000)
