"""What `imgtransfer simulate` reads: garment, cloth, solver, gates and the list of clips."""

from __future__ import annotations

from collections.abc import Collection
from typing import Annotated, Any

from annotated_types import Unit
from pydantic import ConfigDict, Field, model_validator

from imgtransfer.bodies.config import AnnyConfig, BodyConfig, DrawnBodies, ListedBodies
from imgtransfer.config.schema import (
    DependsOn,
    FramesPerSecond,
    Metres,
    MetresPerSecond,
    Percent,
    Ratio,
    Seconds,
    Section,
)
from imgtransfer.garments.config import GarmentConfig, TShirtConfig
from imgtransfer.garments.drawn import DrawnGarments, ListedGarments, interleaved
from imgtransfer.simulation.fabrics import FABRICS, Fabric
from imgtransfer.simulation.motion_config import FileMotions, LibraryMotion, SequenceFiles
from render.limits import FASTEST, SLOWEST

_COTTON = FABRICS["cotton"]
_OF_FABRIC = DependsOn("fabric")


class ClothConfig(Section):
    """Material of the cloth and its contact with the body: those of a fabric, but for the values that are given."""

    fabric: Fabric = Field("cotton", description="Whose values the cloth has where they are not given.")
    density: Annotated[float, Unit("kg/m²"), _OF_FABRIC] = Field(
        _COTTON["density"], gt=0, le=100, description="Mass of an area of the cloth."
    )
    stretch: Annotated[float, Unit("N/m"), _OF_FABRIC] = Field(
        _COTTON["stretch"], gt=0, le=1e9, description="Both Lamé parameters of the membrane."
    )
    bending: Annotated[float, Unit("N·m"), _OF_FABRIC] = Field(
        _COTTON["bending"], ge=0, le=1e3, description="Flexural rigidity."
    )
    stretch_damping: Annotated[Seconds, _OF_FABRIC] = Field(
        _COTTON["stretch_damping"], ge=0, le=1e3, description="Damping relative to `stretch`."
    )
    bending_damping: Annotated[Seconds, _OF_FABRIC] = Field(
        _COTTON["bending_damping"], ge=0, le=1e3, description="Damping relative to `bending`."
    )
    friction: Annotated[Ratio, _OF_FABRIC] = Field(
        _COTTON["friction"], ge=0, le=100, description="Coulomb's coefficient against the skin."
    )
    thickness: Annotated[Metres, _OF_FABRIC] = Field(
        _COTTON["thickness"],
        gt=0,
        le=0.1,
        description="Between vertices and skin: more than the cloth itself, because it keeps faces out of the skin, "
        "too.",
    )
    contact_stiffness: Annotated[float, Unit("N/m")] = Field(
        6000.0, gt=0, le=1e9, description="Of the contact of a vertex with the skin."
    )

    @model_validator(mode="before")
    @classmethod
    def _of_fabric(cls, given: Any) -> Any:
        """Fill in the named fabric's values."""
        if isinstance(given, dict) and given.get("fabric") in FABRICS:
            return {**FABRICS[given["fabric"]], **given}
        return given


class SolverConfig(Section):
    """Time stepping; more substeps and iterations stretch the cloth less and take longer."""

    step_length: Metres = Field(
        0.003,
        gt=0,
        le=10,
        description="How far the skin under the garment may move within a substep, apart from what moves all of it "
        "evenly. Each frame is cut into as many substeps as that takes.",
    )
    min_substeps: int = Field(10, ge=1, le=10**4, description="Substeps of a frame, however slow.")
    max_substeps: int = Field(24, ge=1, le=10**4, description="Substeps of a frame, however fast.")
    iterations: int = Field(4, ge=1, le=10**4, description="Of vertex block descent, a substep.")
    relaxation: Ratio = Field(
        1.5,
        ge=0.5,
        lt=1.9,
        description="Factor on every move of a vertex. 1.5 leaves about half the stretch that 1 does; 2 would not come "
        "to rest.",
    )
    settle_seconds: Seconds = Field(
        4.0,
        ge=0,
        le=600,
        description="For the cloth to come to rest on the resting body; not recorded. After 0.8 s a long skirt still "
        "moves by 2 mm a frame, and how it hangs then is chance.",
    )
    warm_up_seconds: Seconds = Field(
        0.7, gt=0, le=600, description="From the rest pose to the first frame; not recorded."
    )
    self_contact: bool = Field(False, description="Whether the cloth collides with itself.")

    @model_validator(mode="after")
    def _ordered(self) -> SolverConfig:
        if self.min_substeps > self.max_substeps:
            raise ValueError(
                f"min_substeps {self.min_substeps} is more than max_substeps {self.max_substeps}"
            )
        return self

    def finer(self) -> SolverConfig:
        """Twice the substeps, for a second attempt."""
        doubled = {"min_substeps": 2 * self.min_substeps, "max_substeps": 2 * self.max_substeps}
        return self.model_copy(update={"step_length": self.step_length / 2, **doubled})


class GateConfig(Section):
    """What a simulated clip must keep to; otherwise it is tried once more with twice the substeps, then rejected."""

    model_config = ConfigDict(allow_inf_nan=True)  # .inf turns a gate off

    median_stretch: Ratio = Field(0.08, ge=0, description="|Median of edge length / rest length - 1|.")
    p99_stretch: Ratio = Field(1.6, ge=0, description="99th percentile of edge length / rest length.")
    worst_p99_stretch: Ratio = Field(
        2.0,
        ge=0,
        description="The same of a single frame: more where a limb has gone through the cloth, or limbs have "
        "crushed it between them.",
    )
    sunk_percent: Percent = Field(
        6.0, ge=0, description="Vertices inside the body before they are pushed out, frames' mean."
    )
    penetration_percent: Percent = Field(
        0.5, ge=0, description="Vertices still inside the body afterwards, frames' mean."
    )
    crossing_percent: Percent = Field(
        1.0,
        ge=0,
        description="Edges of cloth and body that then pass through a face of the other, of the cloth's edges, "
        "frames' mean. About 0 with edges of 2 cm; coarse cloth spans what it should go around.",
    )
    speed: MetresPerSecond = Field(
        4.0, ge=0, description="By which a vertex may be faster than the fastest point of the body."
    )
    reach: Metres = Field(0.5, ge=0, description="Largest distance of a vertex to the body.")
    energy_spike: Ratio = Field(
        4.0, ge=0, description="Kinetic energy of a frame over that of the frames around it."
    )
    jitter: Metres = Field(
        0.002, ge=0, description="95th percentile of vertices' shaking while the body rests."
    )
    slip: Metres = Field(
        0.15,
        ge=0,
        description="How far the topmost opening may slip over the body, the median of its vertices, in any frame: "
        "more where a neck has slipped off both shoulders.",
    )


class SimulateConfig(Section):
    """A data set to simulate. Unknown keys are refused."""

    model_config = ConfigDict(title="a YAML file such as configs/data/sample.yaml")

    title: str = Field("", description="Of the data set.")
    licence: str = Field("CC0-1.0", description="Of the data set, in words or by its SPDX identifier.")
    source: str = Field("", description="Where body and motions come from, in words.")
    fps: FramesPerSecond = Field(30.0, ge=SLOWEST, le=FASTEST, description="Of the clips.")
    body: BodyConfig = Field(AnnyConfig(), description="The body.")
    garment: GarmentConfig = Field(TShirtConfig(), description="The garment.")
    bodies: tuple[ListedBodies, ...] = Field(
        (), description="Several in place of `body`: worn by these in turn, or by every one (`every_body`)."
    )
    garments: tuple[ListedGarments, ...] = Field(
        (), description="Several in place of `garment`: every motion in each of them, or in them in turn."
    )
    every_garment: bool = Field(
        True, description="Whether every motion is simulated in all `garments`, rather than in them in turn."
    )
    every_body: bool = Field(
        False, description="Whether every motion is simulated on all `bodies`, rather than on them in turn."
    )
    cloth: ClothConfig = Field(
        ClothConfig(), description="The cloth's material and its contact with the body."
    )
    solver: SolverConfig = Field(
        SolverConfig(),
        description="Time stepping; more substeps and iterations stretch the cloth less and take longer.",
    )
    gates: GateConfig = Field(
        GateConfig(),
        description="What a simulated clip must keep to; otherwise it is tried once more with twice the substeps, then "
        "rejected. .inf turns a gate off.",
    )
    files: FileMotions = Field(
        FileMotions(),
        description="Motion files given on the command line; clips that no pattern names are for training.",
    )
    sequences: SequenceFiles = Field(
        SequenceFiles(),
        description="Body mesh sequences given on the command line; `files` says which split they belong to.",
    )
    clips: tuple[LibraryMotion, ...] = Field((), description="Clips from the motion library.")

    @model_validator(mode="after")
    def _garments_known(self) -> SimulateConfig:
        there = [garment.title for garment in self.wardrobe()]
        twice = sorted({title for title in there if there.count(title) > 1})
        if twice:
            raise ValueError(f"garments: two are called {twice[0]}; give them a `name` each")
        for clips in self.clips:
            for name in clips.garments:
                if name not in there:
                    raise ValueError(f"clips.garments: {name} is none of the garments {', '.join(there)}")
        return self

    def wardrobe(self) -> tuple[GarmentConfig, ...]:
        """The garments that motions are simulated in, in the order of their turns."""
        return interleaved(self.garments or (self.garment,))

    def drawn(self) -> frozenset[str]:
        """The titles of those that were drawn at random."""
        draws = [entry.garments() for entry in self.garments if isinstance(entry, DrawnGarments)]
        return frozenset(garment.title for garments in draws for garment in garments)

    def wearers(self) -> tuple[BodyConfig, ...]:
        """The bodies that wear them, in the order of their turns."""
        several = [
            entry.bodies() if isinstance(entry, DrawnBodies) else (entry,)
            for entry in self.bodies or (self.body,)
        ]
        return tuple(body for bodies in several for body in bodies)

    def singles(self, number: int, names: Collection[str] = ()) -> list[SimulateConfig]:
        """The configurations, of one garment and body each, that motion `number` (from 0) is simulated with.

        Args:
            names: of the garments that it may be simulated in; all of them if empty.
        """
        turns = [(number + turn, garment) for turn, garment in enumerate(self.wardrobe())]
        turns = [(turn, garment) for turn, garment in turns if not names or garment.title in names]
        if not self.every_garment:
            # Once all garments had their turn, each gets other bodies than before.
            rounds, place = divmod(number, len(turns))
            turns = [(number + rounds, turns[place][1])]
        bodies = self.wearers()
        several = {"bodies": (), "garments": (), "every_body": False, "every_garment": True}
        chosen = []
        for turn, garment in turns:
            worn_by = bodies if self.every_body else (bodies[turn % len(bodies)],)
            chosen += [
                self.model_copy(update={"garment": garment, "body": body, **several}) for body in worn_by
            ]
        return chosen
