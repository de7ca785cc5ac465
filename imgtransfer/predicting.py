"""Clips into predicted maps on disk, each as a task of its own: what stands behind `imgtransfer predict`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
from tqdm import tqdm

from fusion import initial_vertices
from imgtransfer.data.clip import Clip, load_clip, save_clip
from imgtransfer.data.source import ClipRef
from imgtransfer.network.model import Prediction, TransferModel
from imgtransfer.predictions import MAPS_FILE, POSITION_ONLY_FILE
from imgtransfer.running import in_worker
from imgtransfer.training.checkpoint import load_model
from render import InputError, MapFile, save_maps
from render.files import written_whole_folder


@dataclass(frozen=True)
class PredictTask:
    """One clip to predict.

    Args:
        model: its file or a run's folder. mark: the model's `fingerprint`.
        clip: with the body.
        folder: for the results; appears whole or not at all.
        overwrite: whether to predict again what this model has predicted already.
    """

    model: Path
    mark: str
    clip: ClipRef
    folder: Path
    overwrite: bool = False

    @property
    def name(self) -> str:
        """The clip's name."""
        return self.clip.name


def predict_clip(task: PredictTask) -> str:
    """Predict a clip and write it; returns a line about it.

    Raises:
        InputError: a model or clip that cannot be read, or that do not fit each other.
    """
    clip = task.clip.load()
    if not task.overwrite and _stands(task.folder, clip, task.mark):
        return f"{task.folder}  predicted by this model already; --overwrite does it again"
    hidden = True if in_worker() else None
    bar = partial(tqdm, desc=clip.name, unit="batch", leave=False, disable=hidden)
    save_prediction(task.folder, _model(task.model, task.mark).predict(clip, bar), clip, model=task.mark)
    return f"{task.folder}  {clip.n_frames} frames"


def save_prediction(folder: Path, prediction: Prediction, clip: Clip, *, model: str) -> None:
    """Write a clip's folder, in place of an earlier one: the maps, and the vertices that the position maps alone give.

    Args:
        folder: appears whole or not at all. What was fused from an earlier prediction goes with that.
        prediction: of the clip.
        clip: with the body; the vertices are written as this clip's garment, world frame.
        model: `fingerprint` of the model, for the record.
    """
    maps = MapFile.of(
        prediction.imager,
        position=prediction.positions.numpy(),
        normal=prediction.normals.numpy(),
        box=prediction.box,
        rotation=prediction.frames.rotation,
        translation=prediction.frames.translation,
        fps=prediction.fps,
        rest_vertices=prediction.rest_vertices,
    )
    vertices = initial_vertices(prediction.imager, prediction.metres()).numpy()
    garment = clip.with_garment(prediction.frames.to_world(vertices))
    with written_whole_folder(folder) as temporary:
        save_maps(temporary / MAPS_FILE, maps)
        save_clip(temporary / POSITION_ONLY_FILE, replace(garment, info=clip.info | {"model": model}))


@lru_cache(maxsize=1)
def _model(path: Path, mark: str) -> TransferModel:
    """The model, read once a process; `mark` tells it from an earlier one at the same path."""
    return load_model(path)


def _stands(folder: Path, clip: Clip, model: str) -> bool:
    """Whether the folder holds this model's prediction for this very clip."""
    if not (folder / MAPS_FILE).is_file():
        return False
    try:
        stored = load_clip(folder / POSITION_ONLY_FILE)
    except InputError:
        return False
    decisive = ("template_vertices", "body_rest", "body_faces", "body_vertices", "poses", "trans", "fps")
    return stored.info.get("model") == model and all(
        np.array_equal(getattr(stored, key), getattr(clip, key)) for key in decisive
    )
