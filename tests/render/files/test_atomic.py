"""Files and folders appear whole or not at all, whenever their writer is killed, and dead writers leave nothing."""

from __future__ import annotations

import errno
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from render.files import temporaries
from render.files.atomic import written_whole, written_whole_folder
from render.files.temporaries import put_back, swap
from tests.helpers.full_disk import full_disk

STEPS = (
    "os.rename",
    "os.remove",
    "os.rmdir",
    "os.mkdir",
    "shutil.rmtree",
    "tempfile.mkstemp",
    "tempfile.mkdtemp",
    "open",
)


def test_files_appear_whole_or_not_at_all(tmp_path):
    target = tmp_path / "new" / "a.txt"
    with pytest.raises(TypeError), written_whole(target) as temporary:
        temporary.write_text(None)
    assert list(target.parent.iterdir()) == []
    with written_whole(target) as temporary:
        temporary.write_text("whole")
    assert target.read_text() == "whole"
    assert [path.name for path in target.parent.iterdir()] == ["a.txt"]


def test_folders_appear_whole_or_not_at_all(tmp_path):
    target = tmp_path / "data"
    for text in ("first", "second"):
        with written_whole_folder(target) as temporary:
            (temporary / "a.txt").write_text(text)
    with pytest.raises(TypeError), written_whole_folder(target) as temporary:
        (temporary / "a.txt").write_text(None)
    assert (target / "a.txt").read_text() == "second"
    assert [path.name for path in tmp_path.iterdir()] == ["data"]


def write(target: Path, text: str) -> None:
    """A folder of two files."""
    with written_whole_folder(target) as temporary:
        for name in ("a.txt", "b.txt"):
            (temporary / name).write_text(text)


def content(target: Path) -> list[str]:
    return [(target / name).read_text() for name in ("a.txt", "b.txt")]


def in_child(work: Callable[[], object]) -> int:
    """Do something in a copy of this process; its exit status, -9 where it was killed."""
    child = os.fork()
    if child == 0:
        try:
            work()
            os._exit(0)
        except BaseException:
            os._exit(1)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def killed_before(step: int, work: Callable[[], object]) -> bool:
    """Do something in another process, which is killed as it begins its step-th change of files; False where it is done
    before.
    """

    def killed() -> None:
        left = [step]

        def kill(event: str, _: object) -> None:
            if event in STEPS:
                left[0] -= 1
                if left[0] < 0:
                    os.kill(os.getpid(), signal.SIGKILL)

        sys.addaudithook(kill)
        work()

    status = in_child(killed)
    assert status in (0, -signal.SIGKILL)
    return status != 0


@pytest.fixture(params=["at once", "in two steps"])
def way(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """With the system's exchange of names, and without."""
    (tmp_path / "one").touch()
    (tmp_path / "two").touch()
    assert swap(tmp_path / "one", tmp_path / "two"), "this file system cannot exchange names"
    (tmp_path / "one").unlink()
    (tmp_path / "two").unlink()
    if request.param == "in two steps":
        monkeypatch.setattr(temporaries, "_renameat2", lambda: None)
    return request.param


def test_a_folder_is_whole_whenever_its_writer_is_killed(tmp_path: Path, way: str) -> None:
    aside = 0
    for step in range(100):
        target = tmp_path / str(step) / "data"
        write(target, "first")
        killed = killed_before(step, lambda target=target: write(target, "second"))  # type: ignore[misc]
        aside += not target.exists()
        put_back(target.parent, holding="a.txt")
        assert content(target) in (["first"] * 2, ["second"] * 2)
        write(target, "third")
        assert content(target) == ["third"] * 2
        assert [path.name for path in target.parent.iterdir()] == ["data"]
        if not killed:
            break
    assert not killed
    assert step > 5
    assert aside == (0 if way == "at once" else 1)  # the moment in which there is only the one moved aside


def test_the_only_copy_is_put_back_by_the_next_writer_even_if_that_fails(tmp_path: Path) -> None:
    write(tmp_path / ".walk-01-abcd_123.old", "first")
    with pytest.raises(ZeroDivisionError), written_whole_folder(tmp_path / "walk-01"):
        raise ZeroDivisionError
    assert content(tmp_path / "walk-01") == ["first"] * 2
    assert [path.name for path in tmp_path.iterdir()] == ["walk-01"]


def test_what_earlier_versions_moved_aside_is_put_back(tmp_path: Path) -> None:
    write(tmp_path / ".walk-01-4242-81234567890.old", "first")
    put_back(tmp_path, holding="other.txt")
    assert not (tmp_path / "walk-01").exists()
    put_back(tmp_path, holding="a.txt")
    assert content(tmp_path / "walk-01") == ["first"] * 2


def test_nothing_is_put_back_while_its_writer_lives(tmp_path: Path) -> None:
    with written_whole_folder(tmp_path / "data") as temporary:
        old = temporary.with_name(temporary.name + ".old")
        write(old, "first")
        assert in_child(lambda: put_back(tmp_path, holding="a.txt")) == 0
        assert content(old) == ["first"] * 2


def test_the_later_of_two_writers_wins(tmp_path: Path, way: str) -> None:
    target = tmp_path / "data"
    with written_whole_folder(target) as outer:
        (outer / "by").write_text("outer")
        with written_whole_folder(target) as inner:
            (inner / "by").write_text("inner")
        assert (target / "by").read_text() == "inner"
    assert (target / "by").read_text() == "outer"
    assert [path.name for path in tmp_path.iterdir()] == ["data"]


def test_killed_writers_of_files_leave_nothing_behind_and_living_ones_keep_theirs(tmp_path: Path) -> None:
    target = tmp_path / "model.bin"

    def die() -> None:
        with written_whole(target) as temporary:
            temporary.write_bytes(b"half")
            os.kill(os.getpid(), signal.SIGKILL)

    assert in_child(die) == -signal.SIGKILL
    (left,) = tmp_path.iterdir()
    for name in (".model-12345678.txt", ".model-1234.bin", "model-12345678.bin", ".modelx-12345678.bin"):
        (tmp_path / name).touch()  # not ours
    with written_whole(target) as living:
        assert not left.exists()
        living.write_bytes(b"half")
        assert in_child(lambda: written_whole(target).__enter__()) == 0
        assert living.read_bytes() == b"half"
        living.write_bytes(b"whole")
    assert target.read_bytes() == b"whole"
    assert len(list(tmp_path.iterdir())) == 5


def test_a_link_to_a_folder_stays_a_link(tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    (tmp_path / "data").symlink_to("disk")
    write(tmp_path / "data", "first")
    assert content(tmp_path / "disk") == ["first"] * 2
    assert (tmp_path / "data").is_symlink()


def test_a_folder_does_not_replace_a_file(tmp_path: Path) -> None:
    (tmp_path / "data").write_text("mine")
    with pytest.raises(NotADirectoryError) as error:
        write(tmp_path / "data", "first")
    assert error.value.filename == str(tmp_path / "data")
    assert (tmp_path / "data").read_text() == "mine"
    assert [path.name for path in tmp_path.iterdir()] == ["data"]


@pytest.mark.parametrize("folder", [False, True], ids=["file", "folder"])
def test_a_full_disk_names_the_file_and_leaves_the_one_before(tmp_path: Path, folder: bool) -> None:
    target = tmp_path / "data"
    write(target, "first")
    target = target if folder else target / "a.txt"
    inner = "b.txt" if folder else ""
    with (
        full_disk(4096),
        pytest.raises(OSError, match=os.strerror(errno.EFBIG)) as error,
        (written_whole_folder if folder else written_whole)(target) as temporary,
    ):
        (temporary / inner).write_bytes(bytes(5000))
    assert error.value.filename == str(target)
    assert content(tmp_path / "data") == ["first"] * 2
    assert [path.name for path in tmp_path.iterdir()] == ["data"]
