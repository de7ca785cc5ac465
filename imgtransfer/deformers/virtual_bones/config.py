"""Settings of `virtual_bones`."""

from __future__ import annotations

from pydantic import Field

from imgtransfer.config.schema import Ratio, Section
from imgtransfer.deformers.common.descent_config import DescentConfig, VertexDescentConfig
from imgtransfer.deformers.common.virtual_rig import RigConfig


class VirtualBonesConfig(Section):
    """Virtual bones of the training clips, their motion from that of all joints, and displacements of the vertices."""

    rig: RigConfig = Field(RigConfig(), description="The virtual bones.")
    hidden: int = Field(
        600, ge=1, le=8192, description="Size of the recurrent units, of joints and of bones."
    )
    vertex_features: int = Field(
        10,
        ge=1,
        le=256,
        description="Numbers a vertex that the motion of all bones gives the high-frequency stage.",
    )
    edge_features: tuple[int, ...] = Field(
        (8, 16), min_length=1, max_length=8, description="Numbers a vertex after each convolution over edges."
    )
    dropout: Ratio = Field(
        0.5, ge=0, lt=1, description="Part of the recurrent units hidden in each training step."
    )
    low: DescentConfig = Field(DescentConfig(), description="How the motion of the bones is fitted.")
    high: VertexDescentConfig = Field(VertexDescentConfig(), description="How the displacements are fitted.")
