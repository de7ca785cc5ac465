"""Fingerprints of files, by which a thing is known to be made from these very files."""

from __future__ import annotations

from pathlib import Path

from imgtransfer.running.fingerprint import files_fingerprint


def written(folder: Path, **contents: str) -> list[Path]:
    folder.mkdir(exist_ok=True)
    paths = [folder / name for name in contents]
    for path, text in zip(paths, contents.values(), strict=True):
        path.write_text(text)
    return paths


def test_names_and_places_do_not_count(tmp_path: Path) -> None:
    here = files_fingerprint(written(tmp_path / "here", a="one", b="two"))
    assert here == files_fingerprint(written(tmp_path / "there", c="one", d="two"))
    assert len(here) == 16


def test_bytes_order_and_where_one_file_ends_count(tmp_path: Path) -> None:
    files = written(tmp_path, a="ab", b="c", x="a", y="bc")
    first = files_fingerprint(files[:2])
    assert first != files_fingerprint(files[1::-1])
    assert first != files_fingerprint(files[2:])
    files[0].write_text("aB")
    assert first != files_fingerprint(files[:2])


def test_a_missing_file_counts_as_such(tmp_path: Path) -> None:
    missing, empty = tmp_path / "missing", tmp_path / "empty"
    empty.touch()
    assert len({files_fingerprint(files) for files in ([], [missing], [empty])}) == 3
