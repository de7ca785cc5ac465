"""Checkpoints that come with the package, by the names that `--model` takes."""

from __future__ import annotations

from pathlib import Path

#: Names and files beside this module. In a clone they are links to what `configs` describes; wheels hold the files.
SHIPPED = {"general": "general.safetensors"}


def shipped_model(name: str) -> Path | None:
    """Where the checkpoint of this name is; None for every other name."""
    file = SHIPPED.get(name)
    return None if file is None else Path(__file__).with_name(file)
