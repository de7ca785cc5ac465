"""Every hyper-parameter of the fusion."""

from __future__ import annotations

from typing import Annotated, Literal

from annotated_types import Unit
from pydantic import BaseModel, ConfigDict, Field

_Metres = Annotated[float, Unit("m")]
_Ratio = Annotated[float, Unit("1")]
_PerSquareCentimetre = Annotated[float, Unit("1/cm²")]


class FusionConfig(BaseModel):
    """Weights and schedule of the fusion; the defaults are those of section 4.2 of the paper, for a T-shirt.

    The weights apply to lengths in centimetres (edge and displacement terms in cm², collision in cm). The
    paper does not name its unit; with metres its edge weight is too weak to hold the cloth together, and the
    normal stage then makes the vertices worse than it found them.
    """

    model_config = ConfigDict(
        title="YAML with hyper-parameters of the fusion", frozen=True, extra="forbid", allow_inf_nan=False
    )

    solver: Literal["local_global", "adam"] = Field(
        default="local_global",
        description="`local_global`: quasi-Newton steps around a prefactorised system; `adam`: the paper's schedule.",
    )
    edge_iterations: int = Field(
        default=100,
        ge=0,
        le=10**6,
        description="Of `local_global`, first stage (edge lengths), at most; 0 skips it.",
    )
    normal_iterations: int = Field(
        default=24,
        ge=0,
        le=10**6,
        description="Of `local_global`, second stage (normals, collision), at most; 0 skips it.",
    )
    edge_tolerance: _Ratio = Field(
        default=0.006,
        ge=0,
        lt=1,
        description="Of `local_global`, no unit: the first stage is finished when a step lowers the objective by a "
        "smaller fraction of it; much smaller ones draw the cloth to its edges' lengths and away from the maps.",
    )
    normal_tolerance: _Ratio = Field(
        default=0.007,
        ge=0,
        lt=1,
        description="Of `local_global`, no unit: the same for the second stage. Smaller ones follow the normal maps "
        "further, which is worth it where they are right.",
    )
    automatic_confidence: bool = Field(
        default=True,
        description="Leave out pixels of the position maps that do not fit their neighbours, and bring regions back "
        "that lie off their surroundings. Maps that hold together are left as they are.",
    )
    sdf_every_iterations: int = Field(
        default=8, ge=1, le=10**6, description="Of `local_global`: steps between two distance queries."
    )
    edge_steps: int = Field(
        default=100, ge=0, le=10**6, description="Of `adam`, first stage (edge lengths); 0 skips it."
    )
    normal_steps: int = Field(
        default=100, ge=0, le=10**6, description="Of `adam`, second stage (normals, collision); 0 skips it."
    )
    learning_rate_m: _Metres = Field(
        default=1e-3,
        gt=0,
        lt=0.1,
        description="Of `adam`, metres: about how far a vertex can move per step and axis.",
    )
    sdf_every_steps: int = Field(
        default=5,
        ge=1,
        le=10**6,
        description="Of `adam`: steps between two distance queries; in between, the distance is linear.",
    )
    weight_displacement: _PerSquareCentimetre = Field(
        default=0.02, ge=0, le=1e9, description="λ_rv, per cm², both stages."
    )
    weight_edge: _PerSquareCentimetre = Field(
        default=100.0, ge=0, le=1e9, description="λ_e, per cm², second stage (the first has weight 1)."
    )
    weight_consistency: _Ratio = Field(
        default=0.001,
        ge=0,
        le=1e9,
        description="λ_rn, no unit; the paper takes 0.01 for garments other than the T-shirt.",
    )
    weight_collision: Annotated[float, Unit("1/cm")] = Field(
        default=100.0,
        ge=0,
        le=1e9,
        description="λ_c, per cm. `local_global` holds vertices outside for every value but 0, which is the same "
        "while the weight exceeds what pushes them in.",
    )
    smooth_time_s: Annotated[float, Unit("s")] = Field(
        default=0.0,
        ge=0,
        le=60,
        description="Seconds, two frames at least: fused frames are smoothed over time, without lag; oscillations of "
        "this period are halved, longer ones stay, shorter ones go. 0 leaves every frame by itself.",
    )
    warm_start: bool = Field(
        default=False,
        description="Start each frame from its own readings plus what was changed in the frame before; frames must "
        "be consecutive, and are solved one after the other whatever batch_frames says.",
    )
    collision_margin_m: _Metres | None = Field(
        default=None,
        ge=0,
        lt=0.05,
        description="Metres of clearance below which a vertex counts as inside in the second stage. null is 0, the "
        "paper's; of `local_global` what the maps say of how far off the skin cloth rests (their contact offset, which "
        "a trained model knows), where they do.",
    )
    sdf_band_m: _Metres = Field(
        default=0.05,
        gt=0,
        le=1,
        description="Metres from an obstacle within which its distance is computed; farther vertices cost less.",
    )
    inner_margin_m: _Metres = Field(
        default=0.001,
        ge=0,
        lt=0.05,
        description="Metres by which the surface of the inner garment is raised, its thickness for instance.",
    )
    clearance_m: _Metres = Field(
        default=0.001,
        ge=0,
        lt=0.05,
        description="Metres from the body to which the final clean-up lifts nearer vertices.",
    )
    clearance_rounds: int = Field(
        default=10,
        ge=0,
        le=1000,
        description="Rounds of the final clean-up at most, and twice as many for the cloth between vertices; "
        "0 leaves all as optimised.",
    )
    self_contact: bool = Field(
        default=False,
        description="Take the garment out of itself at the end of the second stage, where edges of it pass "
        "through its own faces.",
    )
    batch_frames: int = Field(
        default=16,
        ge=1,
        le=10**6,
        description="Frames solved together at most, on a CPU 8 or as many as its caches hold; changes memory and "
        "speed, not results.",
    )

    def on_skin(self, contact_offset_m: float | None) -> FusionConfig:
        """With a number for `collision_margin_m`: its own, or else how far off the skin the cloth is known to rest.

        Not for the paper's schedule, which ended farther from the truth with it on both clips that were tried.
        """
        if self.collision_margin_m is not None:
            return self
        known = contact_offset_m if self.solver == "local_global" else None
        return self.model_copy(update={"collision_margin_m": known or 0.0})

    @property
    def margin_m(self) -> float:
        """Metres of clearance in the second stage; 0 where nothing says how cloth rests on skin."""
        return self.collision_margin_m or 0.0
