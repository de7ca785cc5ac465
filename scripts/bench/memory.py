#!/usr/bin/env python
"""The most memory that `imgtransfer predict` and `fuse` take, as processes of their own, for longer and longer clips.

A tube of cloth about a body (1,100 and 1,724 vertices), 30 frames over and over; an untrained network of 32 x 32
pixels, and a fusion of few steps, so that thousands of frames take minutes. What grows with the frames would do so with
any mesh and network; what does not (PyTorch itself, the weights, a batch) is more with larger ones.

  predict_mb_N, fuse_mb_N      MB of resident memory at its peak, for a clip of N frames
  predict_ratio, fuse_ratio    the longest clip's over the shortest's
  predict_frames_per_s, ...    of the longest clip, with the start of the process
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import torch

# This folder's own render.py must not hide the package.
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from imgtransfer.data.clip import Clip, written_clip
from imgtransfer.data.clip_parts import Body, Template
from imgtransfer.network import MapsConfig, NetworkConfig, TransferModel
from imgtransfer.pipeline.folder import MAPS_FILE
from imgtransfer.training.checkpoint import save_model
from render import Mesh, PositionBox
from scripts.bench import shapes
from scripts.bench.measuring import Results, command

ROOT = Path(__file__).resolve().parents[2]
FRAMES = (60, 600, 6000)
GARMENT, BODY = (44, 25), (42, 41)  # vertices around and along
SIZE = (32, 32)
NETWORK = {"encoder": {"patch": 8, "dim": 16, "depth": 1, "heads": 2}, "blocks": 1, "target": "residual"}
FUSION = "edge_iterations: 2\nnormal_iterations: 2\n"
_REPEATED = 30  # frames
# The peak of a process begins, on Linux, at that of the process that starts it, which has PyTorch loaded here. So a
# small one starts the command, and prints its peak.
_LAUNCH = """
import os, sys
with open(os.devnull, "wb") as nowhere:
    streams = [(os.POSIX_SPAWN_DUP2, nowhere.fileno(), 1)]
    process = os.posix_spawn(sys.argv[1], sys.argv[1:], os.environ, file_actions=streams)
    _, status, usage = os.wait4(process, 0)
print(usage.ru_maxrss)
sys.exit(os.waitstatus_to_exitcode(status))
"""


def measure(quick: bool) -> Results:
    """Megabytes and frames a second, by command."""
    garment, body = ((16, 10), (14, 12)) if quick else (GARMENT, BODY)
    frames = (3, 6) if quick else FRAMES
    found: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        clip = _clip(garment, body)
        save_model(folder / "model" / "model.safetensors", _model(clip))
        (folder / "fusion.yaml").write_text(FUSION)
        for count in frames:
            found |= _case(folder, clip, count)
    for what in ("predict", "fuse"):
        found[f"{what}_ratio"] = found[f"{what}_mb_{frames[-1]}"] / found[f"{what}_mb_{frames[0]}"]
    return {"memory": found}


def _case(folder: Path, clip: Clip, count: int) -> dict[str, float]:
    source, out = folder / f"walk{count}.npz", folder / f"out{count}"
    with written_clip(source) as add:
        for first in range(0, count, _REPEATED):
            add(clip.slice(slice(0, min(_REPEATED, count - first))))
    commands = {
        "predict": ["predict", str(folder / "model"), str(source), "--out", str(out)],
        "fuse": ["fuse", str(out), "--config", str(folder / "fusion.yaml")],
    }
    found = {}
    for what, words in commands.items():
        started = time.perf_counter()
        found[f"{what}_mb_{count}"] = peak_mb([sys.executable, "-m", "imgtransfer.cli.main", *words])
        found[f"{what}_frames_per_s"] = count / (time.perf_counter() - started)
    assert (out / source.stem / MAPS_FILE).is_file()
    return found


def peak_mb(words: list[str]) -> float:
    """Run a command and return its peak resident memory; RuntimeError where it fails."""
    launched = subprocess.run(
        [sys.executable, "-c", _LAUNCH, *words],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        text=True,
        check=False,
    )
    if launched.returncode:
        raise RuntimeError(f"{' '.join(words)}: status {launched.returncode}")
    return int(launched.stdout) / (
        1e6 if sys.platform == "darwin" else 1e3
    )  # bytes there, kilobytes elsewhere


def _clip(garment: tuple[int, int], body: tuple[int, int]) -> Clip:
    cloth, inside = shapes.garment(*garment), shapes.body(*body)
    return Clip(
        template=Template(vertices=cloth.vertices.astype(np.float32), faces=cloth.faces),
        garment=None,
        body=Body(
            rest=inside.vertices.astype(np.float32),
            faces=inside.faces,
            vertices=shapes.moved(inside.vertices, _REPEATED),
        ),
        fps=30.0,
        name="walk",
    )


def _model(clip: Clip) -> TransferModel:
    torch.manual_seed(0)
    return TransferModel(
        maps=MapsConfig(size=SIZE),
        network=NetworkConfig.model_validate(NETWORK),
        template=Mesh(clip.template.vertices, clip.template.faces),
        box=PositionBox.around(clip.template.vertices, margin=0.5),
    ).eval()


if __name__ == "__main__":
    command(__doc__, measure)
