"""Every hyper-parameter of the fusion."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field


class FusionConfig(BaseModel):
    """Weights and schedule of the fusion; the defaults are those of section 4.2 of the paper, for a T-shirt.

    The weights apply to lengths in centimetres (edge and displacement terms in cm², collision in cm). The paper does
    not name its unit; with metres its edge weight is too weak to hold the cloth together, and the normal stage then
    makes the vertices worse than it found them.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    learning_rate_m: float = Field(
        1e-3,
        gt=0,
        lt=0.1,
        description="Adam's step in metres: about how far a vertex can move per step and axis.",
    )
    edge_steps: int = Field(100, ge=0, description="Steps of the first stage (edge lengths); 0 skips it.")
    normal_steps: int = Field(
        100, ge=0, description="Steps of the second stage (normals, collision); 0 skips it."
    )
    weight_displacement: float = Field(0.02, ge=0, description="λ_rv, per cm², both stages.")
    weight_edge: float = Field(
        100.0, ge=0, description="λ_e, per cm², second stage (the first has weight 1)."
    )
    weight_consistency: float = Field(
        0.001, ge=0, description="λ_rn, no unit; the paper takes 0.01 for garments other than the T-shirt."
    )
    weight_collision: float = Field(100.0, ge=0, description="λ_c, per cm.")
    collision_margin_m: float = Field(
        0.0,
        ge=0,
        lt=0.05,
        description="Metres of clearance below which a vertex counts as inside; the paper's is 0.",
    )
    sdf_every_steps: int = Field(
        5,
        ge=1,
        description="Steps between two distance queries; in between, the distance is linear in the vertices.",
    )
    clearance_m: float = Field(
        0.001,
        ge=0,
        lt=0.05,
        description="Metres from the body to which the final clean-up lifts nearer vertices.",
    )
    clearance_rounds: int = Field(
        10, ge=0, description="Rounds of the final clean-up at most; 0 leaves the vertices as optimised."
    )
    batch_frames: int = Field(
        8, ge=1, description="Frames solved together; changes memory and speed, not results."
    )
