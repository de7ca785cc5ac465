"""Files that appear whole or not at all."""

from __future__ import annotations

import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from render.errors import InputError


@contextmanager
def written_whole(target: Path) -> Iterator[Path]:
    """Yield a temporary file beside `target`; rename it to `target` on success, remove it on any error.

    The parent folder is made where it is missing. The temporary file keeps the suffix of `target`, because
    writers choose the format by it.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=f".{target.stem}-", suffix=target.suffix, dir=target.parent)
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        temporary.chmod(0o644)  # mkstemp's 0600 would keep the file from colleagues
        temporary.replace(target)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def written_whole_folder(target: Path) -> Iterator[Path]:
    """Yield a temporary folder beside `target`; rename it to `target` on success, remove it on any error.

    A folder that stands at `target` is replaced.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent))
    temporary.chmod(0o755)
    try:
        yield temporary
        if target.exists():
            old = temporary.with_name(temporary.name + ".old")
            target.rename(old)
            temporary.rename(target)
            shutil.rmtree(old)
        else:
            temporary.rename(target)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def check_regular(path: Path, what: str) -> None:
    """Raise InputError unless `path` is a regular file (a pipe or a device would be waited for); `what` is wanted."""
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError) as error:
        if isinstance(error, PermissionError):
            raise InputError(f"{path}: may not be read; {what} is wanted") from error
        raise InputError(f"{path}: no such file; {what} is wanted") from error
    if stat.S_ISDIR(mode):
        raise InputError(f"{path}: is a folder; {what} is wanted")
    if not stat.S_ISREG(mode):
        raise InputError(f"{path}: is a pipe or a device, no regular file; {what} is wanted")
