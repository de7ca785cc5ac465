"""Sizes of the transfer network, and the switches beside the paper's form."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from imgtransfer.data.canonical import RootMode
from render import parse_views
from render.limits import MAX_LAYERS, MAX_LENGTH


class EncoderConfig(BaseModel):
    """The image encoder shared by garment and body.

    `kind` names where the encoder comes from; "vit" is a vision transformer trained from scratch, and the
    only one so far. A pretrained encoder becomes a further literal here and a case in
    `network.vit.build_encoder`.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: Literal["vit"] = "vit"
    patch: Literal[4, 8, 16, 32] = 16
    """Side of a square patch, pixels; the decoder has log2(patch) blocks."""
    dim: int = Field(default=768, ge=8, le=8192)
    depth: int = Field(default=12, ge=1, le=256)
    heads: int = Field(default=12, ge=1, le=256)

    @model_validator(mode="after")
    def _dim_divides(self) -> EncoderConfig:
        if self.dim % self.heads or self.dim % self.patch:
            raise ValueError(
                f"dim {self.dim} must be a multiple of heads ({self.heads}), and of patch ({self.patch}) because "
                "the decoder halves the features log2(patch) times"
            )
        if self.dim % 4:
            raise ValueError(f"dim {self.dim} must be a multiple of 4 (sine and cosine of two grid axes)")
        return self


_Pixels = Annotated[int, Field(ge=1, le=MAX_LENGTH)]


class MapsConfig(BaseModel):
    """How meshes become images."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    size: tuple[_Pixels, _Pixels] = (256, 256)
    """(height, width), pixels."""
    views: tuple[str, ...] = ("front", "back")
    """As `render.parse_views` reads them: a list of sides and [azimuth, elevation], or `four`, or `ring:8`."""
    layers: int = Field(default=1, ge=1, le=MAX_LAYERS)
    """How many surfaces deep each view is imaged; layers that show nothing of the template are left out."""
    root: RootMode = "root"
    """What of the root's rotation the canonical frame removes: all, or only the heading."""

    @field_validator("views", mode="before")
    @classmethod
    def _known_views(cls, views: Any) -> tuple[str, ...]:
        if not isinstance(views, str | list | tuple):
            raise ValueError(f"views: a name or a list of views is wanted, found {views!r}")
        return tuple(view.name for view in parse_views(views))


class NetworkConfig(BaseModel):
    """One transfer network; the position and the normal network have the same (section 3.2, appendix C)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    encoder: EncoderConfig = EncoderConfig()
    blocks: int = Field(default=4, ge=1, le=256)
    """K, the number of refinement blocks."""
    heads: int = Field(default=4, ge=1, le=256)
    """Heads of the cross- and self-attention in a refinement block."""
    target: Literal["absolute", "residual"] = "absolute"
    """What the decoder predicts: the garment's image (the paper), or its difference to a first guess that
    comes from the posed body's images (`network.base`)."""
    frame: Literal["canonical", "body"] = "canonical"
    """The axes of the residual and of the template's offset in the first guess: the canonical frame's, or
    frames that turn with the body's surface. Only for `target: residual`."""

    shortcuts: bool = False
    """Ways past attention and convolutions, which learn slowly (`network.shortcuts`): the body's tokens and a
    dense code of its whole image are added to the garment's tokens, and a linear map from tokens to patches
    to the decoder's image. Not in the paper."""

    @model_validator(mode="after")
    def _consistent(self) -> NetworkConfig:
        if self.encoder.dim % self.heads:
            raise ValueError(f"encoder.dim {self.encoder.dim} must be a multiple of heads ({self.heads})")
        if self.target == "absolute" and self.frame == "body":
            raise ValueError(
                "frame: body needs target: residual; an absolute image has no first guess to turn"
            )
        return self
