"""One method on one garment: fitted, its predictions written, measured; a task that any process can do."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import torch

from fusion import FusionConfig
from imgtransfer.benchmark.config import BenchmarkData, parsed
from imgtransfer.data.clip import Clip
from imgtransfer.data.reader import LoadedReader
from imgtransfer.data.source import clip_refs
from imgtransfer.deformers.base import Deformer
from imgtransfer.deformers.checkpoint import load_deformer
from imgtransfer.deformers.fit import clips_fingerprint, fit_run
from imgtransfer.deformers.image_transfer.method import ImageTransfer
from imgtransfer.deformers.predict import save_deformation
from imgtransfer.evaluation.config import EvaluateConfig
from imgtransfer.evaluation.metrics import evaluate_clip, mean_over_frames
from imgtransfer.pipeline.folder import FUSED_FILE, METHODS, POSITION_ONLY_FILE, folder_of_clip
from imgtransfer.pipeline.fuse import FuseOptions
from imgtransfer.pipeline.fuse_task import FuseTask, fuse_clip
from imgtransfer.pipeline.predict import save_prediction
from imgtransfer.pipeline.predictions import predicted_vertices
from imgtransfer.running.fingerprint import fingerprint
from imgtransfer.training.checkpoint import MODEL_FILE
from imgtransfer.training.checkpoint import fingerprint as model_fingerprint
from imgtransfer.training.run_folder import CONFIG_FILE
from render import InputError
from render.files.atomic import written_whole

MethodVariants = dict[str, dict[str, dict[str, float]]]  # by variant, metrics by clip
RUN, PREDICTIONS, RESULT_FILE, TIME_FILE = "run", "predictions", "result.json", "time.json"


@dataclass(frozen=True, kw_only=True)
class MethodTask:
    """A method and the clips that it is fitted to and measured on.

    Args:
        label: what the method is called.
        data: the clips.
        content: of the fit's configuration (`run_content`); None for clips that are predicted already.
        folder: for the run, the predictions and the result; of clips that are predicted, where they lie.
        fuse: whether to refine the vertices by the fusion as well.
        evaluate: what the metrics are measured with.
        threads: of the predictions.
    """

    label: str
    data: BenchmarkData
    content: dict[str, Any] | None
    folder: Path
    fuse: bool = True
    evaluate: EvaluateConfig = field(default_factory=EvaluateConfig)
    threads: int = 1

    @property
    def name(self) -> str:
        """Of garment and method."""
        return f"{self.data.name}: {self.label}"


@dataclass(frozen=True, kw_only=True)
class MethodResult:
    """What came of a method on one garment.

    Args:
        data, label: of the task.
        variants: by variant ("position_only" before the fusion, "fused"), metrics by clip.
        overall: by variant, their mean over frames.
        frames: of each clip.
        parameters: how many numbers were fitted; None where that is not known.
        fit_seconds: that fitting took, over all its sessions; None where that is not known.
        ms: milliseconds a frame by stage: predict, maps, fuse.
    """

    data: str
    label: str
    variants: MethodVariants
    overall: dict[str, dict[str, float]]
    frames: dict[str, int]
    parameters: int | None = None
    fit_seconds: float | None = None
    ms: dict[str, float] = field(default_factory=dict)

    def line(self) -> str:
        """One line about it."""
        best = {name: f"{values['rmse_mm']:.2f} mm" for name, values in self.overall.items()}
        return f"{self.data}: {self.label}  " + ", ".join(f"{name} {text}" for name, text in best.items())


def measure(task: MethodTask) -> MethodResult:
    """Fit the method unless that is done, predict the test clips, and measure them.

    A result that stands already, of the same model and clips, is only read.

    Raises:
        InputError: what fitting, predicting or measuring refuses.
        KeyboardInterrupt: after Ctrl-C or SIGTERM, once what is done is saved.
    """
    torch.set_num_threads(task.threads)
    choice = task.data.test
    refs = clip_refs(task.data.source, split=choice.split, names=choice.names, exclude=choice.exclude)
    clips = [ref.load() for ref in refs]
    for clip in clips:
        if clip.garment is None:
            raise InputError(
                f"{clip.name}: has no garment_vertices, and a clip to measure on needs the truth"
            )
    if task.content is None:
        _check_given(task, clips)
        return _measured(task, clips)
    run = task.folder / RUN
    seconds = _fit(task, run)
    made = fingerprint(
        [
            model_fingerprint(run),
            clips_fingerprint(clips),
            json.dumps(task.evaluate.model_dump()),
            str(task.fuse),
        ]
    )
    if (standing := standing_result(task.folder / RESULT_FILE, made)) is not None:
        return standing
    deformer, spent = load_deformer(run), dict.fromkeys(("predict", "maps", "fuse"), 0.0)
    for clip in clips:
        for stage, value in _predict(task, deformer, clip).items():
            spent[stage] += value
    total = sum(clip.n_frames for clip in clips)
    result = replace(
        _measured(task, clips),
        parameters=deformer.parameters(),
        fit_seconds=seconds,
        ms={stage: 1e3 * value / total for stage, value in spent.items() if value},
    )
    write_result(task.folder / RESULT_FILE, made, result)
    return result


def _fit(task: MethodTask, run: Path) -> float:
    """Fit, or go on with it; seconds that it has taken in all sessions."""
    assert task.content is not None
    config = parsed(task.content, task.name)
    with _timed(task.folder / TIME_FILE, running=not (run / MODEL_FILE).exists()) as seconds:
        fit_run(config, run, resume=(run / CONFIG_FILE).exists())
    return seconds()


@contextmanager
def _timed(path: Path, *, running: bool) -> Iterator[Callable[[], float]]:
    """Add the time of the block to what the file has, whether it ends or is stopped; yields what gives the sum."""
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        before = float(json.loads(path.read_text())["fit_seconds"]) if path.exists() else 0.0
    except (ValueError, KeyError, TypeError):
        before = 0.0
    started, total = time.perf_counter(), [before]
    try:
        yield lambda: total[0]
    finally:
        if running:
            total[0] += time.perf_counter() - started
            with written_whole(path) as temporary:
                temporary.write_text(json.dumps({"fit_seconds": round(total[0], 2)}))


def _predict(task: MethodTask, deformer: Deformer, clip: Clip) -> dict[str, float]:
    """Write a clip's prediction and its fusion; seconds by stage."""
    folder = task.folder / PREDICTIONS / folder_of_clip(clip.name)
    asked = replace(clip, garment=None)
    if isinstance(deformer, ImageTransfer):
        started = time.perf_counter()
        save_prediction(folder, deformer.model, LoadedReader(asked), record={})
        spent = {"predict": time.perf_counter() - started}
    else:
        spent = save_deformation(folder, deformer, asked, maps=task.fuse, record={})
    if task.fuse or isinstance(deformer, ImageTransfer):
        spent["fuse"] = fuse_clip(FuseTask(folder=folder, options=FuseOptions(config=FusionConfig()))).seconds
    return spent


def predicted_files(task: MethodTask, name: str) -> dict[str, Path]:
    """By variant, the file of a clip that a finished task has predicted."""
    stem = folder_of_clip(name)
    if task.content is not None:
        return _variants(task.folder / PREDICTIONS / stem)
    single = task.folder / f"{stem}.npz"
    return {"position_only": single} if single.is_file() else _variants(task.folder / stem)


def _variants(folder: Path) -> dict[str, Path]:
    files = {"position_only": folder / POSITION_ONLY_FILE, "fused": folder / FUSED_FILE}
    return {variant: file for variant, file in files.items() if file.is_file()}


def _check_given(task: MethodTask, clips: list[Clip]) -> None:
    """Raise InputError where another program's predictions lack a clip: FOLDER/CLIP/fused.npz, or FOLDER/CLIP.npz."""
    if not task.folder.is_dir():
        raise InputError(f"{task.folder}: no such folder; predicted clips of {task.label} are wanted")
    lacking = [clip.name for clip in clips if not predicted_files(task, clip.name)]
    if lacking:
        raise InputError(
            f"{task.folder}: no prediction of {lacking[0]}; wanted is {folder_of_clip(lacking[0])}.npz, or a folder of "
            f"that name with {' or '.join(f'{method}.npz' for method in METHODS)}"
        )


def _measured(task: MethodTask, clips: list[Clip]) -> MethodResult:
    variants: MethodVariants = {}
    frames = {clip.name: clip.n_frames for clip in clips}
    for clip in clips:
        assert clip.garment is not None
        for variant, file in predicted_files(task, clip.name).items():
            try:
                values = evaluate_clip(
                    predicted_vertices(file),
                    clip.garment.vertices,
                    clip.template.faces,
                    clip.body.vertices,
                    clip.body.faces,
                    config=task.evaluate,
                )
            except InputError as error:
                named = str(error).startswith(str(file))
                raise InputError(error if named else f"{file}: {error}") from error
            variants.setdefault(variant, {})[clip.name] = values
    whole = {variant: values for variant, values in variants.items() if len(values) == len(clips)}
    overall = {
        variant: mean_over_frames((values, frames[name]) for name, values in of_clips.items())
        for variant, of_clips in whole.items()
    }
    return MethodResult(data=task.data.name, label=task.label, variants=whole, overall=overall, frames=frames)


def write_result(path: Path, made: str, result: MethodResult) -> None:
    """Write a result with the fingerprint of what it was made from."""
    with written_whole(path) as temporary:
        temporary.write_text(json.dumps({"made": made, "result": asdict(result)}, indent=1))


def standing_result(path: Path, made: str) -> MethodResult | None:
    """The result in a file, where it is whole and has this fingerprint."""
    try:
        stored = json.loads(path.read_text())
        return MethodResult(**stored["result"]) if stored["made"] == made else None
    except (OSError, ValueError, KeyError, TypeError):
        return None
