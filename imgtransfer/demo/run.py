"""What `scripts/demo` does: the whole method on the sample data.

The shipped checkpoint's results come first, within a minute; then a training of the user's own completes them.
"""

from __future__ import annotations

import json
import logging
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from tqdm import tqdm

from imgtransfer.data.source import open_clips
from imgtransfer.demo import pictures as demo_pictures
from imgtransfer.demo.case import METHODS, PRETRAINED, TRAINED, Case, Metrics, measured
from imgtransfer.demo.training import Length, trained
from imgtransfer.evaluation.skinning import lbs_baseline
from imgtransfer.exports import animated_glb
from imgtransfer.network import TransferModel
from imgtransfer.pipeline.deform import deform
from imgtransfer.pipeline.folder import folder_of_clip
from imgtransfer.report.html import Section, write_report
from imgtransfer.training.checkpoint import load_model
from imgtransfer.training.config import RunConfig
from imgtransfer.training.log import LOG_FILE
from render import write_png
from render.files.atomic import written_whole
from render.threads import one_blas_thread

_log = logging.getLogger(__name__)

PROJECT = Path(__file__).resolve().parents[2]
SAMPLE_DATA = {
    garment: PROJECT / "configs" / "sample_data" / f"{garment}.zarr.zip"
    for garment in ("tshirt", "dress", "trousers", "skirt")
}
DEMO_CONFIG = PROJECT / "configs" / "demo.yaml"
CHECKPOINT = PROJECT / "configs" / "pretrained" / "model.safetensors"  # of the T-shirt alone
GENERAL = PROJECT / "configs" / "general" / "model.safetensors"  # of any garment


@one_blas_thread()
def run_demo(out: Path, config: RunConfig, pretrained: Path, length: Length | None = None) -> Metrics:
    """Predict, fuse, measure and report with a checkpoint; then train, and complete the report with that model.

    Args:
        out: folder for everything; a training that was stopped there goes on, a finished one is used again.
        config: of the training; its data source also gives the test clips.
        pretrained: a checkpoint for the same garment, or for any.
        length: of the training, in place of the configuration's.

    Returns:
        The metrics by method (`METHODS`), means over the frames of the test clips.

    Raises:
        InputError: data or checkpoint missing or unfit.
    """
    cases = [Case(clip) for source in config.data.sources for clip in open_clips(source, split="test")]
    longer = load_model(pretrained)
    for case in cases:
        longer.check_garment(case.truth)
    out.mkdir(parents=True, exist_ok=True)
    for case in cases:
        case.vertices["lbs"] = lbs_baseline(case.truth)
    _deform(cases, longer, PRETRAINED)
    for case in cases:
        case.vertices["fused_pretrained"] = case.maps[PRETRAINED].fused
    _log.info("\nFirst results: %s", _report(out, cases, finished=False)[1])
    with _step("Training from scratch"):
        model = load_model(trained(out, config, length or Length()))
    _deform(cases, model, TRAINED)
    for case in cases:
        case.vertices["position_only"] = case.maps[TRAINED].position_only
        case.vertices["fused"] = case.maps[TRAINED].fused
    return _report(out, cases, finished=True)[0]


def _deform(cases: Sequence[Case], model: TransferModel, name: str) -> None:
    with _step(f"Deforming the test clips, model {name}"):
        frames = sum(case.truth.n_frames for case in cases)
        with tqdm(total=frames, desc="fuse", unit="frame", file=sys.stderr) as bar:
            for case in cases:
                case.maps[name] = deform(model, case.truth, progress=bar.update)


def _report(out: Path, cases: Sequence[Case], *, finished: bool) -> tuple[Metrics, Path]:
    """Measure and draw what there is; the metrics and the page."""
    with _step("Measuring and drawing"):
        by_clip, overall = measured(cases)
        for name, content in (("metrics", overall), ("metrics_by_clip", by_clip)):
            with written_whole(out / f"{name}.json") as temporary:
                temporary.write_text(json.dumps(content, indent=2) + "\n")
        return overall, _page(out, cases, overall, finished)


def _page(out: Path, cases: Sequence[Case], overall: Metrics, finished: bool) -> Path:
    overview = demo_pictures.overview(cases)
    models = [name for name in (TRAINED, PRETRAINED) if name in cases[0].maps]
    maps = [demo_pictures.maps(case, model) for case in cases for model in models]
    meshes = [demo_pictures.meshes(case) for case in cases]
    curves = demo_pictures.curves(out / "run" / LOG_FILE) if finished else []
    named = {"overview": [overview], "maps": maps, "meshes": meshes, "training": curves}
    for name, pictures in named.items():
        for number, picture in enumerate(pictures, start=1):
            write_png(out / f"{name}{'' if len(pictures) == 1 else f'_{number}'}.png", picture.image)
    for case in cases:
        stem = folder_of_clip(case.truth.name)
        animated_glb(out / f"{stem}.glb", case.truth.with_garment(case.vertices["fused_pretrained"]))
    compared = "\n\n".join(f"{method}: {METHODS[method]}." for method in cases[0].methods)
    training = "Loss of both networks, and errors on the validation clips."
    if not finished:
        training = "The model of your own is being trained; this page is completed when it is done."
    sections = [
        Section("The method in one frame", "", [overview]),
        Section("What is compared", compared),
        Section("Meshes and their errors", "Distance of each vertex to the simulated garment.", meshes),
        Section("Maps", "True maps, predicted maps, and the distance between them.", maps),
        Section("Training", training, curves),
    ]
    return write_report(out, "imgtransfer: a garment deformed without skinning", overall, sections)


@contextmanager
def _step(title: str) -> Iterator[None]:
    _log.info("\n%s ...", title)
    started = time.monotonic()
    yield
    _log.info("%s: %.0f s", title, time.monotonic() - started)
