"""Sizes of the transfer network, and the switches beside the paper's form."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from annotated_types import Unit
from pydantic import Field, field_validator, model_validator

from imgtransfer.config.schema import Ratio, Section
from imgtransfer.data.canonical import RootMode
from imgtransfer.network.encoder_config import AnyEncoderConfig, EncoderConfig
from render import parse_views
from render.limits import MAX_LAYERS, MAX_LENGTH
from render.views import UV

_Pixels = Annotated[int, Unit("pixels"), Field(ge=1, le=MAX_LENGTH)]


class MapsConfig(Section):
    """How meshes become images."""

    size: tuple[_Pixels, _Pixels] = Field((256, 256), description="Height and width.")
    views: tuple[str, ...] = Field(
        ("front", "back"),
        description="Where the images are taken from: a list of sides (front, back, left, right) and [azimuth, "
        "elevation] in degrees, or `four`, or `ring:8`; or `uv`, for images of garment and body laid out by xatlas "
        "(table 7; imgtransfer[uv]). `uv` only with `layers: 1`, `network.body: images`, `training.mirror: false`, and "
        "`network.guess: skinning` or `network.target: absolute`.",
    )
    layers: int = Field(
        1,
        ge=1,
        le=MAX_LAYERS,
        description="How many surfaces deep each view is imaged; layers that show nothing of the template are left "
        "out.",
    )
    root: RootMode = Field(
        "root",
        description="What of the root's rotation the canonical frame removes: all of it, or only the heading.",
    )

    @field_validator("views", mode="before")
    @classmethod
    def _known_views(cls, views: Any) -> tuple[str, ...]:
        if not isinstance(views, str | list | tuple):
            raise ValueError(f"views: a name or a list of views is wanted, found {views!r}")
        if views == UV or list(views) == [UV]:
            return (UV,)
        if not isinstance(views, str) and UV in views:
            raise ValueError(f"views: {UV} stands alone, found {list(views)!r}")
        return tuple(view.name for view in parse_views(views))

    @model_validator(mode="after")
    def _one_layer(self) -> MapsConfig:
        if self.laid_out and self.layers > 1:
            raise ValueError(f"views: {UV} has one layer, found {self.layers}")
        return self

    @property
    def laid_out(self) -> bool:
        """Whether the images are of meshes laid out flat, and not of views."""
        return self.views == (UV,)


class HeadConfig(Section):
    """A better first guess, learned in closed form (`network.kernel_head`)."""

    kind: Literal["none", "kernel"] = Field(
        "none",
        description="What corrects the first guess before the networks do: nothing, or a kernel ridge regression from "
        "the body around patches of cloth, fitted at the start of the training. `kernel` only with `body: local`.",
    )
    patches: int = Field(24, ge=1, le=256, description="Patches of cloth, each with a regression of its own.")
    support: int = Field(
        700,
        ge=1,
        le=20_000,
        description="Training frames, evenly spread, mirrored ones among them, that a frame is compared with; all "
        "frames count in the fit. Memory and the model file grow with it.",
    )
    smoothness: Ratio = Field(
        4.0,
        gt=0,
        le=100,
        description="Length of the kernel, in typical distances between frames; the fit of all frames takes half of it "
        "where `choice_steps` is above 0.",
    )
    ridge: Ratio = Field(3e-3, gt=0, le=1e6, description="Strength of the regularisation.")
    choice_steps: int = Field(
        30,
        ge=0,
        le=1000,
        description="Steps of a descent on the error of clips that are left out, from these two values: how much each "
        "ring of places around a patch and each time counts, the strength, and how much the networks that a run begins "
        "with. 0: all count alike.",
    )


class NetworkConfig(Section):
    """One transfer network; the position and the normal network have the same (section 3.2, appendix C)."""

    encoder: AnyEncoderConfig = Field(
        EncoderConfig(), description="The image encoder shared by garment and body."
    )
    blocks: int = Field(4, ge=1, le=256, description="K, the number of refinement blocks.")
    heads: int = Field(
        4, ge=1, le=256, description="Heads of the cross- and self-attention in a refinement block."
    )
    attention: Literal["body", "added", "cross_modal"] = Field(
        "body",
        description="How the garment's tokens get to know of others (table 4): by cross-attention to the body's (the "
        "paper); the body's are added to them and nothing is attended to; or by cross-attention to the body's, then to "
        "the garment's tokens of the other network. Others than `body` only with `body: images`.",
    )
    target: Literal["absolute", "residual"] = Field(
        "absolute",
        description="What the decoder predicts: the garment's image (the paper), or its difference to a first guess "
        "that comes from the posed body's images (`network.base`).",
    )
    frame: Literal["canonical", "body"] = Field(
        "canonical",
        description="The axes of the residual and of the template's offset in the first guess: the canonical frame's, "
        "or frames that turn with the body's surface. `body` only with `target: residual`.",
    )
    guess: Literal["body", "skinning"] = Field(
        "body",
        description="Where the first guess comes from: the body's images, or linear blend skinning of the template "
        "with the weights of the nearest body vertices. With `skinning` and `frame: body` what the decoder predicts is "
        'skinned, too: the garment is learned in the template\'s pose (table 3, "Canonical Image + LBS"). `skinning` '
        "only with `target: residual` and `body: images`, and clips that have skinning.",
    )
    garment: Literal["template", "skinned"] = Field(
        "template",
        description="The garment that the networks are shown: the template (the paper), or the template moved by "
        'linear blend skinning as for `guess` (table 3, "LBS + Image Refine"). `skinned` only with `body: images`, and '
        "clips that have skinning.",
    )
    body: Literal["images", "local"] = Field(
        "images",
        description="How the body is shown: its images in the canonical frame, encoded and attended to (the paper), or "
        "for every patch of cloth how the body around it has moved, in the patch's own axes (`network.local_view`). "
        "`local` only with `target: residual` and `frame: body`, and without `shortcuts`.",
    )
    history_s: tuple[Annotated[float, Unit("s"), Field(gt=0, le=2)], ...] = Field(
        (),
        max_length=8,
        description="How long before each frame the body is shown as well; cloth lags behind. The paper's networks see "
        "single frames. Only with `body: local`.",
    )
    shortcuts: bool = Field(
        False,
        description="Connections past attention and convolutions, which learn slowly (`network.shortcuts`): the body's "
        "tokens and a dense code of its whole image are added to the garment's tokens, and a linear map from tokens "
        "to patches to the decoder's image. Not in the paper.",
    )

    dropout: Ratio = Field(
        0.0,
        ge=0,
        lt=1,
        description="Fraction of what attention and MLPs add to the tokens that a step of the training leaves out, at "
        "random; none in validation and prediction. Against overfitting to few clips.",
    )

    head: HeadConfig = Field(
        HeadConfig(), description="What corrects the first guess before the networks do."
    )

    @model_validator(mode="after")
    def _consistent(self) -> NetworkConfig:
        dim = self.encoder.dim
        if dim is not None and dim % self.heads:
            raise ValueError(f"encoder.dim {dim} must be a multiple of heads ({self.heads})")
        if self.body == "local" and self.encoder.kind != "vit":
            raise ValueError(
                f"body: local needs encoder.kind: vit, found {self.encoder.kind}; it shows the encoder no images"
            )
        if self.target == "absolute" and self.frame == "body":
            raise ValueError(
                "frame: body needs target: residual; an absolute image has no first guess to turn"
            )
        if self.body == "local" and (self.target, self.frame, self.shortcuts) != ("residual", "body", False):
            raise ValueError("body: local needs target: residual, frame: body and shortcuts: false")
        if self.guess == "skinning" and self.target != "residual":
            raise ValueError("guess: skinning needs target: residual; an absolute image has no first guess")
        if self.body == "local" and self.skins:
            raise ValueError("guess: skinning and garment: skinned need body: images")
        if self.body == "local" and self.attention != "body":
            raise ValueError(f"attention: {self.attention} needs body: images")
        if self.head.kind == "kernel" and self.body != "local":
            raise ValueError(
                "head.kind: kernel needs body: local, which tells how the body around patches moves"
            )
        if self.history_s and self.body != "local":
            raise ValueError("history_s needs body: local; body: images shows single frames")
        return self

    @property
    def skins(self) -> bool:
        """Whether the garment moved by linear blend skinning is needed."""
        return self.guess == "skinning" or self.garment == "skinned"

    @property
    def vit(self) -> EncoderConfig:
        """The encoder's sizes where it is trained from scratch, as it always is with `body: local`."""
        assert isinstance(self.encoder, EncoderConfig)
        return self.encoder


def check_laid_out(maps: MapsConfig, network: NetworkConfig, *, mirror: bool) -> None:
    """Raise ValueError where `maps.views: uv` is asked for with what needs views.

    Under a pixel of the garment's layout lies no pixel of the body's, and a chart's mirror image is no other chart.
    """
    if not maps.laid_out:
        return
    if network.body == "local":
        raise ValueError(
            f"maps.views: {UV} needs network.body: images; `local` looks for the body under the garment"
        )
    if network.target == "residual" and network.guess == "body":
        raise ValueError(
            f"maps.views: {UV} needs network.guess: skinning, or network.target: absolute; the body's images give no "
            "first guess there"
        )
    if mirror:
        raise ValueError(f"maps.views: {UV} needs training.mirror: false; a layout has no mirror image")
