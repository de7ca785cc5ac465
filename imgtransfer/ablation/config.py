"""The configuration of an ablation: one method, and the rows of a table that differ from it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, field_validator, model_validator

from imgtransfer.ablation.fusion_terms import TERMS
from imgtransfer.benchmark.config import BenchmarkConfig, BenchmarkData, parsed, run_content
from imgtransfer.config.schema import Section
from imgtransfer.deformers.image_transfer.method import ImageTransferConfig
from imgtransfer.evaluation.config import EvaluateConfig

_BUDGET = ("steps", "batch_frames")  # of a training, which all rows have in common


class AblationRow(Section):
    """One row of the table; without any of the three the method as it is."""

    label: str = Field(min_length=1, max_length=60, description="What the table calls it.")
    changes: dict[str, Any] = Field(
        {}, description="Settings of `method` that are others in this row, in its own sections."
    )
    method: dict[str, Any] | None = Field(
        None, description="Another method in place of it: a name and settings, as in a training."
    )
    terms: str | None = Field(
        None,
        description="How far the fusion of the method as it is goes: initialisation, edge lengths, rendered normals or "
        "full (table 5).",
    )

    @model_validator(mode="after")
    def _one_difference(self) -> AblationRow:
        given = [name for name in ("changes", "method", "terms") if getattr(self, name)]
        if len(given) > 1:
            raise ValueError(f"{self.label}: {' and '.join(given)} exclude each other")
        if self.terms is not None and self.terms not in TERMS:
            raise ValueError(f"{self.label}: terms {self.terms} must be one of {', '.join(TERMS)}")
        return self


class NetworkMethod(ImageTransferConfig):
    """The section `method` of a training of the networks."""

    name: Literal["image_transfer"] = Field("image_transfer", description="Which method.")


class AblationConfig(Section):
    """Rows that are trained at one budget and measured on the same clips."""

    model_config = ConfigDict(title="the YAML of an ablation, such as configs/ablation/skinning.yaml,")

    title: str = Field("", description="What the table is about.")
    data: BenchmarkData = Field(description="The clips to train on, and to measure on.")
    method: NetworkMethod = Field(
        NetworkMethod(), description="The section `method` of a training that all rows begin with."
    )
    rows: tuple[AblationRow, ...] = Field(min_length=1, description="Rows of the table.")
    seeds: tuple[Annotated[int, Field(ge=0, lt=2**31)], ...] = Field(
        (0,), min_length=1, description="Each row is trained once with each of them; the spread is over them."
    )
    threads: int = Field(1, ge=1, le=1024, description="CPU threads of every training and prediction.")
    evaluate: EvaluateConfig = Field(EvaluateConfig(), description="What the metrics are measured with.")

    @field_validator("seeds")
    @classmethod
    def _seeds_differ(cls, seeds: tuple[int, ...]) -> tuple[int, ...]:
        if len(set(seeds)) < len(seeds):
            raise ValueError("seeds must be different numbers")
        return seeds

    @model_validator(mode="after")
    def _rows_fit(self) -> AblationConfig:
        labels = [row.label for row in self.rows]
        twice = next((label for label in labels if labels.count(label) > 1), None)
        if twice is not None:
            raise ValueError(f"rows: two are called {twice}")
        for row in self.rows:
            for key in _BUDGET:
                if key in row.changes.get("training", {}):
                    raise ValueError(
                        f"rows: {row.label} changes training.{key}, and all rows have one budget; set it in `method`"
                    )
        return self

    def settings_of(self, row: AblationRow) -> dict[str, Any]:
        """The section `method` that a row is trained with."""
        if row.method is not None:
            return dict(row.method)
        return merged(self.method.model_dump(mode="json"), row.changes)

    def content_of(self, row: AblationRow, seed: int) -> dict[str, Any]:
        """The content of the training's configuration of a row (`imgtransfer.benchmark.config.run_content`)."""
        settings = self.settings_of(row)
        common = BenchmarkConfig(data=(self.data,), methods=(settings,), seed=seed, threads=self.threads)
        return run_content(common, self.data, settings)

    def check(self, source: str) -> None:
        """Raise InputError where a row's settings are wrong; `source` is what it calls the file."""
        for number, row in enumerate(self.rows):
            parsed(self.content_of(row, self.seeds[0]), f"{source}: rows.{number} ({row.label})")


def merged(settings: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """`settings` with `changes` put into their sections; one that names another `kind` takes the place of the old."""
    result = dict(settings)
    for key, value in changes.items():
        old = result.get(key)
        if not isinstance(value, Mapping) or not isinstance(old, Mapping):
            result[key] = value
        elif value.get("kind", old.get("kind")) != old.get("kind"):
            result[key] = dict(value)
        else:
            result[key] = merged(old, value)
    return result
