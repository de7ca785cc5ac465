"""Hidden files and folders beside what they become: their writer's while it lives, cleared or put back once it died.

A temporary is `.NAME-xxxxxxxx`. Its writer keeps it locked, so one that can be locked is of a writer that died. A
folder is put into place by swapping it with what stands there, in one step where the system can. Elsewhere what stood
there is `.NAME-xxxxxxxx.old` for a moment; should the writer die in it, whoever comes next gives it its name back.
"""

from __future__ import annotations

import ctypes
import errno
import os
import re
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from fcntl import LOCK_EX, LOCK_NB, flock
from functools import cache
from pathlib import Path
from typing import Any

OLD = ".old"
_MARK = r"-(?:[a-z0-9_]{8}|\d+-\d+)"  # as `tempfile` makes them; pairs of numbers are from earlier versions
_HIDDEN = re.compile(rf"\.(?P<name>.+){_MARK}(?P<old>{re.escape(OLD)})?")
# Where the file system has no locks (some network ones), only time tells that a writer is dead: seconds since a change.
_MOVING, _WRITING = 60.0, 86400.0
_HERE, _SWAP = -100, 2  # AT_FDCWD and RENAME_EXCHANGE of Linux' renameat2


@contextmanager
def temporary_beside(target: Path, *, folder: bool = False) -> Iterator[Path]:
    """Yield a new file or folder beside `target`, ours until the end; what has its name then is removed.

    First, what writers of `target` that died have left is put back or removed. A file keeps the suffix of `target`.
    """
    clear(target)
    path, handle = _made(target, folder)
    try:
        yield path
    finally:
        _remove(path)
        os.close(handle)


def put_in_place(temporary: Path, target: Path) -> None:
    """Give a folder the name `target`; what stood there is removed, or called `temporary` now.

    Whenever the process is killed, one of the two stands there, or will be put back. Of two processes that do so at
    once, the later one wins.
    """
    while True:
        try:
            temporary.rename(target)  # nothing, or an empty folder, stands there
        except OSError as error:
            if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
                raise
        else:
            return
        with suppress(FileNotFoundError):  # removed by another process meanwhile
            if swap(temporary, target) or _moved_aside(temporary, target):
                return


def put_back(folder: Path, *, holding: str) -> None:
    """Give folders in `folder` back the names from which writers that died had moved them aside.

    Only those with a file `holding`, because others may be the user's.
    """
    for path, match in _hidden(folder):
        if match["old"] and (path / holding).is_file():
            _put_back(path, folder / match["name"])


def clear_all(folder: Path) -> None:
    """`clear` for every name in `folder`, in which all that is hidden and named like temporaries is such."""
    for path, match in _hidden(folder):
        _clear(path, folder / match["name"])


def clear(target: Path) -> None:
    """Remove what writers of `target` that died have left beside it; what is the only copy is put back instead."""
    start = f".{target.stem}-"
    ours = re.compile(
        rf"\.{re.escape(target.stem)}{_MARK}{re.escape(target.suffix)}|\.{re.escape(target.name)}{_MARK}({re.escape(OLD)})?"
    )
    for path in _entries(target.parent):
        if path.name.startswith((start, f".{target.name}-")) and ours.fullmatch(path.name):
            _clear(path, target)


def swap(one: Path, other: Path) -> bool:
    """Exchange two names in one step; False where the system or the file system cannot.

    Raises:
        FileNotFoundError: one of them does not exist.
    """
    rename = _renameat2()
    if rename is None:
        return False
    if rename(_HERE, os.fsencode(one), _HERE, os.fsencode(other), _SWAP) == 0:
        return True
    if ctypes.get_errno() == errno.ENOENT:
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(other))
    return False  # whatever else it is, renaming one after the other shows it again


@cache
def _renameat2() -> Any:
    return getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)


def _moved_aside(temporary: Path, target: Path) -> bool:
    """`swap` in two steps; False where another process was quicker in between."""
    old = temporary.with_name(temporary.name + OLD)
    try:
        target.rename(old)
        temporary.rename(target)
    except OSError as error:
        if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
            raise
        return False
    finally:
        if not target.exists():
            _rename(old, target)
        if target.exists():
            _remove(old)
    return True


def _clear(path: Path, target: Path) -> None:
    """Remove what a dead writer of `target` left at `path`, or put it back if it is the only copy."""
    if path.name.endswith(OLD):
        _put_back(path, target)
        if not target.exists():
            return
    with _locked(path) as locked:
        if locked or (locked is None and _age(path) > _WRITING):
            _remove(path)


def _put_back(old: Path, target: Path) -> None:
    """Rename `old` to `target` if nothing stands there and the process that moved it away is dead."""
    if target.exists():
        return
    writing = old.with_name(old.name.removesuffix(OLD))
    with _locked(writing) as locked:
        if locked or not writing.exists() or (locked is None and _age(old) > _MOVING):
            _rename(old, target)


def _rename(old: Path, target: Path) -> None:
    with suppress(OSError):  # there is none, another process did it, or nobody may write here
        old.rename(target)


def _made(target: Path, folder: bool) -> tuple[Path, int]:
    """A new hidden file or folder and a handle that keeps it locked."""
    while True:
        if folder:
            path = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent))
            handle = os.open(path, os.O_RDONLY)
        else:
            handle, name = tempfile.mkstemp(
                prefix=f".{target.stem}-", suffix=target.suffix, dir=target.parent
            )
            path = Path(name)
        with suppress(OSError):  # held, or removed, by a process that found it before it was locked
            if _lock(handle) is not False and path.stat().st_ino == os.fstat(handle).st_ino:
                return path, handle
        os.close(handle)


@contextmanager
def _locked(path: Path) -> Iterator[bool | None]:
    """Hold the lock of a temporary: True where its writer is dead, False where it lives, None where nobody knows."""
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW)
    except OSError:  # gone meanwhile, or not ours
        yield False
        return
    try:
        yield _lock(handle)
    finally:
        os.close(handle)  # and frees it


def _lock(handle: int) -> bool | None:
    """Lock an open file or folder: False where another process has it, None where the file system has no locks."""
    try:
        flock(handle, LOCK_EX | LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return None
    return True


def _hidden(folder: Path) -> list[tuple[Path, re.Match[str]]]:
    """Temporaries in a folder, the latest first."""
    temporaries = [(path, match) for path in _entries(folder) if (match := _HIDDEN.fullmatch(path.name))]
    return sorted(temporaries, key=lambda pair: _age(pair[0]))


def _entries(folder: Path) -> list[Path]:
    try:
        return list(folder.iterdir())
    except OSError:  # no such folder, or not to be read
        return []


def _age(path: Path) -> float:
    """Seconds since a file or folder was changed or renamed."""
    try:
        status = path.stat()
    except OSError:
        return 0.0
    return time.time() - max(status.st_mtime, status.st_ctime)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with suppress(OSError):
            path.unlink(missing_ok=True)
