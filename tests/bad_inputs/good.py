"""Small good input of every kind, made once, for faults to spoil copies of it."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from imgtransfer.cli.main import main
from imgtransfer.config.loader import parse_config, to_yaml
from imgtransfer.data.clip import Clip, save_clip
from imgtransfer.data.packing import pack
from imgtransfer.data.store import DataSet
from imgtransfer.training.checkpoint import save_model
from imgtransfer.training.config import RunConfig
from imgtransfer.training.trainer import Trainer
from render import load_maps, save_maps
from tests.bad_inputs.good_foreign import write_meshes, write_motions, write_public_sets
from tests.helpers import synthetic
from tests.helpers.models import model_for
from tests.helpers.training import SMALL

FUSION = "edge_iterations: 4\nnormal_iterations: 2\n"
SIMULATION = "clips: [{motion: walk, seconds: 0.2}]\n"


def write_good(folder: Path) -> None:
    """Everything that the readings name, under `folder`; configurations name it relative to there."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        clip = _clip()
        _write_ours(clip)
        _write_run()
        _write_predictions()
        write_meshes(clip)
        write_motions()
        write_public_sets()
    finally:
        os.chdir(before)


def _clip() -> Clip:
    return replace(synthetic.tube_clip(3), info={"source": "synthetic", "licence": "CC0"})


def _write_ours(clip: Clip) -> None:
    save_clip("clip.npz", clip)
    data = DataSet.create("set", title="Tubes", licence="CC0")
    for split in ("train", "validation"):
        data.write(f"tube/{split}", clip, split=split)
    data.reject("tube/worse", "it sinks", "b")
    pack(data, Path("set.zip"))
    old = DataSet.create("old", title="Tubes")
    old.write("tube/train", clip, split="train")
    for file, kept in (
        ("old/zarr.json", None),
        ("old/tube/train/zarr.json", ("name", "split", "fps", "frames", "info")),
    ):
        stored = json.loads(Path(file).read_text())
        attributes = stored["attributes"]
        stored["attributes"] = (
            attributes | {"schema_version": 1} if kept is None else {key: attributes[key] for key in kept}
        )
        Path(file).write_text(json.dumps(stored))
    save_model("model.safetensors", model_for(clip))
    Path("fusion.yaml").write_text(FUSION)
    Path("simulation.yaml").write_text(SIMULATION)
    Path("pins.txt").write_text("# the hem\n0 1 2, 3\n4\n")
    np.savez("pins.npz", indices=np.arange(4), positions=clip.garment.vertices[:, :4])
    np.savez("body.npz", body_faces=clip.body.faces, body_vertices=clip.body.vertices)
    np.savez("start.npz", garment_faces=clip.template.faces, garment_vertices=clip.garment.vertices)
    cv2.imwrite("weave.png", np.full((4, 4, 3), 90, np.uint8))


def _write_run() -> None:
    """run.yaml, and in run/ what it leaves when it is stopped after two of its three steps."""
    source = {"source": "set", "validation": {"split": "validation"}}
    steps = {"steps": 3, "validate_every_steps": 2, "checkpoint_every_steps": 2}
    config: RunConfig = parse_config(
        RunConfig, SMALL | {"data": source, "training": SMALL["training"] | steps}, "run"
    )
    Path("run.yaml").write_text(to_yaml(config))
    trainer = Trainer(config)
    lines = [{"step": 0, "seconds": 0.0, **trainer.validate()}]
    for step in (1, 2):
        lines.append({"step": step, "seconds": 0.1 * step, **trainer.train_step()})
    Path("run").mkdir()
    trainer.save(Path("run"))
    Path("run/config.yaml").write_text(to_yaml(config))
    Path("run/log.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))


def _write_predictions() -> None:
    """p/clip as `predict` writes it, done/clip after `fuse`, and the maps in each form."""
    for argv in (
        ["predict", "model.safetensors", "clip.npz", "--out", "p"],
        ["predict", "model.safetensors", "clip.npz", "--out", "done"],
        ["fuse", "done", "--config", "fusion.yaml"],
    ):
        if main(argv) != 0:
            raise RuntimeError(f"the good input is not good: {argv}")
    maps = load_maps("p/clip/maps.npz")
    save_maps("maps.npz", maps)
    save_maps("exr", maps)
