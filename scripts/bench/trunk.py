#!/usr/bin/env python
"""A training step with a pretrained encoder, with and without the file of what its frozen part makes of bodies.

The encoder is a vision transformer as wide and deep as DINO's ViT-S/16, of random weights; refinement and decoder are
those of configs/paper.yaml, on a synthetic clip of 4 frames, maps of 128 x 128 pixels, all 4 frames a batch, float32.
One torch thread. All frames are in the file before anything is timed.

  step_ms_cached, step_ms_anew     one whole step
  ratio_anew_to_cached             how many times as long a step takes without the file; of a step with the last two
                                   blocks and the norm trained, and `_frozen` with the norm alone
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


def measure(quick: bool) -> Results:
    """All numbers."""
    frames = 2 if quick else 4
    with tempfile.TemporaryDirectory() as folder:
        source, encoder = Path(folder) / "tube.npz", Path(folder) / "encoder"
        save_clip(source, synthetic_clip((16, 10), (14, 12), frames))
        _checkpoint(encoder, dim=32 if quick else 384, depth=2 if quick else 12)
        changes = [
            f"data.source={source}",
            *(f"data.{part}={{split: null}}" for part in ("train", "validation")),
            f"network.encoder.name={encoder}",
            f"maps.size=[{64 if quick else 128}, {64 if quick else 128}]",
            f"training.batch_frames={frames}",
            "training.precision=float32",
            "training.threads=1",
        ]
        trainers = {}
        for name, blocks in (("", 2), ("_frozen", 0)):
            for cached in (False, True):
                config = load_config(
                    RunConfig, CONFIG, [*changes, f"network.encoder.trained_blocks={blocks}"]
                )
                trainers[f"{'cached' if cached else 'anew'}{name}"] = trainer = Trainer(config)
                if cached:
                    trainer.cache_trunks(Path(folder))
                    trainer.rehearse()  # a batch of all frames fills the file
        steps = {name: trainer.train_step for name, trainer in trainers.items()}
        times = interleaved(steps, rounds=1 if quick else 5, told="trunk")
    return {
        "trunk": {
            "step_ms_cached": times.ms("cached"),
            "step_ms_anew": times.ms("anew"),
            "ratio_anew_to_cached": times.ratio("anew", "cached"),
            "ratio_anew_to_cached_frozen": times.ratio("anew_frozen", "cached_frozen"),
        }
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
