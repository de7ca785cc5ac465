"""Files of data, told from what is none: empty files, pointers of Git LFS, more than fits into memory."""

from __future__ import annotations

from pathlib import Path

from render.errors import InputError
from render.files.atomic import check_regular
from render.memory import available_bytes

_LFS = b"version https://git-lfs"


def check_data_file(path: Path, wanted: str, *, whole: bool = True) -> None:
    """Raise InputError where there is no such file, an empty or too large one, or a Git LFS pointer in its place.

    Args:
        whole: it is read at once, and must fit into the memory that is free.
    """
    check_regular(path, wanted)
    size, free = path.stat().st_size, available_bytes()
    if whole and free is not None and size > free:
        raise InputError(f"{path}: {size / 2**30:.1f} GiB, and {free / 2**30:.1f} GiB of memory are free")
    with path.open("rb") as file:
        start = file.read(len(_LFS))
    if not start:
        raise InputError(f"{path}: the file is empty; {wanted} is wanted")
    if start == _LFS:
        raise InputError(f"{path}: a pointer of Git LFS, not the data; run `git lfs pull` in its repository")
