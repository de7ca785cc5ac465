#!/usr/bin/env python
"""A training step with a pretrained encoder, with and without the file of what its frozen part makes of bodies.

The encoder is a vision transformer as wide and deep as DINO's ViT-B/16, the paper's, of random weights; refinement and
decoder are those of configs/paper.yaml, on a synthetic clip of 4 frames, maps of 128 x 128 pixels, all 4 frames a
batch, float32. One torch thread. All frames are in the file before anything is timed.

  step_ms_cached_*, step_ms_anew_*   one whole step with the file, and without
  ratio_anew_to_cached_*             how many times as long a step takes without the file
  *_paper                            with the last two blocks and the norm of the encoder trained
  *_frozen                           with the norm alone
  *_frozen_384                       with the norm and a projection of the tokens from 768 to 384 features
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import torch

# This folder's own render.py must not hide the package.
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from imgtransfer.config.loader import load_config
from imgtransfer.data.clip import save_clip
from imgtransfer.training.config import RunConfig
from imgtransfer.training.trainer import Trainer
from scripts.bench.clips import synthetic_clip
from scripts.bench.measuring import Results, command, interleaved

CONFIG = Path(__file__).resolve().parents[2] / "configs" / "paper.yaml"
# Blocks that are trained, width of the tokens.
CASES = {"paper": (2, None), "frozen": (0, None), "frozen_384": (0, 384)}


def measure(quick: bool) -> Results:
    """All numbers."""
    frames = 2 if quick else 4
    found: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        source, encoder = Path(folder) / "tube.npz", Path(folder) / "encoder"
        save_clip(source, synthetic_clip((16, 10), (14, 12), frames))
        _checkpoint(encoder, dim=32 if quick else 768, depth=2 if quick else 12)
        changes = [
            f"data.source={source}",
            *(f"data.{part}={{split: null}}" for part in ("train", "validation")),
            f"network.encoder.name={encoder}",
            f"maps.size=[{64 if quick else 128}, {64 if quick else 128}]",
            f"training.batch_frames={frames}",
            "training.precision=float32",
            "training.threads=1",
        ]
        for name, (blocks, width) in CASES.items():
            own = [f"network.encoder.trained_blocks={blocks}"]
            if width:
                own.append(f"network.encoder.dim={16 if quick else width}")
            # One case after the other: six such networks and their optimisers need not fit into memory together.
            found |= _case(name, [*changes, *own], Path(folder), rounds=1 if quick else 5)
    return {"trunk": found}


def _case(name: str, changes: list[str], folder: Path, rounds: int) -> dict[str, float]:
    """Steps of this configuration in turns, with the file and without."""
    anew, cached = (Trainer(load_config(RunConfig, CONFIG, changes)) for _ in range(2))
    cached.cache_trunks(folder)
    cached.rehearse()  # a batch of all frames fills the file
    times = interleaved(
        {"anew": anew.train_step, "cached": cached.train_step}, rounds=rounds, told=f"trunk, {name}"
    )
    return {
        f"step_ms_cached_{name}": times.ms("cached"),
        f"step_ms_anew_{name}": times.ms("anew"),
        f"ratio_anew_to_cached_{name}": times.ratio("anew", "cached"),
    }


def _checkpoint(folder: Path, *, dim: int, depth: int) -> None:
    """Random weights in the hub's format."""
    from transformers import ViTConfig, ViTModel  # noqa: PLC0415  (of an extra)

    torch.manual_seed(0)
    config = ViTConfig(
        hidden_size=dim,
        num_hidden_layers=depth,
        num_attention_heads=max(1, dim // 64),
        intermediate_size=4 * dim,
    )
    ViTModel(config).save_pretrained(folder)


if __name__ == "__main__":
    command(__doc__, measure)
