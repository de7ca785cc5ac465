"""Where clips come from: a data set, one clip npz, or a folder of clip npz files."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatch
from pathlib import Path

from imgtransfer.data.clip import Clip, load_clip
from imgtransfer.data.store import DataSet
from render import InputError


def open_clips(
    source: str | Path,
    *,
    split: str | None = None,
    names: Sequence[str] | None = None,
    exclude: Sequence[str] = (),
) -> list[Clip]:
    """Read the clips of `source` that are asked for, sorted by name.

    Args:
        source: a data set folder, a clip npz, or a folder of clip npz files (named by their files).
        split: only clips of this split; clip npz files have none.
        names: glob patterns of the clips to take; None takes all.
        exclude: glob patterns of clips to leave out.

    Raises:
        InputError: no such source, nothing in it that matches (the message lists what there is), a bad clip.
    """
    source = Path(source)
    if not source.exists():
        raise InputError(f"{source}: no such file or folder; a data set or clip npz files are wanted")
    if (source / "zarr.json").is_file():
        data = DataSet.open(source)
        return [
            data.read(name)
            for name in _choose(source, data.names(), data.names(split), names, exclude, split)
        ]
    if split is not None:
        raise InputError(f"{source}: only data sets have splits, no {split!r} here; choose clips by name")
    files = {path.stem: path for path in (sorted(source.glob("*.npz")) if source.is_dir() else [source])}
    if not files:
        raise InputError(f"{source}: neither a data set (no zarr.json) nor a folder with clip npz files")
    return [
        load_clip(files[name]) for name in _choose(source, list(files), list(files), names, exclude, None)
    ]


def _choose(  # noqa: PLR0917
    source: Path,
    present: list[str],
    candidates: list[str],
    names: Sequence[str] | None,
    exclude: Sequence[str],
    split: str | None,
) -> list[str]:
    chosen = [
        name
        for name in candidates
        if (names is None or any(fnmatch(name, pattern) for pattern in names))
        and not any(fnmatch(name, pattern) for pattern in exclude)
    ]
    if not chosen:
        asked = [f"split {split}"] if split else []
        asked += [f"names {', '.join(names)}"] if names is not None else []
        asked += [f"without {', '.join(exclude)}"] if exclude else []
        raise InputError(
            f"{source}: no clip matches ({'; '.join(asked) or 'all'}); "
            f"it has {', '.join(present) or 'no clips'}"
        )
    return chosen
