"""What there is to look at: clips of data sets, clip npz files and folders of predictions, by clip, not read yet."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from imgtransfer.data.choice import choose
from imgtransfer.data.location import as_url
from imgtransfer.data.reader import NpzReader, Reader
from imgtransfer.data.source import ClipRef, clip_refs
from imgtransfer.pipeline.folder import MAPS_FILE, METHODS, clip_of_folder, folders_in


@dataclass(frozen=True)
class Showing:
    """A garment in motion that may be looked at.

    Args:
        clip: the clip's name, which what is shown side by side has in common.
        title: what the page calls it.
        method: of `pipeline.folder.METHODS` where it was predicted; None for a clip's own garment.
        ref: of the clip in a data set, or of the clip npz.
        maps: the map file that its vertices were made from; None where there is none.
    """

    clip: str
    title: str
    method: str | None
    ref: ClipRef
    maps: Path | None = None

    def reader(self) -> Reader:
        """Its frames."""
        return NpzReader(Path(self.ref.source)) if self.method else self.ref.reader()


def open_sources(
    sources: Sequence[str | Path], names: Sequence[str] | None = None
) -> dict[str, tuple[Showing, ...]]:
    """What there is to look at of each clip, in the order of the sources; clips in the order in which they come first.

    Args:
        sources: data sets (folder, zip file or URL), clip npz files, folders of these, and folders that
            `imgtransfer predict` wrote, or one clip's in them.
        names: glob patterns of the clips to take; None takes all.

    Raises:
        InputError: no such source, or nothing in one that matches.
    """
    titles = _titles(sources)
    clips: dict[str, list[Showing]] = {}
    for source, title in zip(sources, titles, strict=True):
        for showing in _of_source(source, title, names):
            clips.setdefault(showing.clip, []).append(showing)
    return {name: tuple(showings) for name, showings in clips.items()}


def truth_of(showings: Sequence[Showing]) -> Showing | None:
    """What the others of a clip are measured against: the first that was not predicted."""
    return next((showing for showing in showings if showing.method is None), None)


def _titles(sources: Sequence[str | Path]) -> list[str]:
    """A short name for each source: the last part of its path, or the whole path where two would have the same."""
    short = [str(source).rstrip("/").rsplit("/", 1)[-1] for source in sources]
    return [
        name if short.count(name) == 1 else str(source) for name, source in zip(short, sources, strict=True)
    ]


def _of_source(source: str | Path, title: str, names: Sequence[str] | None) -> Iterator[Showing]:
    folders = _prediction_folders(source)
    if folders:
        clips = {clip_of_folder(folder.resolve().name): folder for folder in folders}
        for name in choose(source, list(clips), names=names):
            yield from _of_folder(clips[name], name, title)
        return
    for ref in clip_refs(source, names=names):
        yield Showing(ref.name, title, None, ref)


def _prediction_folders(source: str | Path) -> list[Path]:
    """The clips' folders in what `imgtransfer predict` wrote; none where a source is something else."""
    if as_url(source) is not None or not Path(source).is_dir():
        return []
    return [folder for folder in folders_in(Path(source)) if any(_files(folder))]


def _files(folder: Path) -> Iterator[tuple[str, Path]]:
    """The vertices that were predicted for a clip, by their method, the better first."""
    files = ((method, folder / f"{method}.npz") for method in METHODS)
    return ((method, file) for method, file in files if file.is_file())


def _of_folder(folder: Path, clip: str, title: str) -> Iterator[Showing]:
    maps = folder / MAPS_FILE
    showing = Showing(clip, title, None, ClipRef(folder, clip), maps if maps.exists() else None)
    for method, file in _files(folder):
        words = method.replace("_", " ")
        yield replace(showing, title=f"{title}, {words}", method=method, ref=ClipRef(file, clip))
