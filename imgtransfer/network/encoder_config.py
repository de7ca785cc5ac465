"""Where the image encoder comes from: trained from scratch, or pretrained, in the form of the Hugging Face hub."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from annotated_types import Unit
from pydantic import Discriminator, Field, Tag, model_validator

from imgtransfer.config.schema import Section

MAX_DIM, MAX_DEPTH = 8192, 256


class EncoderConfig(Section):
    """The image encoder shared by garment and body: a vision transformer trained from scratch."""

    kind: Literal["vit"] = Field("vit", description="A vision transformer, trained from scratch.")
    patch: Annotated[Literal[4, 8, 16, 32], Unit("pixels")] = Field(
        16, description="Side of a square patch; the decoder has log2(patch) blocks."
    )
    dim: int = Field(
        768,
        ge=8,
        le=MAX_DIM,
        description="Features of a token; a multiple of 4, of `heads` and of `patch`, and of the refinement's `heads`.",
    )
    depth: int = Field(12, ge=1, le=MAX_DEPTH, description="Transformer blocks.")
    heads: int = Field(12, ge=1, le=256, description="Heads of the attention in a transformer block.")

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


class HubEncoderConfig(Section):
    """A pretrained image encoder: a vision transformer of the DINO families, or a ResNet (section 3.2, appendix C)."""

    kind: Literal["hub"] = Field(
        "hub",
        description="Pretrained weights in the form of the Hugging Face hub; needs `imgtransfer[encoders]`.",
    )
    name: str = Field(
        "facebook/dino-vitb16",
        min_length=1,
        description="Name on the hub, such as facebook/dino-vitb16 (the paper), facebook/dino-vits16, "
        "facebook/dinov2-base, facebook/dinov2-with-registers-base, facebook/dinov3-vitb16-pretrain-lvd1689m or "
        "microsoft/resnet-50; or a folder with its config.json and model.safetensors.",
    )
    trained_blocks: int = Field(
        2,
        ge=0,
        le=MAX_DEPTH,
        description="The last so many blocks are trained, and the final norm; all before them stays as it is.",
    )
    dim: int | None = Field(
        None,
        ge=8,
        le=MAX_DIM,
        description="Project the tokens to so many features, by a layer that is trained; null keeps the encoder's own.",
    )


def _kind(encoder: Any) -> str:
    """The discriminator of encoders' settings; an encoder without a kind is trained from scratch."""
    return str(encoder.get("kind", "vit") if isinstance(encoder, dict) else getattr(encoder, "kind", "vit"))


AnyEncoderConfig = Annotated[
    Annotated[EncoderConfig, Tag("vit")] | Annotated[HubEncoderConfig, Tag("hub")], Discriminator(_kind)
]
