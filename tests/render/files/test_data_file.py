"""Files that are no data are told by one line each."""

import os
import re

import pytest

from render import InputError
from render.files import data_file
from render.files.data_file import check_data_file

POINTER = "version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 5\n"


def message(path, **options):
    with pytest.raises(InputError) as caught:
        check_data_file(path, "a point cache", **options)
    text = str(caught.value)
    assert text.startswith(f"{path}: ")
    assert "\n" not in text
    return text


def test_a_file_with_something_in_it_is_let_pass(tmp_path):
    (tmp_path / "a.pc2").write_bytes(b"v")
    check_data_file(tmp_path / "a.pc2", "a point cache")


def test_what_is_none_is_named(tmp_path):
    (tmp_path / "empty.pc2").touch()
    assert "the file is empty; a point cache is wanted" in message(tmp_path / "empty.pc2")
    (tmp_path / "pointer.pc2").write_text(POINTER)
    assert "a pointer of Git LFS, not the data; run `git lfs pull`" in message(tmp_path / "pointer.pc2")
    assert "a point cache" in message(tmp_path / "missing.pc2")
    assert "a point cache" in message(tmp_path)
    os.mkfifo(tmp_path / "pipe.pc2")
    assert "pipe" in message(tmp_path / "pipe.pc2")


def test_only_the_beginning_makes_a_pointer(tmp_path):
    (tmp_path / "a.pc2").write_text("\n" + POINTER)
    check_data_file(tmp_path / "a.pc2", "a point cache")


def test_more_than_the_memory_is_refused_where_it_is_read_at_once(tmp_path, monkeypatch):
    path = tmp_path / "large.pc2"
    with path.open("wb") as file:
        file.truncate(3 * 2**30)  # takes no room on the disk
    monkeypatch.setattr(data_file, "available_bytes", lambda: 2**30)
    assert re.search(r"3\.0 GiB, and 1\.0 GiB of memory are free", message(path))
    check_data_file(path, "a point cache", whole=False)
    monkeypatch.setattr(data_file, "available_bytes", lambda: None)  # a system that does not say
    check_data_file(path, "a point cache")
