"""Settings of `jointnet`."""

from __future__ import annotations

from typing import Annotated

from annotated_types import Unit
from pydantic import Field

from imgtransfer.config.schema import Ratio, Section
from imgtransfer.deformers.common.descent_config import VertexDescentConfig
from imgtransfer.deformers.common.virtual_rig import RigConfig


class JointNetConfig(Section):
    """Features of each joint, a sparse association of joints with virtual bones, displacements that are a joint's."""

    rig: RigConfig = Field(RigConfig(), description="The virtual bones (section 3.1).")
    hidden: int = Field(600, ge=1, le=8192, description="Size of each joint's recurrent unit (section 3.2).")
    joint_features: int = Field(
        480, ge=2, le=8192, multiple_of=2, description="K, numbers that tell of each joint's motion."
    )
    bone_layers: tuple[int, ...] = Field(
        (1024, 2048, 1024), max_length=8, description="Widths within F, which moves the bones."
    )
    frequency: Annotated[float, Unit("1/m")] = Field(
        1.0,
        gt=0,
        le=1000,
        description="Standard deviation of the Fourier features' basic frequencies c (equation 3).",
    )
    shapes: int = Field(
        64, ge=1, le=4096, description="|X|, displacement shapes of each joint (section 3.3)."
    )
    shape_layers: tuple[int, ...] = Field(
        (480, 128), max_length=8, description="Widths within the perceptron that blends a joint's shapes."
    )
    dropout: Ratio = Field(
        0.5, ge=0, lt=1, description="Part of the recurrent units hidden in each training step."
    )
    normal_weight: Ratio = Field(
        0.5,
        ge=0,
        le=1e6,
        description="λ_norm, of the difference of normals, beside vertices in cm (equation 6).",
    )
    sparse_weight: Ratio = Field(
        1e-3, ge=0, le=1e6, description="λ_s, of the sum of the association matrix (equations 6 and 8)."
    )
    low: VertexDescentConfig = Field(
        VertexDescentConfig(), description="The first stage, without displacements."
    )
    high: VertexDescentConfig = Field(
        VertexDescentConfig(), description="The second stage, of the whole network."
    )
