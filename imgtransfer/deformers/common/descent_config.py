"""How a recurrent network is fitted: settings that several methods share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

from annotated_types import Unit
from pydantic import Field

from imgtransfer.config.schema import Ratio, Section

Frames = Annotated[int, Unit("frames")]
_DECAY = 0.3  # what is left of the rate, section 4.2 of JointNet: it "decays by 70 %"


class DescentConfig(Section):
    """Truncated backpropagation through time over windows of the clips, by Adam."""

    steps: int = Field(20_000, ge=0, le=10**9, description="Steps of the optimiser, a batch of windows each.")
    windows: int = Field(8, ge=1, le=4096, description="Windows of a batch.")
    window_frames: Frames = Field(
        50, ge=1, le=100_000, description="Frames of a window that count; gradients go back no further."
    )
    warm_up_frames: Frames = Field(
        10,
        ge=0,
        le=10_000,
        description="Frames before each window, or copies of a clip's first before it begins, to settle in.",
    )
    learning_rate: Ratio = Field(1e-3, gt=0, le=10, description="At first.")
    decay_steps: int = Field(
        2600,
        ge=1,
        le=10**9,
        description="Steps after which the learning rate falls by 70 %, again and again.",
    )
    weight_decay: Ratio = Field(0.0, ge=0, le=100, description="AdamW's, of all parameters; 0 takes Adam.")
    gradient_clip: Ratio | None = Field(
        1.0, gt=0, le=1e9, description="Greatest norm of the gradient; null leaves it."
    )

    def rate(self) -> Callable[[int], float]:
        """The learning rate of step 0, 1, ..."""
        return lambda step: self.learning_rate * _DECAY ** (step // self.decay_steps)


class VertexDescentConfig(DescentConfig):
    """The same where the loss is of vertices."""

    loss_frames: Frames = Field(
        32,
        ge=1,
        le=100_000,
        description="Frames of a batch, drawn at random, of which vertices are computed and compared.",
    )
