"""Clips into predicted maps on disk, each as a task of its own: what stands behind `imgtransfer predict`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
from tqdm import tqdm

from fusion.initialise import InitialWeights
from fusion.parallel import in_order, n_threads
from imgtransfer.data.clip import Clip, written_clip
from imgtransfer.data.reader import Reader
from imgtransfer.data.source import ClipRef
from imgtransfer.network.model import FRAMES_AT_ONCE, Predictor, TransferModel
from imgtransfer.network.prediction import Prediction, ShownFrames
from imgtransfer.pipeline.folder import MAPS_FILE, POSITION_ONLY_FILE
from imgtransfer.pipeline.standing import clip_stands
from imgtransfer.running import in_worker
from imgtransfer.running.fingerprint import MADE, fingerprint, made_anew
from imgtransfer.simulation.hang import hanging_template
from imgtransfer.training.checkpoint import load_model
from render import MapFile, Mesh, Option, written_maps
from render.files.atomic import written_whole_folder

#: The maps of a batch, and its clip with the vertices that are read from them.
Predicted = tuple[MapFile, Clip]

_BATCHES_AT_ONCE = 4  # at most: each takes memory of its own, and torch divides a batch among further threads
_TOGETHER = 32  # frames whose fingerprint is taken together; another number would give another fingerprint
# The arrays of a clip that a prediction follows from: of every clip once, and of every frame.
_STILL, _MOVING = ("template_vertices", "body_rest", "body_faces"), ("body_vertices", "poses", "trans")


@dataclass(frozen=True)
class PredictTask:
    """One clip to predict.

    Args:
        model: its file or a run's folder. mark: the model's `fingerprint`.
        clip: with the body.
        folder: for the results; appears whole or not at all.
        overwrite: whether to predict again what this model has predicted already.
        mirrored_average: whether a model that averages with the mirrored prediction may do so.
        settle: whether the template is let hang on the resting body first, by simulation. pinned: its topmost opening
            is then a waistband, which stays on the skin. anyway: it is taken although it slips off or is stretched.
    """

    model: Path
    mark: str
    clip: ClipRef
    folder: Path
    overwrite: bool = False
    mirrored_average: bool = True
    settle: bool = False
    pinned: bool = False
    anyway: bool = False

    @property
    def name(self) -> str:
        """The clip's name."""
        return self.clip.name


def predict_clip(task: PredictTask) -> str:
    """Predict a clip and write it; returns a line about it.

    Raises:
        InputError: a model or clip that cannot be read, or that do not fit each other.
    """
    reader = task.clip.reader()
    made = _fingerprint(reader, _mark(task))
    whole = (task.folder / MAPS_FILE).is_file()
    if whole and not task.overwrite and clip_stands(task.folder / POSITION_ONLY_FILE, made):
        return f"{task.folder}  predicted by this model already; {Option('overwrite', True)} does it again"
    hidden = True if in_worker() else None
    batches = -(-reader.n_frames // FRAMES_AT_ONCE)
    bar = partial(tqdm, total=batches, desc=reader.name, unit="batch", leave=False, disable=hidden)
    record = {"model": task.mark, MADE: made}
    model = _model(task.model, task.mark, task.mirrored_average)
    hangs = None
    if task.settle:
        hangs = hanging_template(reader.clip(0, 1), pinned=task.pinned, anyway=task.anyway)
    save_prediction(task.folder, model, reader, record=record, hangs=hangs, progress=bar)
    return f"{task.folder}  {reader.n_frames} frames"


def save_prediction(
    folder: Path,
    model: TransferModel,
    reader: Reader,
    *,
    record: Mapping[str, str],
    hangs: np.ndarray | None = None,
    progress: Callable[[Iterable[Predicted]], Iterable[Predicted]] = iter,
) -> None:
    """Predict a clip some frames at a time, and write the maps, and the vertices that the position maps alone give.

    Several batches are predicted at once, and written in their order while the next are predicted.

    Args:
        folder: appears whole or not at all, in place of an earlier one. What was fused from an earlier prediction
            goes with that.
        model: predicts.
        reader: of the clip, with the body; the vertices are written as this clip's garment, world frame.
        record: what the vertices' clip keeps in its `info` of what it was made from.
        hangs: see `imgtransfer.network.shapes.as_it_hangs`.
        progress: wraps the iteration over the batches, such as tqdm.

    Raises:
        InputError: a clip that cannot be read, or does not fit the model.
    """
    predictor = model.predictor(reader.clip(0, 1), hangs=hangs)
    weights = InitialWeights(predictor.imager, _shape(predictor))

    def predicted(part: tuple[Clip, ShownFrames]) -> Predicted:
        clip, shown = part
        prediction = predictor.predicted(shown)
        vertices = weights(prediction.imager.sample(prediction.metres())).numpy()
        garment = clip.with_garment(prediction.frames.to_world(vertices))
        return maps_of(prediction), replace(garment, info=made_anew(clip.info) | dict(record))

    batches = -(-reader.n_frames // FRAMES_AT_ONCE)
    threads = 1 if model.device.type != "cpu" else max(1, min(n_threads(), batches, _BATCHES_AT_ONCE))
    parts = ((clip, predictor.shown(clip)) for clip in reader.parts(FRAMES_AT_ONCE))
    done = in_order(predicted, parts, threads=threads, torch_threads=n_threads() // threads)
    with (
        written_whole_folder(folder) as temporary,
        written_maps(temporary / MAPS_FILE) as add_maps,
        written_clip(temporary / POSITION_ONLY_FILE) as add_clip,
    ):
        for maps, clip in progress(done):
            add_maps(maps)
            add_clip(clip)


def _mark(task: PredictTask) -> str:
    """What decides the prediction beside the clip."""
    said = [task.mark]
    if not task.mirrored_average:
        said.append("not averaged")
    if task.settle:
        said.append("pinned and settled" if task.pinned else "settled")
    return ", ".join(said)


def _shape(predictor: Predictor) -> Mesh:
    """The garment at rest: the model's template, or the clip's own where that is another shape of it."""
    mesh, own = predictor.imager.mesh, predictor.rest_vertices
    return mesh if own is None else replace(mesh, vertices=own)


def maps_of(prediction: Prediction) -> MapFile:
    """A prediction as its map file has it."""
    return MapFile.of(
        prediction.imager,
        position=prediction.positions.numpy(),
        normal=prediction.normals.numpy(),
        box=prediction.box,
        rotation=prediction.frames.rotation,
        translation=prediction.frames.translation,
        fps=prediction.fps,
        rest_vertices=prediction.rest_vertices,
        contact_offset_m=prediction.contact_offset_m,
    )


@lru_cache(maxsize=1)
def _model(path: Path, mark: str, mirrored_average: bool) -> TransferModel:
    """The model, read once a process; `mark` tells it from an earlier one at the same path."""
    model = load_model(path)
    model.mirrored_average &= mirrored_average
    return model


def _fingerprint(reader: Reader, model: str) -> str:
    """A text that changes with whatever decides a prediction: the model and the clip's arrays, some frames at a time.

    Raises:
        InputError: a clip that cannot be read.
    """

    def parts() -> Iterator[str | memoryview]:
        yield model
        for number, clip in enumerate(reader.parts(_TOGETHER)):
            if number == 0:
                yield repr(clip.fps)
            arrays = clip.arrays()
            for key in (*_STILL, *_MOVING) if number == 0 else _MOVING:
                array = arrays.get(key)
                yield f"{key} {None if array is None else (array.dtype.str, array.shape)}"
                if array is not None:
                    yield np.ascontiguousarray(array).data

    return fingerprint(parts())
