"""What `imgtransfer simulate` reads: garment, cloth, solver, gates and the list of clips."""

from __future__ import annotations

import fnmatch
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from imgtransfer.bodies.config import AnnyConfig, BodyConfig
from imgtransfer.config import loader as config
from imgtransfer.garments.config import GarmentConfig, MeshFile, TShirtConfig
from imgtransfer.motions.amass import UpAxis
from imgtransfer.motions.check import PATH_SPEED, TURNING
from imgtransfer.motions.kinds import KINDS
from imgtransfer.motions.library import make_motion
from imgtransfer.motions.motion import Motion
from imgtransfer.simulation.fabrics import FABRICS, Fabric
from render.limits import FASTEST, SLOWEST

_COTTON = FABRICS["cotton"]
MOST_CLIPS = 100_000  # of one line
Split = Literal["train", "validation", "test"]


class _Section(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class ClothConfig(_Section):
    """Material of the cloth and its contact with the body: those of a fabric, but for the values that are given."""

    fabric: Fabric = "cotton"
    density: float = Field(_COTTON["density"], gt=0, le=100)  # kg/m²
    stretch: float = Field(_COTTON["stretch"], gt=0, le=1e9)  # N/m, both Lamé parameters of the membrane
    bending: float = Field(_COTTON["bending"], ge=0, le=1e3)  # N·m, flexural rigidity
    stretch_damping: float = Field(_COTTON["stretch_damping"], ge=0, le=1e3)  # s, relative to `stretch`
    bending_damping: float = Field(_COTTON["bending_damping"], ge=0, le=1e3)  # s, relative to `bending`
    friction: float = Field(_COTTON["friction"], ge=0, le=100)  # Coulomb coefficient against the skin
    # Metres between vertices and skin: more than the cloth itself, because it keeps faces out of the skin, too.
    thickness: float = Field(_COTTON["thickness"], gt=0, le=0.1)
    contact_stiffness: float = Field(6000.0, gt=0, le=1e9)  # N/m per vertex

    @model_validator(mode="before")
    @classmethod
    def _of_fabric(cls, given: Any) -> Any:
        """Fill in the named fabric's values."""
        if isinstance(given, dict) and given.get("fabric") in FABRICS:
            return {**FABRICS[given["fabric"]], **given}
        return given


class SolverConfig(_Section):
    """Time stepping; more substeps and iterations stretch the cloth less and take longer."""

    # How far, metres, the skin under the garment may move within a substep, apart from what moves all of it evenly.
    # Each frame is cut into as many substeps as that takes.
    step_length: float = Field(0.003, gt=0, le=10)
    min_substeps: int = Field(10, ge=1, le=10**4)  # of a frame, however slow
    max_substeps: int = Field(24, ge=1, le=10**4)  # of a frame, however fast
    iterations: int = Field(4, ge=1, le=10**4)  # of vertex block descent, a substep
    # Factor on every move of a vertex. 1.5 leaves about half the stretch that 1 does; 2 would not come to rest.
    relaxation: float = Field(1.5, ge=0.5, lt=1.9)
    settle_seconds: float = Field(0.8, ge=0, le=600)  # the cloth comes to rest on the resting body
    warm_up_seconds: float = Field(0.7, gt=0, le=600)  # from the rest pose to the first frame; not recorded
    self_contact: bool = False  # whether the cloth collides with itself

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


class GateConfig(_Section):
    """What a simulated clip must keep to; otherwise it is tried once more with twice the substeps, then rejected."""

    model_config = ConfigDict(allow_inf_nan=True)  # .inf turns a gate off

    median_stretch: float = Field(0.08, ge=0)  # |median of edge length / rest length - 1|
    p99_stretch: float = Field(1.6, ge=0)  # 99th percentile of edge length / rest length
    # The same of a single frame: more where a limb has gone through the cloth, or limbs have crushed it between them.
    worst_p99_stretch: float = Field(2.0, ge=0)
    sunk_percent: float = Field(6.0, ge=0)  # vertices inside the body before they are pushed out, on average
    penetration_percent: float = Field(0.5, ge=0)  # vertices still inside the body afterwards, frames' mean
    speed: float = Field(4.0, ge=0)  # m/s by which a vertex may be faster than the fastest point of the body
    reach: float = Field(0.5, ge=0)  # metres, the largest distance of a vertex to the body
    energy_spike: float = Field(4.0, ge=0)  # kinetic energy of a frame over that of the frames around it
    jitter: float = Field(0.002, ge=0)  # metres, 95th percentile of vertices' shaking while the body rests


_Tempo = Annotated[float, Field(ge=0.01, le=100)]


class LibraryMotion(_Section):
    """Clips from the motion library: one a seed, or one for each of the seeds from `seed` to `last_seed`."""

    motion: str
    seed: int = Field(0, ge=0, lt=2**63)
    last_seed: int | None = Field(None, ge=0, lt=2**63)
    tempo: _Tempo | tuple[_Tempo, _Tempo] = 1.0  # a range is drawn from by seed
    seconds: float = Field(2.5, gt=0, le=3600)
    split: Split = "train"
    garments: tuple[str, ...] = ()  # simulated in these only, named by kind; in all of them if empty

    @field_validator("motion")
    @classmethod
    def _known(cls, kind: str) -> str:
        if kind not in KINDS:
            raise ValueError(f"not in the library; there are {', '.join(KINDS)}")
        return kind

    @model_validator(mode="after")
    def _ordered(self) -> LibraryMotion:
        if self.last_seed is not None and self.last_seed < self.seed:
            raise ValueError(f"last_seed {self.last_seed} is less than seed {self.seed}")
        if self.last_seed is not None and self.last_seed - self.seed >= MOST_CLIPS:
            raise ValueError(f"seeds {self.seed} to {self.last_seed} are more than {MOST_CLIPS} clips")
        return self

    def motions(self, fps: float) -> list[Motion]:
        """The motions, at `fps`."""
        made = []
        for seed in range(self.seed, (self.seed if self.last_seed is None else self.last_seed) + 1):
            tempo = self.tempo
            if isinstance(tempo, tuple):
                tempo = float(np.random.default_rng([seed, 1]).uniform(*tempo))
            made.append(make_motion(self.motion, seed=seed, tempo=tempo, seconds=self.seconds, fps=fps))
        return made


class FileMotions(_Section):
    """How motion files given on the command line are treated; clips that no pattern names are for training."""

    test: tuple[str, ...] = ()  # glob patterns of file names without suffix
    validation: tuple[str, ...] = ()
    arms_out: float = Field(6.0, ge=0, le=30)  # degrees
    up_axis: UpAxis = "auto"  # of npz files; "auto" looks at which way the body stands
    turning: float = Field(TURNING, gt=0, le=1e9)  # degrees a second of a joint; faster motions are left out
    path_speed: float = Field(PATH_SPEED, gt=0, le=1e9)  # m/s of the pelvis; faster motions are left out

    def split(self, name: str) -> Split:
        """Which split a motion file belongs to."""
        named: tuple[tuple[Split, tuple[str, ...]], ...] = (
            ("test", self.test),
            ("validation", self.validation),
        )
        for split, patterns in named:
            if any(fnmatch.fnmatch(name, pattern) for pattern in patterns):
                return split
        return "train"


class SequenceFiles(MeshFile):
    """How body mesh sequences given on the command line are read; `files` says which split they belong to."""

    fps: float | None = Field(
        None, ge=SLOWEST, le=FASTEST
    )  # of the files; None is what they say themselves, else 30
    body_rest: Path | None = None  # the body at rest; None is body_rest.obj beside or above the frames
    speed: float = Field(30.0, gt=0, le=1e9)  # m/s of a vertex; faster sequences are left out


class SimulateConfig(_Section):
    """A data set to simulate. Unknown keys are refused."""

    title: str = ""
    licence: str = "CC0-1.0"
    source: str = ""
    fps: float = Field(30.0, ge=SLOWEST, le=FASTEST)
    body: BodyConfig = AnnyConfig()
    garment: GarmentConfig = TShirtConfig()
    # Several in place of the one: every motion is simulated in every garment, on the bodies in turn or on every body.
    bodies: tuple[BodyConfig, ...] = ()
    garments: tuple[GarmentConfig, ...] = ()
    every_body: bool = False
    cloth: ClothConfig = ClothConfig()
    solver: SolverConfig = SolverConfig()
    gates: GateConfig = GateConfig()
    files: FileMotions = FileMotions()
    sequences: SequenceFiles = SequenceFiles()
    clips: tuple[LibraryMotion, ...] = ()

    @model_validator(mode="after")
    def _garments_known(self) -> SimulateConfig:
        there = [garment.title for garment in self.garments or (self.garment,)]
        for clips in self.clips:
            for name in clips.garments:
                if name not in there:
                    raise ValueError(f"clips.garments: {name} is none of the garments {', '.join(there)}")
        return self

    def singles(self, number: int) -> list[SimulateConfig]:
        """The configurations, of one garment and body each, that motion `number` (from 0) is simulated with."""
        bodies = self.bodies or (self.body,)
        several = {"bodies": (), "garments": (), "every_body": False}
        chosen = []
        for turn, garment in enumerate(self.garments or (self.garment,)):
            worn_by = bodies if self.every_body else (bodies[(number + turn) % len(bodies)],)
            chosen += [
                self.model_copy(update={"garment": garment, "body": body, **several}) for body in worn_by
            ]
        return chosen


def load_config(path: str | Path | None = None, changes: Sequence[str] = ()) -> SimulateConfig:
    """Read a YAML file, or only `changes`, "section.key=value" each, which replace or add what it says.

    Raises:
        InputError: no such file, not YAML, an unknown key or a value out of range; names the first.
    """
    return config.load_config(
        SimulateConfig, path, changes, wanted="a YAML file such as configs/data/sample.yaml"
    )
