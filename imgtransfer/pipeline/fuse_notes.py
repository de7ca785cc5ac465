"""What is odd about the files that maps are fused with, but no obstacle."""

from __future__ import annotations

import logging

import numpy as np
import torch
from scipy.spatial import cKDTree

from fusion import BodySdf
from imgtransfer.data.canonical import RootFrames
from render import MapFile, MeshSequence, Option

_log = logging.getLogger(__name__)

_APART = 0.4  # metres from the body beyond which half of a garment is not worn by it
_SAMPLES = 500  # pixels that are looked at


def note_apart(maps: MapFile, body: MeshSequence) -> None:
    """Log that a body is not in the garment of the maps in the first frame: its units or axes may be others.

    Args:
        maps: with the first frame. body: in world coordinates, as it was read.

    Raises:
        InputError: a first frame that cannot be read.
    """
    if maps.position is None:
        return
    colours = maps.position[0][maps.mask]
    colours = colours[:: max(1, len(colours) // _SAMPLES)]
    garment = RootFrames(maps.rotation[:1], maps.translation[:1]).to_world(maps.box.decode(colours)[None])[0]
    skin = np.asarray(body.frame(0), np.float64)
    if not len(garment) or np.median(cKDTree(skin).query(garment)[0]) <= _APART:
        return
    sdf = BodySdf(body.faces, len(skin))
    sdf.update(skin)
    distance = float(np.median(np.abs(sdf.distance(torch.from_numpy(garment)).numpy())))
    if distance > _APART:
        size, cloth = (float(np.ptp(points, axis=0).max()) for points in (skin, garment))
        _log.warning(
            "note: %s: the body, %.3g m large, is not in the garment of the maps, %.3g m large, in the first frame: "
            "half of that is more than %.3g m away; see %s, %s and %s",
            body.source,
            size,
            cloth,
            distance,
            Option("unit"),
            Option("up"),
            Option("facing"),
        )
