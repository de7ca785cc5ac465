"""Garments drawn at random: a range in place of a size, drawn from by seed."""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag, ValidationError, model_validator

from imgtransfer.config.schema import Metres, Ratio, Section
from imgtransfer.config.validation_messages import first_mistake
from imgtransfer.garments.config import (
    NAME,
    Detail,
    DressConfig,
    MadeConfig,
    SkirtConfig,
    TemplateConfig,
    TrousersConfig,
    TShirtConfig,
    garment_kind,
)

MOST_DRAWS = 10_000  # of one entry
Made = Literal["tshirt", "dress", "trousers", "skirt"]
_KINDS: dict[Made, type[MadeConfig]] = {
    "tshirt": TShirtConfig,
    "dress": DressConfig,
    "trousers": TrousersConfig,
    "skirt": SkirtConfig,
}
# Every size has its own place in the random numbers of a draw, so that a range more or less changes no other size.
_SIZES = ("ease", "length", "flare", "sleeve", "neck", "waist", "waist_ease", "smoothing")
_DIGITS = 4  # of a drawn size after the point: tenths of a millimetre
_AS_KIND = "As `{}` of the kind, or a range that is drawn from; null is the kind's default."

# What any kind takes; a kind's own limits are checked with it.
_Ease = Annotated[Metres, Field(gt=0.005, lt=0.1)]
_Length = Annotated[Ratio, Field(ge=-0.3, le=0.97)]
_Flare = Annotated[Ratio, Field(ge=0.0, le=0.8)]
_Sleeve = Annotated[Ratio, Field(ge=0.12, le=0.92)]
_Neck = Annotated[Metres, Field(ge=0.0, le=0.15)]
_Waist = Annotated[Metres, Field(ge=-0.15, le=0.08)]
_WaistEase = Annotated[Metres, Field(ge=0.005, lt=0.05)]
_Smoothing = Annotated[Metres, Field(gt=0.0, lt=0.1)]


class DrawnGarments(Section):
    """Garments of one kind whose sizes are drawn by seed: each size is a number, or a range that is drawn from."""

    kind: Literal["drawn"] = Field("drawn", description="Garments drawn at random.")
    of: Made = Field("tshirt", description="Their kind.")
    draws: int = Field(ge=1, le=MOST_DRAWS, description="How many.")
    seed: int = Field(0, ge=0, lt=2**63, description="What their sizes are drawn by.")
    name: str | None = Field(
        None,
        pattern=NAME,
        description="What they are called before their number, as tshirt-03; null is `of`.",
    )
    detail: Detail = Field("full", description="How fine the meshes are.")
    edge_length: Metres | None = Field(
        None, gt=0.005, lt=0.1, description="As `edge_length` of the kind; null is what `detail` says."
    )
    ease: _Ease | tuple[_Ease, _Ease] | None = Field(None, description=_AS_KIND.format("ease"))
    length: _Length | tuple[_Length, _Length] | None = Field(None, description=_AS_KIND.format("length"))
    flare: _Flare | tuple[_Flare, _Flare] | None = Field(None, description=_AS_KIND.format("flare"))
    sleeve: _Sleeve | tuple[_Sleeve, _Sleeve] | None = Field(None, description=_AS_KIND.format("sleeve"))
    neck: _Neck | tuple[_Neck, _Neck] | None = Field(None, description=_AS_KIND.format("neck"))
    waist: _Waist | tuple[_Waist, _Waist] | None = Field(None, description=_AS_KIND.format("waist"))
    waist_ease: _WaistEase | tuple[_WaistEase, _WaistEase] | None = Field(
        None, description=_AS_KIND.format("waist_ease")
    )
    smoothing: _Smoothing | tuple[_Smoothing, _Smoothing] | None = Field(
        None, description=_AS_KIND.format("smoothing")
    )

    @model_validator(mode="after")
    def _in_range(self) -> DrawnGarments:
        for name, (low, high) in self._ranges().items():
            if low > high:
                raise ValueError(f"{name}: a range from less to more is wanted, found [{low:g}, {high:g}]")
        for end in (0, 1):  # what a kind takes is an interval, so that its ends say everything
            sizes = {name: ends[end] for name, ends in self._ranges().items()}
            kind = _KINDS[self.of]
            try:
                kind.model_validate(self._settings(sizes))
            except ValidationError as error:
                raise ValueError(first_mistake(error, kind, self._settings(sizes))[1]) from error
        return self

    def garments(self) -> tuple[MadeConfig, ...]:
        """The garments, `of`-01 and so on; the first are the same however many are drawn."""
        return _drawn(self)

    def _ranges(self) -> dict[str, tuple[float, float]]:
        """The least and the greatest value of every size that is given."""
        given = {name: getattr(self, name) for name in _SIZES}
        return {
            name: size if isinstance(size, tuple) else (size, size)
            for name, size in given.items()
            if size is not None
        }

    def _settings(self, sizes: dict[str, float]) -> dict[str, Any]:
        """What a garment with these sizes is made from."""
        edge = {} if self.edge_length is None else {"edge_length": self.edge_length}
        return {"kind": self.of, "detail": self.detail, **edge, **sizes}

    def draw(self, number: int) -> MadeConfig:
        """Garment `number`, counted from 1."""
        fractions = np.random.default_rng([self.seed, list(_KINDS).index(self.of), number]).random(
            len(_SIZES)
        )
        sizes = {}
        for name, (low, high) in self._ranges().items():
            # Rounded, so that the digits are the same wherever they are computed.
            size = round(low + float(fractions[_SIZES.index(name)]) * (high - low), _DIGITS)
            sizes[name] = min(max(size, low), high)
        name = f"{self.name or self.of}-{number:02d}"
        return _KINDS[self.of].model_validate(self._settings(sizes) | {"name": name})


@lru_cache(maxsize=64)
def _drawn(config: DrawnGarments) -> tuple[MadeConfig, ...]:
    return tuple(config.draw(number) for number in range(1, config.draws + 1))


# What a list of garments may hold.
ListedGarments = Annotated[
    Annotated[TShirtConfig, Tag("tshirt")]
    | Annotated[DressConfig, Tag("dress")]
    | Annotated[TrousersConfig, Tag("trousers")]
    | Annotated[SkirtConfig, Tag("skirt")]
    | Annotated[TemplateConfig, Tag("template")]
    | Annotated[DrawnGarments, Tag("drawn")],
    Discriminator(garment_kind),
]


def interleaved(listed: tuple[ListedGarments, ...]) -> tuple[MadeConfig | TemplateConfig, ...]:
    """All garments of a list, those of every drawn entry spread evenly among the others.

    So motions that take garments in turn meet all kinds, however both are sorted; a list without draws keeps its order.
    """
    placed = []
    for entry in listed:
        garments = entry.garments() if isinstance(entry, DrawnGarments) else (entry,)
        placed += [((number + 0.5) / len(garments), garment) for number, garment in enumerate(garments)]
    return tuple(garment for _, garment in sorted(placed, key=lambda one: one[0]))
