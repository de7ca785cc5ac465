"""What each term of the fusion is worth (table 5 of the paper): predicted maps, fused with some terms left out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from fusion import FusionConfig, FusionInputs, MapReading, MovingSurface, fuse_maps
from imgtransfer.data.canonical import RootFrames
from imgtransfer.data.clip import Clip
from render import MapFile

_NO_STEPS = {"edge_iterations": 0, "edge_steps": 0, "normal_iterations": 0, "normal_steps": 0}
TERMS: Mapping[str, tuple[dict[str, Any], dict[str, bool]]] = {
    "initialisation": (dict(_NO_STEPS), {"positions_only": True}),
    "edge lengths": ({}, {"positions_only": True}),
    "rendered normals": ({"weight_consistency": 0.0}, {}),
    "full": ({}, {"body": True}),
}
"""By name: changes of the fusion's configuration, and what else it is told. "initialisation" is what the position maps
give; "full" adds normal consistency and the body to the rendered normals."""


def fused_with(maps: MapFile, clip: Clip, terms: str, config: FusionConfig) -> np.ndarray:
    """The garment in the world, (T, N, 3) metres.

    Args:
        maps: predicted, in the canonical frame. clip: with the body that they are of.
        terms: one of `TERMS`, which change `config`.
    """
    changes, told = TERMS[terms]
    settings = FusionConfig.model_validate(config.model_dump() | changes)
    frames = RootFrames(maps.rotation, maps.translation)
    body = None
    if told.get("body"):
        body = MovingSurface(frames.to_canonical(clip.body.vertices), clip.body.faces)
    reading = MapReading(positions_only=told.get("positions_only", False))
    return frames.to_world(fuse_maps(maps, FusionInputs(body=body), settings, reading=reading).vertices)
