"""Which body a simulation is run on."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from imgtransfer.bodies.anny import load_body
from imgtransfer.bodies.shape import AnnyShape, random_shape
from imgtransfer.bodies.skinned import SkinnedBody
from imgtransfer.bodies.smpl_model import load_smpl
from imgtransfer.config.schema import Ratio, Section


class AnnyConfig(Section):
    """The body that ships with the project: its default shape, one by parameters, or one by seed."""

    kind: Literal["anny"] = Field("anny", description="The body that ships with the project.")
    shape: AnnyShape | None = Field(
        None, description="Its shape by Anny's phenotype parameters; null is the default shape."
    )
    seed: int | None = Field(
        None, ge=0, lt=2**63, description="Of a random adult, in place of `shape`; null draws none."
    )

    @model_validator(mode="after")
    def _one_of_both(self) -> AnnyConfig:
        if self.shape is not None and self.seed is not None:
            raise ValueError("either a shape or a seed is wanted, found both")
        return self

    @property
    def title(self) -> str:
        """A short name for clips and messages; empty for the default shape."""
        if self.seed is not None:
            return f"anny{self.seed}"
        changed = {} if self.shape is None else self.shape.model_dump(exclude_defaults=True)
        return "-".join(f"{name}{round(100 * value)}" for name, value in changed.items())

    @property
    def reference(self) -> AnnyConfig:
        """The same body in its default shape."""
        return AnnyConfig()


class SmplConfig(Section):
    """A SMPL body from the user's own model files."""

    kind: Literal["smpl"] = Field("smpl", description="A SMPL body from your own model files.")
    path: Path = Field(description="A model file (.npz or .pkl), or the folder of such.")
    gender: Literal["female", "male", "neutral"] = Field("neutral", description="Which file of a folder.")
    betas: tuple[Ratio, ...] = Field((), description="Shape coefficients; those that are not given are 0.")

    @property
    def title(self) -> str:
        """A short name for clips and messages."""
        return "-".join([self.path.stem, *(f"{beta:g}" for beta in self.betas)])

    @property
    def reference(self) -> SmplConfig:
        """The same body in its default shape."""
        return self.model_copy(update={"betas": ()})


MOST_BODIES = 10_000  # of one entry


class DrawnBodies(Section):
    """Random adults, one for each of the seeds from `seed` to `last_seed`."""

    kind: Literal["drawn"] = Field("drawn", description="Bodies drawn at random.")
    seed: int = Field(0, ge=0, lt=2**63, description="Of the first body.")
    last_seed: int = Field(ge=0, lt=2**63, description="Of the last body.")

    @model_validator(mode="after")
    def _ordered(self) -> DrawnBodies:
        if self.last_seed < self.seed:
            raise ValueError(f"last_seed {self.last_seed} is less than seed {self.seed}")
        if self.last_seed - self.seed >= MOST_BODIES:
            raise ValueError(f"seeds {self.seed} to {self.last_seed} are more than {MOST_BODIES} bodies")
        return self

    def bodies(self) -> tuple[AnnyConfig, ...]:
        """The bodies, by seed."""
        return tuple(AnnyConfig(seed=seed) for seed in range(self.seed, self.last_seed + 1))


def _kind(value: Any) -> str:
    """The discriminator of bodies' settings; a body without a kind is Anny."""
    return str(value.get("kind", "anny") if isinstance(value, dict) else getattr(value, "kind", value))


BodyConfig = Annotated[
    Annotated[AnnyConfig, Tag("anny")] | Annotated[SmplConfig, Tag("smpl")], Discriminator(_kind)
]
# What a list of bodies may hold.
ListedBodies = Annotated[
    Annotated[AnnyConfig, Tag("anny")]
    | Annotated[SmplConfig, Tag("smpl")]
    | Annotated[DrawnBodies, Tag("drawn")],
    Discriminator(_kind),
]


@lru_cache(maxsize=8)
def make_body(config: BodyConfig | None = None) -> SkinnedBody:
    """The body that `config` describes; None is Anny's default shape.

    Raises:
        InputError: a model file that is missing or not usable.
    """
    if isinstance(config, SmplConfig):
        return load_smpl(config.path, betas=config.betas, gender=config.gender)
    if config is None:
        return load_body()
    return load_body(config.shape if config.seed is None else random_shape(config.seed))
