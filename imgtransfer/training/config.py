"""The configuration of a training run: what `imgtransfer train` reads from YAML and writes beside its
results.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field

from imgtransfer.config import loader as config
from imgtransfer.network.config import MapsConfig, NetworkConfig


class _Section(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class ClipChoice(_Section):
    """Which clips of the source, see `imgtransfer.data.source.open_clips`."""

    split: str | None = None
    """A data set's split; None for a folder of clip npz files, which has none."""
    names: tuple[str, ...] | None = None
    """Glob patterns of the clips to take; None takes all."""
    exclude: tuple[str, ...] = ()
    """Glob patterns of the clips to leave out."""


class DataConfig(_Section):
    """The clips."""

    source: Path
    """A data set folder, a folder of clip npz files or one such file; relative to the working folder."""
    train: ClipChoice = ClipChoice(split="train")
    validation: ClipChoice = ClipChoice(split="validation")
    validation_frames: int = Field(default=64, ge=1, le=10**6)
    """Frames, spread evenly over the validation clips, that each validation measures."""
    cache_gb: float = Field(default=8.0, gt=0, le=1e5)
    """Memory for training frames that have been read, in 10⁹ bytes (validation frames get as much at most). Data that
    fit are read once; larger data about once an epoch, and are then mixed within half of this memory at a time."""


class TrainingConfig(_Section):
    """The optimisation. Both networks are trained in one run on the same batches, each by a loss of its
    own.
    """

    steps: int = Field(default=100_000, ge=1, le=10**9)
    batch_frames: int = Field(default=8, ge=1, le=4096)
    optimizer: Literal["adam", "adamw"] = "adam"
    learning_rate: float = Field(default=1e-4, gt=0, le=10)
    schedule: Literal["constant", "cosine"] = "constant"
    """The learning rate after the warm-up; cosine falls to 0 at the last step."""
    warmup_steps: int = Field(default=0, ge=0, le=10**9)
    weight_decay: float = Field(default=0.0, ge=0, le=100)
    gradient_clip: float | None = Field(default=None, gt=0, le=1e9)
    """Greatest norm of a network's gradient; None leaves it."""
    mirror: bool = False
    """Show half of the frames mirrored left to right, as images (columns flipped, x negated)."""
    precision: Literal["auto", "float32", "bfloat16"] = "auto"
    """Of the networks' products; maps, weights and losses are float32 in either case. `auto` measures at the start and
    takes bfloat16 only where it is faster on this device (`training.precision`)."""
    device: Literal["auto", "cpu", "cuda"] = "auto"
    threads: int | None = Field(default=None, ge=1, le=1024)
    """CPU threads; None leaves the choice to the environment."""
    seed: int = Field(default=0, ge=0, lt=2**63)
    validate_every_steps: int = Field(default=1000, ge=1, le=10**9)
    checkpoint_every_steps: int = Field(default=1000, ge=1, le=10**9)
    stored: Literal["float32", "float16"] = "float32"
    """Number type of the weights in model.safetensors; resuming uses float32 weights in any case."""


class RunConfig(_Section):
    """One training run."""

    data: DataConfig
    maps: MapsConfig = MapsConfig()
    network: NetworkConfig = NetworkConfig()
    training: TrainingConfig = TrainingConfig()


def load_config(path: str | Path, changes: Sequence[str] = ()) -> RunConfig:
    """Read a run's YAML.

    Args:
        path: the file.
        changes: "section.key=value" each, the value as YAML; they replace or add what the file says.

    Raises:
        InputError: no such file, not YAML, an unknown key, a value out of its range, or a change that fits nowhere.
    """
    return config.load_config(
        RunConfig, path, changes, wanted="the YAML of a training run, such as configs/demo.yaml,"
    )


def parse_config(content: Any, source: str) -> RunConfig:
    """Check the parsed content of a run's YAML; `source` is what the InputError calls it."""
    return config.checked(RunConfig, content, source)


def to_yaml(run: RunConfig) -> str:
    """All values, the defaults too, as YAML that `load_config` reads back."""
    return yaml.safe_dump(run.model_dump(mode="json"), sort_keys=False)
