"""What schemas are made of: sections whose keys are all known, numbers with their units, keys that depend on another.

A field is written `name: Unit'sType = Field(default, range, description="...")`; `imgtransfer config` prints all of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Unit
from pydantic import BaseModel, ConfigDict

NO_UNIT = "1"  # of ratios and fractions, as the SI writes it


class Section(BaseModel):
    """A mapping of settings: no key that the schema does not have, no infinite number, never changed."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


@dataclass(frozen=True)
class DependsOn:
    """Marks a field whose default is that of another key, or which excludes the other; printed as a comment while it is
    not set.
    """

    key: str


Ratio = Annotated[float, Unit(NO_UNIT)]
Percent = Annotated[float, Unit("%")]
Metres = Annotated[float, Unit("m")]
MetresPerSecond = Annotated[float, Unit("m/s")]
Degrees = Annotated[float, Unit("degrees")]
DegreesPerSecond = Annotated[float, Unit("degrees/s")]
Seconds = Annotated[float, Unit("s")]
FramesPerSecond = Annotated[float, Unit("frames/s")]
