"""The garments' parameters. Lengths are metres; what is a ratio says of what."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, model_validator

from imgtransfer.importers.checks.axes import UNITS, Axes, usual_facing
from imgtransfer.importers.job import clip_name
from imgtransfer.running.fingerprint import files_fingerprint

NAME = r"^[\w-][\w.-]*$"  # of a garment in a data set
Detail = Literal["full", "small"]


class _Garment(BaseModel):
    """What every garment made by the project has."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    # Edge length, metres, by `detail`: near the public sets' resolution, and for work on CPUs.
    edge_lengths: ClassVar[dict[Detail, float]]

    detail: Detail = "full"
    edge_length: float | None = Field(None, gt=0.005, lt=0.1)  # metres; in place of what `detail` says
    smoothing: float = Field(0.025, gt=0.0, lt=0.1)  # metres, how far hollows of the body are bridged

    @property
    def title(self) -> str:
        """What data sets and messages call the garment."""
        return str(self.kind)  # type: ignore[attr-defined]  # every garment has one

    @property
    def target_edge(self) -> float:
        """The wanted edge length, metres."""
        return self.edge_lengths[self.detail] if self.edge_length is None else self.edge_length


class _Upper(_Garment):
    """A garment that hangs from the shoulders: openings at the neck, two sleeves and the hem."""

    ease: float = Field(0.022, gt=0.005, lt=0.1)  # metres to the (smoothed) body
    length: float = Field(0.06, ge=-0.3, le=0.95)  # hem, share of the way from the hip joints to the ankles
    flare: float = Field(0.04, ge=0.0, le=0.8)  # ease gained, metres a metre, below the chest or the waist
    sleeve: float = Field(0.28, ge=0.12, le=0.92)  # share of the arm, shoulder to wrist, that is covered
    neck: float = Field(0.02, ge=0.0, le=0.15)  # metres from the base of the neck down to the neckline


class TShirtConfig(_Upper):
    """A T-shirt."""

    edge_lengths: ClassVar[dict[Detail, float]] = {"full": 0.0127, "small": 0.0192}

    kind: Literal["tshirt"] = "tshirt"


class DressConfig(_Upper):
    """A dress, flared from the waist."""

    edge_lengths: ClassVar[dict[Detail, float]] = {"full": 0.0103, "small": 0.0275}

    kind: Literal["dress"] = "dress"
    length: float = Field(0.48, ge=0.05, le=0.95)
    flare: float = Field(0.20, ge=0.0, le=0.8)
    sleeve: float = Field(0.20, ge=0.12, le=0.92)
    neck: float = Field(0.03, ge=0.0, le=0.15)


class _Lower(_Garment):
    """A garment that hangs from the waist."""

    ease: float = Field(
        0.022, gt=0.005, lt=0.1
    )  # metres to the body, from a hand's width below the waistband
    waist_ease: float = Field(0.008, ge=0.005, lt=0.05)  # metres to the body at the waistband
    waist: float = Field(0.0, ge=-0.15, le=0.08)  # metres from the natural waist up to the waistband


class SkirtConfig(_Lower):
    """A skirt, flared from the waistband."""

    edge_lengths: ClassVar[dict[Detail, float]] = {"full": 0.0129, "small": 0.022}

    kind: Literal["skirt"] = "skirt"
    length: float = Field(0.45, ge=0.05, le=0.95)  # hem, share of the way from the hip joints to the ankles
    flare: float = Field(0.20, ge=0.0, le=0.8)  # ease gained, metres a metre


class TrousersConfig(_Lower):
    """Trousers, or shorts."""

    edge_lengths: ClassVar[dict[Detail, float]] = {"full": 0.0129, "small": 0.024}

    kind: Literal["trousers"] = "trousers"
    length: float = Field(0.93, ge=0.15, le=0.97)  # hems, share of the way from the hip joints to the ankles
    flare: float = Field(0.03, ge=0.0, le=0.3)  # ease gained, metres a metre, below the hip joints
    smoothing: float = Field(0.012, gt=0.0, lt=0.05)  # metres, how far hollows of the body are bridged


AxisName = Literal["x", "y", "z", "-x", "-y", "-z"]


class MeshFile(BaseModel):
    """How the coordinates of a mesh file lie."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    up: AxisName = "y"  # the file's axis that points up
    facing: AxisName | None = None  # the one that the body faces; None is z, or -y where z is up
    unit: Literal["m", "cm", "mm", "dm", "in", "ft"] = "m"  # of the file
    scale: float | None = Field(None, ge=1e-6, le=1e6)  # metres a unit of the file, in place of `unit`
    weld: bool = False  # join seams that the file has split

    @model_validator(mode="after")
    def _two_axes(self) -> MeshFile:
        if self.facing is not None and self.up[-1] == self.facing[-1]:
            raise ValueError(f"up is {self.up} and facing {self.facing}; they must be different axes")
        if self.scale is not None and "unit" in self.model_fields_set:
            raise ValueError("unit and scale say the same; give one of them")
        return self

    @property
    def axes(self) -> Axes:
        """The same as the importers have it."""
        scale = UNITS[self.unit] if self.scale is None else self.scale
        return Axes(self.up, self.facing or usual_facing(self.up), scale)


class TemplateConfig(MeshFile):
    """The user's own garment mesh, made for the body that it is simulated on; outputs have its file's vertices."""

    kind: Literal["template"] = "template"
    path: Path
    pinned: bool = False  # whether the topmost opening is a waistband, which stays where it is on the skin
    anyway: bool = False  # take it although the checks of the mesh found something
    name: str | None = Field(None, pattern=NAME)  # of the garment in data sets; from the file's name if None

    @property
    def title(self) -> str:
        """What data sets and messages call the garment."""
        return self.name or clip_name(self.path.stem, "").partition("/")[0]


def _kind(value: Any) -> str:
    """The discriminator of `GarmentConfig`; a garment without a kind is a T-shirt."""
    return str(value.get("kind", "tshirt") if isinstance(value, dict) else getattr(value, "kind", value))


MadeConfig = TShirtConfig | DressConfig | TrousersConfig | SkirtConfig
GarmentConfig = Annotated[
    Annotated[TShirtConfig, Tag("tshirt")]
    | Annotated[DressConfig, Tag("dress")]
    | Annotated[TrousersConfig, Tag("trousers")]
    | Annotated[SkirtConfig, Tag("skirt")]
    | Annotated[TemplateConfig, Tag("template")],
    Discriminator(_kind),
]


def garment_fingerprint(garment: GarmentConfig) -> str:
    """A text that changes with what a garment's own mesh file holds; "" for garments that the project makes."""
    return files_fingerprint([garment.path]) if isinstance(garment, TemplateConfig) else ""
