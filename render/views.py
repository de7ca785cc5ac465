"""Which sides a garment is looked at from: the one notation that configurations and commands share."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from render.errors import InputError

# Azimuths in degrees: from the front (+z), on which the body looks, towards the person's left (+x).
SIDES = {"front": 0.0, "left": 90.0, "back": 180.0, "right": -90.0}
AUTO = "auto"
UV = "uv"  # what the one image of a layout is called, which is no view (`render.maps.layout`)
FOUR = tuple((SIDES[side], None) for side in ("front", "back", "left", "right"))
HOW_TO_NAME_VIEWS = (
    f"{', '.join(SIDES)}, AZIMUTH/ELEVATION in degrees such as 45/20, AZIMUTH/auto, four, or ring:N"
)

ViewsSpec = str | Sequence[str | Sequence[float]]


@dataclass(frozen=True)
class View:
    """Where a camera stands, seen from the garment.

    Args:
        azimuth: degrees about the vertical, in (-180, 180]: 0 is the front, 90 the person's left.
        elevation: degrees above the horizontal, -90 to 90; None leaves it to `render.framing` to choose for a
            template.
    """

    azimuth: float
    elevation: float | None = 0.0

    @property
    def name(self) -> str:
        """What the view is called, and what `parse_views` reads as this view again: "left", "45/20"."""
        if self.elevation == 0:
            for side, azimuth in SIDES.items():
                if azimuth == self.azimuth:
                    return side
        return f"{_digits(self.azimuth)}/{AUTO if self.elevation is None else _digits(self.elevation)}"

    def rotation(self) -> np.ndarray:
        """(3, 3) float64, world to camera axes: rows are right, up and backward (towards the camera).

        Raises:
            ValueError: the elevation has not been chosen.
        """
        if self.elevation is None:
            raise ValueError(f"the elevation of view {self.name} has not been chosen")
        sin_a, cos_a = _sine_cosine(self.azimuth)
        sin_e, cos_e = _sine_cosine(self.elevation)
        backward = np.array([sin_a * cos_e, sin_e, cos_a * cos_e])
        right = np.array([cos_a, 0.0, -sin_a])
        return np.stack([right, np.cross(backward, right), backward])


def parse_views(spec: ViewsSpec) -> tuple[View, ...]:
    """The views that a configuration or a command names.

    `front`, `back`, `left` and `right` are level sides; `45/20` stands 45 degrees towards the person's left of
    the front and 20 degrees above the horizontal; `90/auto` at the height from which it shows most of what the
    other views do not; `four` is the four sides, each at such a height; `ring:N` are N level views around the
    vertical, the first one the front.

    Args:
        spec: the views separated by commas, or a sequence of them, in which azimuth and elevation may also be
            a pair of numbers.

    Returns:
        The views in the order given, one or more.

    Raises:
        InputError: something that is no view, a view twice, or none at all.
    """
    if not isinstance(spec, str) and not all(isinstance(entry, str | Sequence) for entry in spec):
        raise InputError(f"views must be names or pairs [azimuth, elevation]; found {list(spec)}")
    entries = spec.split(",") if isinstance(spec, str) else spec
    views = [view for entry in entries for view in _entry(entry)]
    names = [view.name for view in views]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"views must be different from one another; {', '.join(twice)} is there twice")
    if not views:
        raise InputError(f"views must be at least one out of {HOW_TO_NAME_VIEWS}")
    return tuple(views)


def _entry(entry: str | Sequence[float]) -> list[View]:
    if not isinstance(entry, str):
        pair = [float(angle) for angle in entry if isinstance(angle, int | float)]
        if len(pair) != 2 or len(entry) != 2:
            raise InputError(f"views: a pair [azimuth, elevation] in degrees is wanted, found {entry}")
        return [_checked(pair[0], pair[1], str(entry))]
    text = entry.strip()
    if text in SIDES:
        return [View(SIDES[text])]
    if text == "four":
        return [View(*place) for place in FOUR]
    if text.startswith("ring:"):
        return _ring(text)
    azimuth, _, elevation = text.partition("/")
    try:
        angles = float(azimuth), None if elevation == AUTO else float(elevation)
    except ValueError as error:
        raise InputError(f"views must be out of {HOW_TO_NAME_VIEWS}; found '{text}'") from error
    return [_checked(*angles, text)]


def _ring(text: str) -> list[View]:
    count = text.removeprefix("ring:")
    if not count.isdecimal() or not 1 <= int(count) <= 360:
        raise InputError(f"views: ring:N needs a whole number of cameras from 1 to 360, found '{text}'")
    return [_checked(360 * i / int(count), 0.0, text) for i in range(int(count))]


def _checked(azimuth: float, elevation: float | None, text: str) -> View:
    if not math.isfinite(azimuth) or not (elevation is None or -90 <= elevation <= 90):
        raise InputError(
            f"views: '{text}' must be AZIMUTH/ELEVATION in degrees, the elevation from -90 to 90 or {AUTO}"
        )
    turned = 180 - (180 - float(azimuth)) % 360  # to (-180, 180]
    return View(turned + 0.0, None if elevation is None else float(elevation) + 0.0)  # + 0.0: no minus zero


def _digits(angle: float) -> str:
    """Every digit that it takes to read the same number again, and no more."""
    return np.format_float_positional(angle, trim="-")


def _sine_cosine(degrees: float) -> tuple[float, float]:
    """Exact at multiples of 90 degrees, so that level sides have axes without rounding."""
    quarters, rest = divmod(degrees, 90)
    sine, cosine = math.sin(math.radians(rest)), math.cos(math.radians(rest))
    return ((sine, cosine), (cosine, -sine), (-sine, -cosine), (-cosine, sine))[int(quarters) % 4]
