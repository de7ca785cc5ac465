"""Fingerprints of what results are made from."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest

from imgtransfer.running import fingerprint as module
from imgtransfer.running.fingerprint import files_fingerprint, fingerprint, made_anew, recorded


def test_a_fingerprint_is_of_the_parts_in_their_order() -> None:
    wanted = hashlib.sha256(b"a|bc|\x01\x00\x02\x00").hexdigest()[:16]
    assert fingerprint(["a", b"bc", np.array([1, 2], "<i2").data]) == wanted
    assert fingerprint(["bc", "a"]) != fingerprint(["a", "bc"])
    assert fingerprint(["ab", "c"]) != fingerprint(["a", "bc"])
    assert fingerprint([]) == fingerprint([""])
    assert fingerprint([np.zeros((0, 3)).data]) == fingerprint([b""])


def test_files_count_by_what_they_hold(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    one, other = tmp_path / "one", tmp_path / "other"
    one.write_bytes(b"0123456789")
    assert files_fingerprint([one]) == hashlib.sha256(b"10:0123456789").hexdigest()[:16]
    assert files_fingerprint([one, other]) == hashlib.sha256(b"10:0123456789missing").hexdigest()[:16]
    before = files_fingerprint([one])
    one.rename(other)
    assert files_fingerprint([other]) == before
    monkeypatch.setattr(module, "_BLOCK", 3)
    assert files_fingerprint([other]) == before


def test_the_record_of_earlier_imports_is_known() -> None:
    assert recorded({"made": "a", "imported": "b"}) == "a"
    assert recorded({"imported": "b"}) == "b"
    assert recorded({"source": "c"}) is None


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


def test_what_is_made_from_a_clip_does_not_take_over_its_fingerprint() -> None:
    info = {"made": "a", "imported": "b", "source": "c"}
    assert made_anew(info) == {"source": "c"}
    assert info["made"] == "a"  # the clip's own stays
