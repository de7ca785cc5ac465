"""A clip's garment by any fitted method, in the folder that `predict` writes and `fuse` and `evaluate` read."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import torch

from imgtransfer.data.canonical import root_frames
from imgtransfer.data.clip import Clip, written_clip
from imgtransfer.data.source import ClipRef
from imgtransfer.deformers.base import Deformer
from imgtransfer.deformers.checkpoint import load_deformer
from imgtransfer.deformers.fit import clips_fingerprint
from imgtransfer.pipeline.folder import MAPS_FILE, POSITION_ONLY_FILE
from imgtransfer.pipeline.standing import clip_stands
from imgtransfer.running.fingerprint import MADE, fingerprint, made_anew
from render import MapFile, Option, PositionBox, TemplateImager, written_maps
from render.files.atomic import written_whole_folder

VIEWS, SIZE = ("front", "back"), (128, 128)  # of the maps that the fusion refines
_TOGETHER = 16  # frames whose maps are made together


@dataclass(frozen=True)
class DeformTask:
    """One clip to predict by a fitted method.

    Args:
        model: its file or a run's folder. mark: the file's `fingerprint`.
        clip: with the body.
        folder: for the results; appears whole or not at all.
        maps: whether to render the vertices to maps as well, for the fusion.
        overwrite: whether to predict again what this method has predicted already.
    """

    model: Path
    mark: str
    clip: ClipRef
    folder: Path
    maps: bool = False
    overwrite: bool = False

    @property
    def name(self) -> str:
        """The clip's name."""
        return self.clip.name


def deform_clip(task: DeformTask) -> str:
    """Predict a clip and write it; returns a line about it.

    Raises:
        InputError: a file or clip that cannot be read, or that do not fit each other.
    """
    clip = replace(task.clip.load(), garment=None)
    made = fingerprint([task.mark, clips_fingerprint([clip])])
    whole = (task.folder / MAPS_FILE).is_file() or not task.maps
    if whole and not task.overwrite and clip_stands(task.folder / POSITION_ONLY_FILE, made):
        return f"{task.folder}  predicted by this model already; {Option('overwrite', True)} does it again"
    record = {"model": task.mark, MADE: made}
    spent = save_deformation(
        task.folder, _deformer(task.model, task.mark), clip, maps=task.maps, record=record
    )
    return f"{task.folder}  {clip.n_frames} frames, {1e3 * spent['predict'] / clip.n_frames:.1f} ms each"


def save_deformation(
    folder: Path, deformer: Deformer, clip: Clip, *, maps: bool, record: Mapping[str, str]
) -> dict[str, float]:
    """Predict a clip and write its garment, and maps of it if they are wanted.

    Args:
        folder: appears whole or not at all, in place of an earlier one.
        deformer: predicts. clip: with the body.
        maps: whether to render the vertices to maps as well, for the fusion.
        record: what the vertices' clip keeps in its `info` of what it was made from.

    Returns:
        Seconds by stage: "predict", and "maps" if they were made.

    Raises:
        InputError: a clip that the method cannot predict.
    """
    started = time.perf_counter()
    made = clip.with_garment(deformer.predict(clip))
    spent = {"predict": time.perf_counter() - started}
    with written_whole_folder(folder) as temporary:
        if maps:
            started = time.perf_counter()
            write_maps(temporary / MAPS_FILE, made, contact_offset_m=deformer.contact_offset_m)
            spent["maps"] = time.perf_counter() - started
        with written_clip(temporary / POSITION_ONLY_FILE) as add:
            add(replace(made, info=made_anew(clip.info) | dict(record)))
    return spent


def write_maps(path: Path, clip: Clip, *, contact_offset_m: float | None = None) -> None:
    """Render a clip's garment to position and normal maps in canonical frames.

    Args:
        path: the file.
        clip: with a garment in motion.
        contact_offset_m: metres off the skin at which its cloth is known to rest.
    """
    assert clip.garment is not None
    imager = TemplateImager.build(clip.template_mesh, views=VIEWS, size=SIZE)
    frames = root_frames(clip, "root")
    canonical = frames.to_canonical(clip.garment.vertices)
    box = PositionBox.around(canonical)
    with written_maps(path) as add:
        for first in range(0, clip.n_frames, _TOGETHER):
            part = slice(first, first + _TOGETHER)
            position, normal = imager.maps(torch.from_numpy(canonical[part]), box)
            of = frames.part(part)
            add(
                MapFile.of(
                    imager,
                    position=position.numpy(),
                    normal=normal.numpy(),
                    box=box,
                    rotation=of.rotation,
                    translation=of.translation,
                    fps=clip.fps,
                    contact_offset_m=contact_offset_m,
                )
            )


@lru_cache(maxsize=1)
def _deformer(path: Path, mark: str) -> Deformer:
    """The method, read once a process; `mark` tells it from an earlier one at the same path."""
    return load_deformer(path)
