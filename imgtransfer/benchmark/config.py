"""The configuration of a benchmark: clips, methods, and what all of them have in common."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from annotated_types import Unit
from pydantic import ConfigDict, Field, model_validator

from imgtransfer.config.schema import Ratio, Section
from imgtransfer.deformers.config import MethodRunConfig, parse_run_config
from imgtransfer.deformers.registry import NETWORK
from imgtransfer.evaluation.config import EvaluateConfig
from imgtransfer.training.config import ClipChoice

NAME = r"^[A-Za-z0-9][A-Za-z0-9_.+-]{0,63}$"


class BenchmarkData(Section):
    """The clips of one garment: some to fit to, others to measure."""

    name: str = Field("data", pattern=NAME, description="What tables and folders call it.")
    source: Path = Field(
        description="A data set folder, a folder of clip npz files or one such file; relative to the working folder."
    )
    train: ClipChoice = Field(ClipChoice(split="train"), description="The clips to fit to.")
    validation: ClipChoice = Field(
        ClipChoice(split="validation"), description="The clips that a training of networks looks at."
    )
    test: ClipChoice = Field(
        ClipChoice(split="test"), description="The clips to measure, all of them with the truth."
    )


class Robustness(Section):
    """How far a garment moves when one joint of the body is turned by itself (table 3 of JointNet)."""

    joints: tuple[Annotated[int, Field(ge=1, le=10**4)], ...] = Field(
        (16, 17, 18, 19),
        min_length=1,
        description="Joints that are turned, one at a time, by their number in `poses`; the paper's are SMPL's "
        "shoulders and elbows.",
    )
    angle: Annotated[float, Unit("degrees")] = Field(
        20.0, gt=0, le=180, description="Of each turn; it stays the same through a clip."
    )
    draws: int = Field(
        2, ge=1, le=100, description="Turns of each joint, about axes that are drawn by the seed."
    )


class Variants(Section):
    """One setting of a method over several values, such as AnchorDEF's number of anchors (its table 2)."""

    method: str = Field(description="The label of one of `methods`.")
    setting: str = Field(
        pattern=r"^[A-Za-z_]\w*(\.[A-Za-z_]\w*)*$", description="Its setting, such as anchors or rig.bones."
    )
    values: tuple[int | float | bool | str, ...] = Field(
        min_length=1, description="What the setting is, each in a fit of its own."
    )

    @property
    def title(self) -> str:
        """What tables and folders call it."""
        return f"{self.method}.{self.setting}"


class BenchmarkConfig(Section):
    """Methods that are fitted to the same clips and measured on others."""

    model_config = ConfigDict(title="the YAML of a benchmark, such as configs/benchmark/sample.yaml,")

    data: tuple[BenchmarkData, ...] = Field(
        min_length=1, description="Garments; every method is fitted to each."
    )
    methods: tuple[dict[str, Any], ...] = Field(
        min_length=1,
        description="What is compared: each the section `method` of a training, a name and settings, and `label`, "
        "which tables and folders call it, where that is not its name.",
    )
    fuse: bool = Field(
        True,
        description="Whether the vertices of every method are also refined by the fusion, in a row of its own.",
    )
    seed: int = Field(0, ge=0, lt=2**31, description="Of every fit, and of the intervals.")
    threads: int = Field(1, ge=1, le=1024, description="CPU threads of every fit and prediction.")
    resamples: int = Field(
        1000,
        ge=100,
        le=10**6,
        description="Draws of clips that the 95 % intervals of the means are taken from.",
    )
    pictures: Annotated[int, Unit("frames")] = Field(
        3, ge=0, le=50, description="Of each test clip, evenly spread, that are drawn for every method."
    )
    played: Annotated[int, Unit("frames")] = Field(
        12,
        ge=0,
        le=200,
        description="Of each test clip, evenly spread, that the page plays; 0, as of `pictures`, draws none.",
    )
    evaluate: EvaluateConfig = Field(EvaluateConfig(), description="What the metrics are measured with.")
    robustness: Robustness | None = Field(
        None, description="Also measure how far each garment moves when one joint is turned; null does not."
    )
    data_sizes: tuple[Annotated[Ratio, Field(gt=0, lt=1)], ...] = Field(
        (),
        description="Also fit every method to these parts of the training clips; the smaller lie in the larger.",
    )
    variants: tuple[Variants, ...] = Field(
        (), description="Also fit methods with other values of one setting."
    )
    rollouts: tuple[Annotated[int, Unit("frames"), Field(ge=1)] | None, ...] = Field(
        (),
        description="Also measure roll-outs of these lengths, null to the clip's end, from true frames, of the methods "
        "that predict a frame from those before it.",
    )

    @model_validator(mode="after")
    def _modes_fit(self) -> BenchmarkConfig:
        for name, values in (("data_sizes", self.data_sizes), ("rollouts", self.rollouts)):
            if len(set(values)) != len(values):
                raise ValueError(f"{name}: a value stands there twice")
        for one in self.variants:
            if one.method not in self.labels():
                raise ValueError(
                    f"variants: no method is called {one.method}; there are {', '.join(self.labels())}"
                )
        titles = [one.title for one in self.variants]
        if len(set(titles)) != len(titles):
            raise ValueError("variants: one setting stands there twice; put its values together")
        return self

    @model_validator(mode="after")
    def _names_differ(self) -> BenchmarkConfig:
        for what, names in (("data", [one.name for one in self.data]), ("methods", self.labels())):
            twice = next((name for name in names if names.count(name) > 1), None)
            if twice is not None:
                key = "name" if what == "data" else "label"
                raise ValueError(f"{what}: two are called {twice}; give one of them another {key}")
        return self

    def labels(self) -> list[str]:
        """What the methods are called, in their order."""
        return [label_of(method) for method in self.methods]


def label_of(method: dict[str, Any]) -> str:
    """What a method of a benchmark is called; "" where it has neither label nor name, which `run_content` refuses."""
    return str(method.get("label", method.get("name", "")))


def run_content(config: BenchmarkConfig, data: BenchmarkData, method: dict[str, Any]) -> dict[str, Any]:
    """The content of the training's configuration that fits a method to some data."""
    of_data = data.model_dump(mode="json", exclude={"name", "test"})
    if method.get("name") != NETWORK:
        del of_data["validation"]
    settings = {key: value for key, value in method.items() if key != "label"}
    return {"data": of_data, "method": settings, "seed": config.seed, "threads": config.threads}


def parsed(content: dict[str, Any], source: str) -> MethodRunConfig:
    """The configuration in what `run_content` gives.

    Raises:
        InputError: as `imgtransfer.deformers.config.parse_run_config`.
    """
    config = parse_run_config(content, source)
    assert isinstance(config, MethodRunConfig)
    return config
