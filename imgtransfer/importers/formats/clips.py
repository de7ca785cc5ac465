"""Clip npz files (docs/data.md), folders of them, and other data sets."""

from __future__ import annotations

import re
from pathlib import Path

from imgtransfer.data.source import clip_refs
from imgtransfer.importers.job import ImportOptions, Job
from render import InputError, Option


def jobs(paths: list[Path], options: ImportOptions) -> list[Job]:
    """One job a clip. Every npz is read once here, so that a bad one stops the import before anything is written.

    tshirt_walk.npz becomes tshirt/walk; with `options.garment`, <garment>/tshirt_walk. Clips of a data set keep their
    names and splits.

    Raises:
        InputError: no such file, a bad clip, or no split given for npz files.
    """
    import_jobs = []
    for path in paths:
        for ref in clip_refs(path):
            split = options.split or ref.split
            if not split:
                raise InputError(
                    f"{path}: npz files have no split, each clip needs a split: add {Option('split')} train or test"
                )
            if ref.split is None:
                ref.load()
            in_folder = ref.split is None and path.is_dir()
            files = tuple(sorted(path.glob(f"{ref.name}.npz"))) if in_folder else (path,)
            import_jobs.append(Job(_name(ref.name, options.garment), split, files, ref.load, marked=False))
    return import_jobs


def _name(name: str, garment: str | None) -> str:
    """The clip's name in the data set, "<garment>/<clip>"."""
    stem = re.sub(r"[^\w./-]+", "-", name)
    if garment is not None:
        return f"{garment}/{stem.rpartition('/')[2]}"
    split_up = stem.replace("__", "/").partition("/") if "__" in stem or "/" in stem else stem.partition("_")
    own, _, motion = split_up
    return f"{own}/{motion or own}"
