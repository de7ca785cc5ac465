"""The settings of motion guided garments: sections 4 to 6 of the paper, and sizes that scale it down."""

from __future__ import annotations

from pydantic import Field, model_validator

from imgtransfer.config.schema import Metres, Ratio, Section


class MotionGuidedConfig(Section):
    """Motion guided garments (Zhang et al. 2022). The defaults are the paper's, which want a GPU."""

    seeds: int = Field(581, ge=1, le=10**4, description="Seed points on the body, N in the paper.")
    uv_size: int = Field(
        128, ge=4, le=1024, description="Pixels along a side of the maps in the garment's texture space."
    )
    features: int = Field(
        128, ge=1, le=4096, description="Channels of the maps of features, and width of the perceptron R."
    )
    channels: tuple[int, ...] = Field(
        (128, 256, 512, 1024, 1024, 1024),
        min_length=1,
        max_length=9,
        description="Of the encoders' layers, each of which halves the map, down to 2 by 2 pixels: one layer for a "
        "uv_size of 4, two for 8, six for 128.",
    )
    latent: int = Field(64, ge=1, le=4096, description="Numbers of a latent code, |Z|.")
    collision: Ratio = Field(100.0, ge=0, le=1e6, description="λ1, of the body at rest within the garment.")
    regularisation: Ratio = Field(
        0.001, ge=0, le=1e6, description="λ2, of latent codes that are no normal sample."
    )
    margin_m: Metres = Field(
        0.002, ge=0, le=0.1, description="ε of L_SDF0: how far in front of the body vertices shall be."
    )
    interaction_m: Metres = Field(
        0.1,
        gt=0,
        le=10,
        description="How far the body's seed points push the garment, as the deviation of a Gaussian.",
    )
    static_steps: int = Field(
        26_250,
        ge=1,
        le=10**8,
        description="Steps that fit the space of garments; 350 epochs of 300 frames in batches of 4.",
    )
    dynamic_steps: int = Field(
        26_250, ge=1, le=10**8, description="Steps that then fit the encoder of the dynamics."
    )
    batch_frames: int = Field(4, ge=1, le=1024, description="Frames of a batch, of all clips.")
    learning_rate: Ratio = Field(1e-4, gt=0, le=1, description="At first.")
    halve_steps: int = Field(
        3750, ge=1, le=10**8, description="Steps after which the learning rate halves, again and again."
    )
    warm_up_frames: int = Field(
        10,
        ge=0,
        le=1000,
        description="Frames for which the body stands still before a roll-out, for the garment to settle.",
    )
    residual_steps: int = Field(
        20,
        ge=0,
        le=1000,
        description="Steps on the residual map of a frame with collisions (section 5.1); 0 leaves them.",
    )
    residual_rate_m: Metres = Field(0.001, gt=0, le=1, description="Learning rate of the residual map.")
    residual_collision: Ratio = Field(100.0, ge=0, le=1e6, description="λ3, of collisions against moving.")
    residual_threshold_m: Metres = Field(
        0.001, ge=0, le=1e3, description="ε of section 5.1: depths of a frame, added up, that are left."
    )

    @model_validator(mode="after")
    def _halved_to_two(self) -> MotionGuidedConfig:
        wanted = 2 ** (len(self.channels) + 1)
        if self.uv_size != wanted:
            raise ValueError(
                f"uv_size is {self.uv_size}; {len(self.channels)} channels halve a map of {wanted} pixels to 2"
            )
        return self
