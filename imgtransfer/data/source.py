"""Where clips come from: a data set, one clip npz, or a folder of clip npz files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from imgtransfer.data.choice import choose
from imgtransfer.data.clip import Clip
from imgtransfer.data.local_place import LocalPlace
from imgtransfer.data.location import place_at
from imgtransfer.data.place import METADATA
from imgtransfer.data.reader import NpzReader, Reader
from imgtransfer.data.store import DataSet
from render import InputError


@dataclass(frozen=True)
class ClipRef:
    """A clip that has not been read yet: small, and good in another process.

    Args:
        source: the data set (path or URL) or the clip npz.
        name: the clip's name. split: its split; None for a clip npz.
    """

    source: str | Path
    name: str
    split: str | None = None

    def reader(self) -> Reader:
        """The clip, for reading some of its frames."""
        if self.split is None:
            return NpzReader(Path(self.source))
        return DataSet.open(self.source).reader(self.name)

    def load(self) -> Clip:
        """The whole clip.

        Raises:
            InputError: it is missing or damaged.
        """
        return self.reader().clip()

    def still(self) -> Clip:
        """The clip with its first frame only: meshes and skinning, whatever the clip's length."""
        return self.reader().clip(0, 1)


def clip_refs(
    source: str | Path,
    *,
    split: str | None = None,
    names: Sequence[str] | None = None,
    exclude: Sequence[str] = (),
) -> list[ClipRef]:
    """The clips of `source` that are asked for, sorted by name, not read yet.

    Args:
        source: a data set (folder, zip file or URL), a clip npz, or a folder of clip npz files (named by their files).
        split: only clips of this split; clip npz files have none.
        names: glob patterns of the clips to take; None takes all.
        exclude: glob patterns of clips to leave out.

    Raises:
        InputError: no such source, or nothing in it that matches (the message lists what there is).
    """
    place = place_at(source)
    if not isinstance(place, LocalPlace) or place.exists(METADATA):
        data = DataSet.open(source)
        splits = data.splits()
        of_split = [name for name, of in splits.items() if split in (None, of)]
        asked = f"split {split}" if split else ""
        chosen = choose(source, of_split, names=names, exclude=exclude, asked=asked, present=list(splits))
        return [ClipRef(source, name, splits[name]) for name in chosen]
    folder = Path(source)
    if not folder.exists():
        raise InputError(f"{source}: no such file or folder; a data set or clip npz files are wanted")
    if split is not None:
        raise InputError(f"{source}: only data sets have splits, no {split!r} here; choose clips by name")
    files = {path.stem: path for path in (sorted(folder.glob("*.npz")) if folder.is_dir() else [folder])}
    if not files:
        raise InputError(f"{source}: neither a data set (no {METADATA}) nor a folder with clip npz files")
    return [ClipRef(files[name], name) for name in choose(source, list(files), names=names, exclude=exclude)]


def open_clips(
    source: str | Path,
    *,
    split: str | None = None,
    names: Sequence[str] | None = None,
    exclude: Sequence[str] = (),
) -> list[Clip]:
    """Read the clips of `source` that are asked for, whole; see `clip_refs`.

    Raises:
        InputError: no such source, nothing in it that matches, or a bad clip.
    """
    return [ref.load() for ref in clip_refs(source, split=split, names=names, exclude=exclude)]
