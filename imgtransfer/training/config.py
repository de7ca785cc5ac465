"""The configuration of a training run: what `imgtransfer train` reads from YAML and writes beside its results."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from annotated_types import Unit
from pydantic import ConfigDict, Field, model_validator

from imgtransfer.config.schema import Ratio, Section
from imgtransfer.network.config import MapsConfig, NetworkConfig, check_laid_out


class ClipChoice(Section):
    """Which clips of the source, see `imgtransfer.data.source.open_clips`."""

    split: str | None = Field(
        None,
        description="A data set's split; null for a folder of clip npz files, which has none, and where this "
        "section is given without it.",
    )
    names: tuple[str, ...] | None = Field(
        None, description="Glob patterns of the clips to take; null takes all."
    )
    exclude: tuple[str, ...] = Field((), description="Glob patterns of the clips to leave out.")


class DataConfig(Section):
    """The clips."""

    source: Path | Annotated[tuple[Path, ...], Field(min_length=1)] = Field(
        description="A data set folder, a folder of clip npz files or one such file; relative to the working folder. "
        "Or a list of them, in each of which the clips are chosen; some may have none that match."
    )
    train: ClipChoice = Field(ClipChoice(split="train"), description="The clips to train on.")
    validation: ClipChoice = Field(
        ClipChoice(split="validation"), description="The clips that each validation measures."
    )
    validation_frames: int = Field(
        64,
        ge=1,
        le=10**6,
        description="Frames, spread evenly over the validation clips, that each validation measures.",
    )
    cache_gb: Annotated[float, Unit("10⁹ bytes")] = Field(
        8.0,
        gt=0,
        le=1e5,
        description="Memory for training frames that have been read (validation frames get as much at most). Data that "
        "fit are read once; larger data about once an epoch, and are then mixed within half of this memory at a time.",
    )

    @property
    def sources(self) -> tuple[Path, ...]:
        """Each of them."""
        return self.source if isinstance(self.source, tuple) else (self.source,)


class TrainingConfig(Section):
    """The optimisation. Both networks are trained in one run on the same batches, each by a loss of its own."""

    steps: int = Field(
        100_000,
        ge=0,
        le=10**9,
        description="Steps of the optimiser, a batch each; 0, with `network.head`, leaves it at the first guess.",
    )
    batch_frames: int = Field(
        8, ge=1, le=4096, description="Frames that one process computes at a time: a batch."
    )
    accumulate: int = Field(
        1,
        ge=1,
        le=4096,
        description="Batches whose gradients each process adds up before a step. A step takes batch_frames times this "
        "times the number of processes frames.",
    )
    optimizer: Literal["adam", "adamw"] = Field("adam", description="Adam (the paper), or AdamW.")
    learning_rate: Ratio = Field(1e-4, gt=0, le=10, description="After the warm-up.")
    schedule: Literal["constant", "linear", "cosine"] = Field(
        "constant",
        description="The learning rate after the warm-up; linear and cosine fall to 0 at the last step.",
    )
    warmup_steps: int = Field(
        0, ge=0, le=10**9, description="Steps over which the learning rate rises from 0."
    )
    weight_decay: Ratio = Field(
        0.0,
        ge=0,
        le=100,
        description="Of the matrices of linear layers and convolutions; biases, norms and embeddings do not decay. In "
        "each step AdamW takes the learning rate times this off a weight, so that a run without gradients would leave "
        "exp(-this times the sum of its learning rates). 1,500 cosine steps of 2e-3 sum to 1.5: 0.05 takes 7 % in all, "
        "next to nothing; 0.5 takes half. Adam adds this times the weight to its gradient instead.",
    )
    ema: Ratio | None = Field(
        None,
        gt=0,
        lt=1,
        description="Decay of the exponential moving average of the weights, which validation measures and "
        "model.safetensors gets; such as 0.99, a mean over about 100 steps. In early steps it is "
        "(1 + step) / (10 + step) where that is less. null takes the weights of the last step.",
    )
    init: Path | None = Field(
        None,
        description="A trained model, a run's folder or its model.safetensors, whose weights the run begins with; its "
        "maps and network must be the run's, and its garment, unless it was trained on several. `network.head` is then "
        "fitted to what the model leaves. null begins with random weights.",
    )
    gradient_clip: Ratio | None = Field(
        None, gt=0, le=1e9, description="Greatest norm of a network's gradient; null leaves it."
    )
    mirror: bool = Field(
        False,
        description="Show half of the frames mirrored left to right, as images (columns flipped, x negated).",
    )
    precision: Literal["auto", "float32", "bfloat16"] = Field(
        "auto",
        description="Of the networks' products; maps, weights and losses are float32 in any case. `auto` measures at "
        "the start and takes bfloat16 only where it is faster on this device (`training.precision`).",
    )
    trunk_cache_gb: Annotated[float, Unit("10⁹ bytes")] = Field(
        16.0,
        ge=0,
        le=1e6,
        description="What the frozen part of a pretrained encoder makes of each training frame's body is kept in a"
        " file in the run's folder until the run ends, if it is no larger than this; else, and with 0, computed anew.",
    )
    device: Literal["auto", "cpu", "cuda"] = Field(
        "auto", description="What computes; `auto` is CUDA where there is it, else the CPU."
    )
    threads: int | None = Field(
        None, ge=1, le=1024, description="CPU threads; null leaves the choice to the environment."
    )
    seed: int = Field(
        0, ge=0, lt=2**63, description="Of the networks' first weights and of the order of the frames."
    )
    deterministic: bool = Field(
        False,
        description="Take only CUDA kernels that give the same result every time, or stop where there is none; they "
        "are slower. A CPU needs no asking.",
    )
    validate_every_steps: int = Field(1000, ge=1, le=10**9, description="Steps between two validations.")
    geometry_every_steps: int | None = Field(
        None,
        ge=1,
        le=10**9,
        description="Steps after which some validation frames are also fused and their vertices measured, and so after "
        "the last; a frame takes as long as in `imgtransfer fuse`. null never does.",
    )
    geometry_frames: int = Field(
        8,
        ge=2,
        le=10**4,
        description="How many validation frames that are: runs of four that follow each other.",
    )
    checkpoint_every_steps: int = Field(
        1000,
        ge=1,
        le=10**9,
        description="Steps after which the model and the state to resume from are saved.",
    )
    keep_checkpoints: int = Field(
        1,
        ge=1,
        le=10**4,
        description="How many saved states with their models are kept: the last in the run's folder, earlier ones in "
        "checkpoints/STEP. The model of the best validation is kept besides.",
    )
    tensorboard: bool = Field(
        False, description="Also write what log.jsonl gets for TensorBoard, into the run's folder."
    )
    wandb: str | None = Field(
        None,
        min_length=1,
        max_length=128,
        description="Project of Weights & Biases to log to; null does not.",
    )
    stored: Literal["float32", "float16"] = Field(
        "float32",
        description="Number type of the weights in model.safetensors; resuming uses float32 weights in any case.",
    )


class RunConfig(Section):
    """One training run."""

    model_config = ConfigDict(title="the YAML of a training run, such as configs/demo.yaml,")

    data: DataConfig = Field(description="The clips.")
    maps: MapsConfig = Field(MapsConfig(), description="How meshes become images.")
    network: NetworkConfig = Field(
        NetworkConfig(),
        description="The two transfer networks, for positions and normals; both have the same sizes.",
    )
    training: TrainingConfig = Field(
        TrainingConfig(),
        description="The optimisation. Both networks are trained in one run on the same batches, each by a loss of its "
        "own.",
    )

    @model_validator(mode="after")
    def _trains(self) -> RunConfig:
        if self.training.steps == 0 and self.network.head.kind == "none":
            raise ValueError("training.steps: 0 needs network.head.kind: kernel; nothing would be trained")
        check_laid_out(self.maps, self.network, mirror=self.training.mirror)
        return self
