"""Faults of EXR maps: what stands in their headers, and their channels."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tests.bad_inputs.case import Fault

_EYE = np.eye(3)
ATTRIBUTES: dict[str, tuple[str, Any]] = {
    "no-rate": ("fps", "0"),
    "infinite-rate": ("fps", "inf"),
    "rate-in-words": ("fps", "fast"),
    "rate-a-number": ("fps", 30.0),
    "mirrored": ("rotation", np.diag([1.0, 1, -1])),
    "stretched": ("rotation", 1.5 * _EYE),
    "rotation-nan": ("rotation", _EYE * np.nan),
    "rotation-words": ("rotation", "none"),
    "far-away": ("translation", np.array([1e300, 0, 0])),
    "translation-nan": ("translation", np.array([np.nan, 0, 0])),
    "box-nan": ("boxLo", np.array([np.nan, 0, 0])),
    "box-inside-out": ("boxLo", np.array([9.0, 9, 9])),
    "box-infinite": ("boxHi", np.array([np.inf, 9, 9])),
    "box-vast": ("boxHi", np.array([1e300, 1e300, 1e300])),
    "far-frame": ("frame", 999_999),
    "negative-frame": ("frame", -1),
    "far-image": ("image", 999_999),
    "frame-in-words": ("frame", "first"),
    "another-format": ("format", "pictures"),
    "another-version": ("formatVersion", 99),
    "version-in-words": ("formatVersion", "new"),
    "camera-nan": ("viewMatrix", np.full((4, 4), np.nan)),
    "camera-flat": ("projectionMatrix", np.zeros((4, 4))),
    "camera-vast": ("projectionMatrix", np.full((4, 4), 1e200)),
    "layer-deep": ("layer", 10**9),
    "layer-in-words": ("layer", "top"),
    "name-of-control-codes": ("view", "\x1b[31mred\x07"),
    "name-long": ("view", "x" * 5000),
}


def _rewrite(path: Path, change: Callable[[dict[str, Any], dict[str, np.ndarray]], object]) -> None:
    import OpenEXR  # noqa: PLC0415

    with OpenEXR.File(str(path), separate_channels=True) as file:
        header = dict(file.header())
        channels = {name: np.array(channel.pixels) for name, channel in file.channels().items()}
    header = {
        key: value for key, value in header.items() if key not in ("channels", "dataWindow", "displayWindow")
    }
    change(header, channels)
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))


def _attribute(key: str, value: Any) -> Callable[[Path, random.Random], object]:
    return lambda path, _: _rewrite(path, lambda header, channels: header.update({key: value}))


def _lost(path: Path, rng: random.Random) -> None:
    keys = (
        "fps",
        "rotation",
        "translation",
        "view",
        "layer",
        "frame",
        "image",
        "boxLo",
        "viewMatrix",
        "format",
    )
    _rewrite(path, lambda header, channels: header.pop(rng.choice(keys), None))


def _pixels(value: float) -> Callable[[Path, random.Random], object]:
    def spoil(path: Path, rng: random.Random) -> None:
        def change(_: dict[str, Any], channels: dict[str, np.ndarray]) -> None:
            pixels = channels[rng.choice([name for name in channels if name.startswith("position")])]
            rows, columns = np.nonzero(channels["mask"] > 0.5)
            at = rng.randrange(len(rows))
            pixels[rows[at], columns[at]] = value

        _rewrite(path, change)

    return spoil


def _channel_lost(path: Path, rng: random.Random) -> None:
    _rewrite(path, lambda header, channels: channels.pop(rng.choice(sorted(channels))))


def _smaller(path: Path, _: random.Random) -> None:
    def change(header: dict[str, Any], channels: dict[str, np.ndarray]) -> None:
        for name in channels:
            channels[name] = channels[name][:8, :8].copy()

    _rewrite(path, change)


HEADERS = tuple(
    Fault(
        f"exr-{name}",
        _attribute(key, value),
        harmless=name in ("rate-a-number", "name-long", "name-of-control-codes"),
    )
    for name, (key, value) in ATTRIBUTES.items()
)
IMAGES = (
    Fault("exr-attribute-missing", _lost),
    Fault("exr-channel-missing", _channel_lost, harmless=True),
    Fault("exr-size", _smaller),
    Fault("exr-pixel-nan", _pixels(np.nan)),
    Fault("exr-pixel-inf", _pixels(np.inf)),
    Fault("exr-pixel-huge", _pixels(1e30)),
)
