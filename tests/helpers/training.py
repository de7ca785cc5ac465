"""A training of seconds."""

from __future__ import annotations

from pathlib import Path

from imgtransfer.config.loader import parse_config
from imgtransfer.training.config import RunConfig
from tests.helpers.models import LOCAL

SMALL = {
    "maps": {"size": [32, 32]},
    "network": {
        "encoder": {"patch": 8, "dim": 16, "depth": 1, "heads": 2},
        "blocks": 1,
        "target": "residual",
        "frame": "body",
        "shortcuts": True,
    },
    "training": {
        "steps": 6,
        "batch_frames": 2,
        "optimizer": "adamw",
        "learning_rate": 1e-2,
        "schedule": "cosine",
        "mirror": True,
        "gradient_clip": 1.0,
        "precision": "float32",
        "threads": 1,
        "validate_every_steps": 3,
        "checkpoint_every_steps": 3,
    },
}


def small_config(source: Path, **training: object) -> RunConfig:
    data = {
        "source": str(source),
        "train": {"split": None, "exclude": ["*_test"]},
        "validation": {"split": None, "names": ["*_test"]},
    }
    return parse_config(RunConfig, SMALL | {"data": data, "training": SMALL["training"] | training}, "small")


def hub_config(source: Path, folder: Path, **training: object) -> RunConfig:
    """The same with the pretrained encoder of a folder."""
    values = small_config(source, **training).model_dump(mode="json")
    encoder = {"kind": "hub", "name": str(folder), "trained_blocks": 2}
    values["network"] |= {"encoder": encoder, "heads": 2}
    return parse_config(RunConfig, values, "small")


def head_config(source: Path, *, head: dict[str, object] | None = None, **training: object) -> RunConfig:
    """With a kernel head of three patches."""
    data = {
        "source": str(source),
        "train": {"split": None, "exclude": ["*_test"]},
        "validation": {"split": None, "names": ["*_test"]},
    }
    network = LOCAL | {"head": {"kind": "kernel", "patches": 3, "ridge": 1e-6} | (head or {})}
    options = SMALL["training"] | {"schedule": "constant"} | training
    return parse_config(RunConfig, SMALL | {"data": data, "network": network, "training": options}, "small")
