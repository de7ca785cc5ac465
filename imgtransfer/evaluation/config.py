"""What metrics are measured with: numbers compare only where these are the same."""

from __future__ import annotations

from typing import Annotated

from annotated_types import Unit
from pydantic import ConfigDict, Field

from imgtransfer.config.schema import Ratio, Section


class StedConfig(Section):
    """Parameters of the spatio-temporal edge difference, see `imgtransfer.evaluation.sted`."""

    distance: Annotated[int, Unit("edges")] = Field(
        1, ge=1, le=100, description="How far around a vertex the spatial part looks."
    )
    window: Annotated[int, Unit("frames")] = Field(
        11,
        ge=1,
        le=10_000,
        description="Temporal edges, centred, by whose mean length the temporal part divides; fewer at a clip's ends.",
    )
    temporal_weight: Ratio = Field(0.136, ge=0, le=1e6, description="What the temporal part counts; c.")
    frame_step: Ratio = Field(
        0.002,
        gt=0,
        le=1e3,
        description="How far apart two frames lie, dt, as a fraction of the bounding box's diagonal. The temporal part "
        "is about inversely proportional to it.",
    )


class EvaluateConfig(Section):
    """What `imgtransfer evaluate` measures with."""

    model_config = ConfigDict(title="YAML with parameters of the metrics")

    sted: StedConfig = Field(StedConfig(), description="The spatio-temporal edge difference.")
