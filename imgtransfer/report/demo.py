"""What `scripts/demo` runs: the whole method on the sample data, from training to the report."""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from tqdm import tqdm

from imgtransfer.cli.main import exit_status
from imgtransfer.data.clip import Clip
from imgtransfer.data.source import open_clips
from imgtransfer.deform import Deformation, deform
from imgtransfer.evaluation.metrics import evaluate_clip, mean_over_frames
from imgtransfer.evaluation.skinning import lbs_baseline
from imgtransfer.evaluation.table import metrics_table
from imgtransfer.report import demo_pictures
from imgtransfer.report.glb import animated_glb
from imgtransfer.report.html import Section, write_report
from imgtransfer.training.checkpoint import load_model
from imgtransfer.training.config import RunConfig, load_config
from imgtransfer.training.loop import CONFIG_FILE, LOG_FILE, train
from render import InputError, write_png
from render.files import written_whole
from render.threads import one_blas_thread

PROJECT = Path(__file__).resolve().parents[2]
SAMPLE_DATA = PROJECT / "configs" / "sample_data" / "tshirt.zarr"
DEMO_CONFIG = PROJECT / "configs" / "demo.yaml"
PRETRAINED = PROJECT / "configs" / "pretrained" / "model.safetensors"
METHODS = {
    "lbs": "the template skinned with the weights of the nearest body vertices",
    "position_only": "vertices read from the position maps of the model that this demo trained",
    "fused": "the same model's position and normal maps, fused",
    "fused_pretrained": "the fusion of the maps of the checkpoint in configs/pretrained, which was trained for longer",
}


@dataclass(frozen=True, eq=False)
class Case:
    """One test clip with what every method makes of it.

    Args:
        truth: the simulated clip.
        vertices: by method, (T, N, 3) float32, metres, world.
        maps: by model ("trained here", "pretrained"), its prediction.
    """

    truth: Clip
    vertices: dict[str, np.ndarray] = field(default_factory=dict)
    maps: dict[str, Deformation] = field(default_factory=dict)

    @property
    def truth_vertices(self) -> np.ndarray:
        """(T, N, 3) the simulated garment; InputError for a clip that has only a body."""
        if self.truth.garment_vertices is None:
            raise InputError(f"{self.truth.name}: has no garment_vertices to compare with")
        return self.truth.garment_vertices

    def error_mm(self, method: str) -> np.ndarray:
        """(T, N) distance of each vertex to the truth, millimetres."""
        return 1e3 * np.linalg.norm(self.vertices[method] - self.truth_vertices, axis=-1)


@one_blas_thread()
def run_demo(out: Path, config: RunConfig, pretrained: Path) -> dict[str, dict[str, float]]:
    """Train, predict, fuse, measure and report.

    Args:
        out: folder for everything; a training that was stopped there goes on, a finished one is used again.
        config: of the training; its data source also gives the test clips.
        pretrained: a checkpoint for the same garment.

    Returns:
        The metrics by method (`METHODS`), means over the frames of the test clips.

    Raises:
        InputError: data or checkpoint missing or unfit.
    """
    cases = [Case(clip) for clip in open_clips(config.data.source, split="test")]
    longer = load_model(pretrained)
    for case in cases:
        longer.check_garment(case.truth)
    with _step(f"Training from scratch for {config.training.steps} steps"):
        trained = load_model(_trained(out / "run", config))
    with _step("Deforming the test clips"):
        frames = sum(case.truth.n_frames for case in cases)
        with tqdm(total=2 * frames, desc="fuse", unit="frame", file=sys.stderr) as bar:
            for case in cases:
                case.vertices["lbs"] = lbs_baseline(case.truth)
                for name, model in (("trained here", trained), ("pretrained", longer)):
                    case.maps[name] = deform(model, case.truth, progress=bar.update)
                case.vertices["position_only"] = case.maps["trained here"].position_only
                case.vertices["fused"] = case.maps["trained here"].fused
                case.vertices["fused_pretrained"] = case.maps["pretrained"].fused
    with _step("Measuring"):
        by_clip, overall = _measured(cases)
        for name, content in (("metrics", overall), ("metrics_by_clip", by_clip)):
            with written_whole(out / f"{name}.json") as temporary:
                temporary.write_text(json.dumps(content, indent=2) + "\n")
    with _step("Drawing"):
        _report(out, cases, overall)
    return overall


def _trained(folder: Path, config: RunConfig) -> Path:
    """The model of a run in `folder`: new, gone on with, or finished before. A run of other settings is replaced."""
    if (folder / CONFIG_FILE).exists() and load_config(folder / CONFIG_FILE) != config:
        print(f"The run in {folder} had other settings; starting a new one", file=sys.stderr)
        shutil.rmtree(folder)
    if folder.exists() and not (folder / "state.safetensors").exists():
        shutil.rmtree(folder)  # stopped before anything was saved
    return train(config, folder, resume=folder.exists())


def _measured(cases: list[Case]) -> tuple[dict[str, dict], dict[str, dict[str, float]]]:
    by_clip: dict[str, dict[str, dict[str, float]]] = {}
    for case in cases:
        clip = case.truth
        by_clip[clip.name] = {
            method: evaluate_clip(
                case.vertices[method],
                case.truth_vertices,
                clip.garment_faces,
                clip.body_vertices,
                clip.body_faces,
            )
            for method in METHODS
        }
    weighted = {m: [(by_clip[case.truth.name][m], case.truth.n_frames) for case in cases] for m in METHODS}
    return by_clip, {method: mean_over_frames(pairs) for method, pairs in weighted.items()}


def _report(out: Path, cases: list[Case], overall: dict[str, dict[str, float]]) -> None:
    overview = demo_pictures.overview(cases)
    maps = [demo_pictures.maps(case, model) for case in cases for model in ("trained here", "pretrained")]
    meshes = [demo_pictures.meshes(case) for case in cases]
    curves = demo_pictures.curves(out / "run" / LOG_FILE)
    named = {"overview": [overview], "maps": maps, "meshes": meshes, "training": curves}
    for name, pictures in named.items():
        for number, picture in enumerate(pictures, start=1):
            write_png(out / f"{name}{'' if len(pictures) == 1 else f'_{number}'}.png", picture.image)
    for case in cases:
        stem = case.truth.name.replace("/", "__")
        animated_glb(out / f"{stem}.glb", case.truth.with_garment(case.vertices["fused_pretrained"]))
    sections = [
        Section("The method in one frame", "", [overview]),
        Section("What is compared", "\n\n".join(f"{method}: {text}." for method, text in METHODS.items())),
        Section("Meshes and their errors", "Distance of each vertex to the simulated garment.", meshes),
        Section("Maps", "True maps, predicted maps, and the distance between them.", maps),
        Section("Training", "Loss of both networks, and errors on the validation clips.", curves),
    ]
    write_report(out, "imgtransfer: a T-shirt deformed without skinning", overall, sections)


@contextmanager
def _step(title: str) -> Iterator[None]:
    print(f"\n{title} ...", file=sys.stderr, flush=True)
    started = time.monotonic()
    yield
    print(f"{title}: {time.monotonic() - started:.0f} s", file=sys.stderr, flush=True)


def main() -> int:
    """Entry point of `scripts/demo`. Exit status as for `imgtransfer`."""
    parser = argparse.ArgumentParser(prog="scripts/demo", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder for the results")
    out = parser.parse_args().out

    def demo() -> None:
        config = load_config(DEMO_CONFIG, [f"data.source={json.dumps(str(SAMPLE_DATA))}"])
        metrics = run_demo(out, config, PRETRAINED)
        print(f"\n{metrics_table(metrics, first='method')}\n")
        animations, pictures = sorted(out.glob("*.glb")), sorted(out.glob("*.png"))
        files = [out / name for name in ("report.html", "metrics.json", "metrics_by_clip.json")]
        for path in [*files, *animations, out / "run", *pictures]:
            print(path)

    return exit_status(demo, program="demo", stopped="stopped; the same command goes on with the training")


if __name__ == "__main__":
    sys.exit(main())
