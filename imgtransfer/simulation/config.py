"""What `imgtransfer simulate` reads: garment, cloth, solver, gates and the list of clips."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from imgtransfer.bodies.config import AnnyConfig, BodyConfig
from imgtransfer.garments.config import GarmentConfig, TShirtConfig
from imgtransfer.motions.kinds import KINDS
from imgtransfer.motions.library import make_motion
from imgtransfer.motions.motion import Motion
from render import InputError

Split = Literal["train", "validation", "test"]


class _Section(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class ClothConfig(_Section):
    """Material of the cloth and its contact with the body; the defaults are a light cotton jersey."""

    density: float = Field(0.18, gt=0)  # kg/m²
    stretch: float = Field(1000.0, gt=0)  # N/m, both Lamé parameters of the membrane
    bending: float = Field(6e-6, ge=0)  # N·m, flexural rigidity
    stretch_damping: float = Field(1e-4, ge=0)  # N·s/m
    bending_damping: float = Field(1e-2, ge=0)  # s, relative to the bending stiffness
    contact_stiffness: float = Field(2000.0, gt=0)  # N/m per vertex
    friction: float = Field(0.3, ge=0)  # Coulomb coefficient against the skin
    thickness: float = Field(0.004, gt=0)  # metres between vertices and skin; keeps faces out of it too


class SolverConfig(_Section):
    """Time stepping; more substeps and iterations stretch the cloth less and take longer."""

    substeps: int = Field(8, ge=1)  # of each frame
    iterations: int = Field(5, ge=1)  # of vertex block descent, a substep
    settle_seconds: float = Field(0.8, ge=0)  # the cloth comes to rest on the resting body
    warm_up_seconds: float = Field(0.7, gt=0)  # from the rest pose to the first frame; not recorded


class GateConfig(_Section):
    """What a simulated clip must keep to; otherwise it is tried once more with twice the substeps, then rejected."""

    median_stretch: float = 0.08  # |median of edge length / rest length - 1|
    p99_stretch: float = 1.6  # 99th percentile of edge length / rest length
    sunk_percent: float = 6.0  # vertices inside the body before they are pushed out, mean over frames
    penetration_percent: float = 0.5  # vertices still inside the body afterwards, mean over frames
    speed: float = 4.0  # m/s by which a vertex may be faster than the fastest point of the body
    reach: float = 0.3  # metres, the largest distance of a vertex to the body


class LibraryMotion(_Section):
    """Clips from the motion library: one a seed, or one for each of the seeds from `seed` to `last_seed`."""

    motion: str
    seed: int = Field(0, ge=0)
    last_seed: int | None = None
    tempo: float | tuple[float, float] = 1.0  # a range is drawn from by seed
    seconds: float = Field(2.5, gt=0)
    split: Split = "train"

    @field_validator("motion")
    @classmethod
    def _known(cls, kind: str) -> str:
        if kind not in KINDS:
            raise ValueError(f"not in the library; there are {', '.join(KINDS)}")
        return kind

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


class SimulateConfig(_Section):
    """A data set to simulate. Unknown keys are refused."""

    title: str = ""
    licence: str = "CC0-1.0"
    source: str = ""
    fps: float = Field(30.0, gt=0)
    body: BodyConfig = AnnyConfig()
    garment: GarmentConfig = TShirtConfig()
    cloth: ClothConfig = ClothConfig()
    solver: SolverConfig = SolverConfig()
    gates: GateConfig = GateConfig()
    files: FileMotions = FileMotions()
    clips: tuple[LibraryMotion, ...] = ()


def load_config(path: str | Path) -> SimulateConfig:
    """Read a YAML file.

    Raises:
        InputError: no such file, not YAML, an unknown key or a value out of range; names the first.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file; a YAML file such as configs/data/sample.yaml is wanted")
    try:
        read = yaml.safe_load(path.read_text())
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not YAML ({' '.join(str(error).split())})") from error
    if not isinstance(read, dict):
        raise InputError(f"{path}: a mapping of settings is wanted, found {type(read).__name__}")
    try:
        return SimulateConfig.model_validate(read)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise InputError(f"{path}: {where}: {first['msg']} ({error.error_count()} such mistakes)") from error
