"""The garments' parameters. Lengths are metres; what is a ratio says of what."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from annotated_types import Unit
from pydantic import Discriminator, Field, Tag, model_validator

from imgtransfer.config.schema import DependsOn, Metres, Ratio, Section
from imgtransfer.data.schema import valid_clip_name
from imgtransfer.importers.checks.axes import UNITS, Axes, usual_facing
from imgtransfer.running.fingerprint import files_fingerprint
from render.files.scenes.reader import is_scene

NAME = r"^[\w-][\w.-]*$"  # of a garment in a data set
Detail = Literal["full", "small"]
_LENGTH = "Where the hem is, as a fraction of the distance from the hip joints to the ankles."
_SLEEVE = "Fraction of the arm, from shoulder to wrist, that is covered."
_NECK = "From the base of the neck down to the neckline."


class _Garment(Section):
    """What every garment made by the project has."""

    # Edge length, metres, by `detail`: near the public sets' resolution, and for work on CPUs.
    edge_lengths: ClassVar[dict[Detail, float]]

    detail: Detail = Field(
        "full", description="How fine the mesh is: `full` as the public sets' garments, `small` for CPUs."
    )
    edge_length: Metres | None = Field(
        None, gt=0.005, lt=0.1, description="Mean length of the mesh's edges; null is what `detail` says."
    )
    smoothing: Metres = Field(0.025, gt=0.0, lt=0.1, description="How far hollows of the body are bridged.")
    name: str | None = Field(None, pattern=NAME, description="Of the garment in data sets; null is its kind.")

    @property
    def title(self) -> str:
        """What data sets and messages call the garment."""
        return self.name or str(self.kind)  # type: ignore[attr-defined]  # every garment has one

    @property
    def target_edge(self) -> float:
        """The wanted edge length, metres."""
        return self.edge_lengths[self.detail] if self.edge_length is None else self.edge_length


class _Upper(_Garment):
    """A garment that hangs from the shoulders: openings at the neck, two sleeves and the hem."""

    ease: Metres = Field(0.022, gt=0.005, lt=0.1, description="Distance to the (smoothed) body.")
    length: Ratio = Field(0.06, ge=-0.3, le=0.95, description=_LENGTH)
    flare: Ratio = Field(
        0.04, ge=0.0, le=0.8, description="Ease gained, metres a metre, below the chest or the waist."
    )
    sleeve: Ratio = Field(0.28, ge=0.12, le=0.92, description=_SLEEVE)
    neck: Metres = Field(0.02, ge=0.0, le=0.15, description=_NECK)


class TShirtConfig(_Upper):
    """A T-shirt."""

    edge_lengths: ClassVar[dict[Detail, float]] = {"full": 0.0127, "small": 0.0192}

    kind: Literal["tshirt"] = Field("tshirt", description="A T-shirt.")


class DressConfig(_Upper):
    """A dress, flared from the waist."""

    edge_lengths: ClassVar[dict[Detail, float]] = {"full": 0.0103, "small": 0.0275}

    kind: Literal["dress"] = Field("dress", description="A dress, flared from the waist.")
    length: Ratio = Field(0.48, ge=0.05, le=0.95, description=_LENGTH)
    flare: Ratio = Field(0.20, ge=0.0, le=0.8, description="Ease gained, metres a metre, below the waist.")
    sleeve: Ratio = Field(0.20, ge=0.12, le=0.92, description=_SLEEVE)
    neck: Metres = Field(0.03, ge=0.0, le=0.15, description=_NECK)


class _Lower(_Garment):
    """A garment that hangs from the waist."""

    ease: Metres = Field(
        0.022,
        gt=0.005,
        lt=0.1,
        description="Distance to the body, from a hand's width below the waistband.",
    )
    waist_ease: Metres = Field(0.008, ge=0.005, lt=0.05, description="Distance to the body at the waistband.")
    waist: Metres = Field(0.0, ge=-0.15, le=0.08, description="From the natural waist up to the waistband.")


class SkirtConfig(_Lower):
    """A skirt, flared from the waistband."""

    edge_lengths: ClassVar[dict[Detail, float]] = {"full": 0.0129, "small": 0.022}

    kind: Literal["skirt"] = Field("skirt", description="A skirt, flared from the waistband.")
    length: Ratio = Field(0.45, ge=0.05, le=0.95, description=_LENGTH)
    flare: Ratio = Field(
        0.20, ge=0.0, le=0.8, description="Ease gained, metres a metre, below the waistband."
    )


class TrousersConfig(_Lower):
    """Trousers, or shorts."""

    edge_lengths: ClassVar[dict[Detail, float]] = {"full": 0.0129, "small": 0.024}

    kind: Literal["trousers"] = Field("trousers", description="Trousers, or shorts.")
    length: Ratio = Field(0.93, ge=0.15, le=0.97, description=_LENGTH)
    flare: Ratio = Field(
        0.03, ge=0.0, le=0.3, description="Ease gained, metres a metre, below the hip joints."
    )
    smoothing: Metres = Field(0.012, gt=0.0, lt=0.05, description="How far hollows of the body are bridged.")


AxisName = Literal["x", "y", "z", "-x", "-y", "-z"]
UnitName = Literal["m", "cm", "mm", "dm", "in", "ft"]


class MeshFile(Section):
    """How the coordinates of a mesh file lie."""

    up: AxisName = Field("y", description="The file's axis that points up.")
    facing: AxisName | None = Field(
        None, description="The file's axis that the body faces; null is z, or -y where z is up."
    )
    unit: Annotated[UnitName, DependsOn("scale")] = Field(
        "m", description="The file's unit of length; not together with `scale`."
    )
    scale: Annotated[float, Unit("m per unit of the file")] | None = Field(
        None, ge=1e-6, le=1e6, description="In place of `unit`; null is what `unit` says."
    )
    weld: bool = Field(False, description="Join seams that the file has split.")

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
        given = self.model_fields_set & {"up", "facing"}
        given |= {"scale"} if self.model_fields_set & {"unit", "scale"} else set()
        return Axes(self.up, self.facing or usual_facing(self.up), scale, frozenset(given))


class TemplateConfig(MeshFile):
    """The user's own garment mesh, made for the body that it is simulated on; outputs have its file's vertices."""

    kind: Literal["template"] = Field("template", description="Your own garment mesh.")
    path: Path = Field(
        description="The mesh file (OBJ, PLY, GLB, STL, Alembic or USD), in the body's rest pose."
    )
    object: str | None = Field(
        None, description="Which mesh of an Alembic or USD file, by name or path; null is the only one."
    )
    pinned: bool = Field(
        False,
        description="Whether the topmost opening is a waistband, which stays where it is on the skin.",
    )
    anyway: bool = Field(False, description="Take it although the checks of the mesh object to it.")
    name: str | None = Field(
        None, pattern=NAME, description="Of the garment in data sets; null is the file's name."
    )

    @property
    def title(self) -> str:
        """What data sets and messages call the garment."""
        return self.name or valid_clip_name(self.path.stem, "").partition("/")[0]


def garment_kind(value: Any) -> str:
    """The discriminator of garments' settings; a garment without a kind is a T-shirt."""
    return str(value.get("kind", "tshirt") if isinstance(value, dict) else getattr(value, "kind", value))


MadeConfig = TShirtConfig | DressConfig | TrousersConfig | SkirtConfig
GarmentConfig = Annotated[
    Annotated[TShirtConfig, Tag("tshirt")]
    | Annotated[DressConfig, Tag("dress")]
    | Annotated[TrousersConfig, Tag("trousers")]
    | Annotated[SkirtConfig, Tag("skirt")]
    | Annotated[TemplateConfig, Tag("template")],
    Discriminator(garment_kind),
]


def garment_fingerprint(garment: GarmentConfig) -> str:
    """A text that changes with what a garment's own mesh file holds; "" for garments that the project makes."""
    if not isinstance(garment, TemplateConfig):
        return ""
    content = files_fingerprint([garment.path])
    # Such a file says how it lies, so that it matters whether `unit: m` was given or is the default.
    return f"{content} {sorted(garment.axes.given)}" if is_scene(garment.path) else content
