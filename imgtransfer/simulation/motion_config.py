"""Which motions `imgtransfer simulate` takes: of the library, from motion files, from body mesh sequences."""

from __future__ import annotations

import fnmatch
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from imgtransfer.bodies.smpl import JOINTS
from imgtransfer.config.schema import (
    Degrees,
    DegreesPerSecond,
    FramesPerSecond,
    MetresPerSecond,
    Ratio,
    Seconds,
    Section,
)
from imgtransfer.garments.config import AxisName, MeshFile, UnitName
from imgtransfer.importers.checks.axes import UNITS, MotionAxes
from imgtransfer.motions.check import PATH_SPEED, TURNING
from imgtransfer.motions.kinds import KINDS
from imgtransfer.motions.library import make_motion
from imgtransfer.motions.motion import Motion
from imgtransfer.motions.up_axis import UpAxis
from render import InputError
from render.limits import FASTEST, SLOWEST

MOST_CLIPS = 100_000  # of one line
Split = Literal["train", "validation", "test"]

_Tempo = Annotated[Ratio, Field(ge=0.01, le=100)]


class LibraryMotion(Section):
    """Clips from the motion library: one a seed, or one for each of the seeds from `seed` to `last_seed`."""

    motion: str = Field(description=f"Its kind: {', '.join(KINDS)}.")
    seed: int = Field(0, ge=0, lt=2**63, description="What the motion is drawn by.")
    last_seed: int | None = Field(
        None, ge=0, lt=2**63, description="One clip for each seed up to this one; null is `seed` alone."
    )
    tempo: _Tempo | tuple[_Tempo, _Tempo] = Field(
        1.0, description="How many times as fast as usual; a range is drawn from by seed."
    )
    seconds: Seconds = Field(2.5, gt=0, le=3600, description="Duration of a clip.")
    split: Split = Field("train", description="Which split of the data set the clips belong to.")
    garments: tuple[str, ...] = Field(
        (), description="Simulated in these only, named by kind; in all of them if empty."
    )

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


class FileMotions(Section):
    """How motion files given on the command line are treated; clips that no pattern names are for training."""

    test: tuple[str, ...] = Field((), description="Glob patterns of file names without suffix, for testing.")
    validation: tuple[str, ...] = Field((), description="The same, for validation.")
    arms_out: Degrees = Field(
        6.0,
        ge=0,
        le=30,
        description="How far hanging arms are turned away from the trunk, so that cloth has room between them.",
    )
    up_axis: UpAxis = Field(
        "auto", description="Of the files' world; `auto` is the axis along which the body stands."
    )
    joints: dict[str, str] = Field(
        {},
        description="SMPL's joints and what BVH skeletons call them, where their names do not tell, such as "
        "`left_knee: Bone07`.",
    )
    turning: DegreesPerSecond = Field(
        TURNING, gt=0, le=1e9, description="Of a joint; faster motions are left out."
    )
    path_speed: MetresPerSecond = Field(
        PATH_SPEED, gt=0, le=1e9, description="Of the pelvis; faster motions are left out."
    )

    @field_validator("joints")
    @classmethod
    def _of_smpl(cls, joints: dict[str, str]) -> dict[str, str]:
        unknown = [joint for joint in joints if joint not in JOINTS]
        if unknown:
            raise ValueError(f"{unknown[0]!r} is none of SMPL's joints, {', '.join(JOINTS)}")
        return joints

    def split(self, *names: str) -> Split:
        """Which split a motion file belongs to, by its clip's name or its own."""
        named: tuple[tuple[Split, tuple[str, ...]], ...] = (
            ("test", self.test),
            ("validation", self.validation),
        )
        for split, patterns in named:
            if any(fnmatch.fnmatch(name, pattern) for pattern in patterns for name in names):
                return split
        return "train"


class SequenceFiles(MeshFile):
    """How body mesh sequences given on the command line are read; `files` says which split they belong to."""

    fps: FramesPerSecond | None = Field(
        None, ge=SLOWEST, le=FASTEST, description="Of the files; null is what they say themselves, else 30."
    )
    body_rest: Path | None = Field(
        None, description="The body at rest; null is body_rest.obj beside or above the frames."
    )
    body_object: str | None = Field(
        None,
        description="Which mesh of an Alembic or USD file is the body, by name or path; null is the only one.",
    )
    speed: MetresPerSecond = Field(
        30.0, gt=0, le=1e9, description="Of a vertex; faster sequences are left out."
    )
    motion_up: AxisName | None = Field(
        None, description="The frames' axis that points up; null is the rest pose's, `up`."
    )
    motion_facing: AxisName | None = Field(
        None,
        description="The frames' axis that a body at rest would face; null is what goes with their up axis.",
    )
    motion_unit: UnitName | None = Field(None, description="The frames' unit; null is the rest pose's.")

    @model_validator(mode="after")
    def _frames_axes(self) -> SequenceFiles:
        try:
            self.motion_axes.beside(self.axes)
        except InputError as error:
            raise ValueError(str(error)) from error
        return self

    @property
    def motion_axes(self) -> MotionAxes:
        """How the frames lie where it is otherwise than the rest pose."""
        scale = None if self.motion_unit is None else UNITS[self.motion_unit]
        return MotionAxes(self.motion_up, self.motion_facing, scale)
