"""Files and folders that appear whole or not at all."""

from __future__ import annotations

import errno
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from render.errors import InputError
from render.files.temporaries import put_in_place, temporary_beside


@contextmanager
def written_whole(target: Path, *, own_folder: bool = False) -> Iterator[Path]:
    """Yield a temporary file beside `target`; rename it to `target` on success, remove it on any error.

    The parent folder is made where it is missing. The temporary file keeps the suffix of `target`, because
    writers choose the format by it. What writers of `target` have left that were killed is removed.

    Args:
        target: the file.
        own_folder: whether the temporary file lies in a temporary folder of its own, so that what a library writes
            beside it on its way is removed with it.

    Raises:
        OSError: it cannot be written; the error names `target`.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    with errors_naming(target), temporary_beside(target, folder=own_folder) as made:
        temporary = made / target.name if own_folder else made
        yield temporary
        temporary.chmod(0o644)  # the 0600 of temporary files would keep it from colleagues
        temporary.replace(target)


@contextmanager
def written_whole_folder(target: Path) -> Iterator[Path]:
    """Yield a temporary folder beside `target`; it becomes `target` on success, and is removed on any error.

    A folder that stands at `target` is replaced: at no moment is there neither of them, whenever the process is killed.
    What writers of `target` have left that were killed is put back or removed.

    Raises:
        OSError: it cannot be written, or `target` is a file; the error names it.
    """
    target = target.resolve() if target.is_symlink() else target
    target.parent.mkdir(parents=True, exist_ok=True)
    with errors_naming(target), temporary_beside(target, folder=True) as temporary:
        temporary.chmod(0o755)
        yield temporary
        put_in_place(temporary, target)


@contextmanager
def errors_naming(target: Path) -> Iterator[None]:
    """An OSError in here that names no file, or a temporary one beside `target`, names `target` or what is to be in it.

    Libraries report a full disk without a name, and users do not know hidden names.
    """
    try:
        yield
    except OSError as error:
        if error.filename is None and error.errno != errno.EPIPE:
            error.filename = str(target)
        elif isinstance(error.filename, str):
            error.filename = _shown(Path(error.filename), target)
        raise


def _shown(path: Path, target: Path) -> str:
    """What a user is told of a path: `target` for its temporaries, the final place for what is in them."""
    if path.is_relative_to(target.parent):
        first, *inner = path.relative_to(target.parent).parts or ("",)
        if first.startswith((f".{target.stem}-", f".{target.name}-")):
            return str(target.joinpath(*inner))
    return str(path)


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
