"""The settings of AnchorDEF: section 4 and supplement A of the paper, and sizes that scale it down."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from imgtransfer.config.schema import Metres, Ratio, Section


class AnchorDefConfig(Section):
    """AnchorDEF (Zhao et al. 2023). The defaults are the paper's, for garments of thousands of vertices."""

    anchors: int = Field(
        160,
        ge=1,
        le=10**4,
        description="Anchors N (table 2 compares 20, 80, 160 and 320); as many vertices are left of the simplified "
        "meshes that they are drawn to.",
    )
    anchors_of_vertex: int = Field(
        8, ge=1, le=64, description="N', the nearest anchors that a vertex has blend weights of."
    )
    vertices_of_anchor: int = Field(
        128,
        ge=1,
        le=4096,
        description="K, the template's nearest vertices that an anchor's place is a mean of (equation 9); some ten "
        "times the vertices for each anchor, so fewer on coarse meshes.",
    )
    strategy: Literal["loose", "tight", "mixed"] = Field(
        "mixed",
        description="What an anchor moves with before the network moves it: the body's root (equation 3), the body's "
        "nearest vertex (equation 4), or one or the other by its distance to the joints.",
    )
    tight_within_m: Metres = Field(
        0.2, ge=0, le=10, description="Mixed anchors are tight up to this distance to the nearest joint."
    )
    simplified_frames: int = Field(
        16,
        ge=0,
        le=10**4,
        description="Frames, spread over the clips, whose simplified meshes draw the anchors to folds and borders "
        "(equation 12); 0 leaves the anchors where k-means puts them.",
    )
    width: int = Field(256, ge=1, le=4096, description="Of the recurrent layers and of both MLPs.")
    layers: int = Field(2, ge=1, le=8, description="Recurrent (GRU) layers.")
    initial_state_std: Ratio = Field(
        0.1,
        ge=0,
        le=10,
        description="Standard deviation of the recurrent layers' first state in training; 0 in prediction.",
    )
    laplacian: Ratio = Field(0.2, ge=0, le=1e4, description="β1 of equation 8.")
    collision: Ratio = Field(1.0, ge=0, le=1e4, description="β2 of equation 8.")
    collision_margin_m: Metres = Field(
        0.002, ge=0, le=0.1, description="How far in front of the body the collision term wants vertices."
    )
    consistency: Ratio = Field(1.0, ge=0, le=1e4, description="λ1 of equation 15.")
    normal: Ratio = Field(0.1, ge=0, le=1e4, description="Of the normals in equation 10.")
    direction: Ratio = Field(0.01, ge=0, le=1e4, description="λ2 of equation 15.")
    chamfer: Ratio = Field(100.0, ge=0, le=1e4, description="λ3 of equation 15.")
    steps: int = Field(
        1250,
        ge=1,
        le=10**7,
        description="Of the optimiser; the paper's 50 epochs are this many on 6,000 frames.",
    )
    sequences: int = Field(8, ge=1, le=1024, description="Pieces of clips in a batch.")
    frames: int = Field(30, ge=1, le=10**4, description="Of such a piece.")
    learning_rate: Ratio = Field(1e-3, gt=0, le=1, description="Until `lower_rate_at`, then a tenth of it.")
    lower_rate_at: Ratio = Field(0.6, ge=0, le=1, description="Part of the steps at which the rate falls.")
    late_terms_at: Ratio = Field(
        0.8,
        ge=0,
        le=1,
        description="Part of the steps at which the collision and direction terms begin, and the vertices' nearest "
        "anchors are taken anew.",
    )
    weight_decay: Ratio = Field(0.0, ge=0, le=10, description="AdamW's; the paper has none.")
