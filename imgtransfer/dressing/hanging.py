"""The project's garments as they hang on the resting body, ready made: cut and settled by `imgtransfer.dressing.build`.

They settle for 0.8 s, as the sample data's do. Garments are cut by gpytoolbox and settle in the simulator, both of
the extra `simulate`; what ships with the package needs neither. On another shape of the body, the pattern is
refitted, and each vertex moved from it as on the default shape: 3 to 16 mm, root mean square, off the garment that
settles there, which lies 21 to 72 mm off its pattern (four garments on three shapes).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.resources import as_file, files

import numpy as np

from fusion import BodySdf
from imgtransfer.bodies.config import AnnyConfig, BodyConfig, make_body
from imgtransfer.garments.config import GarmentConfig, MadeConfig, TemplateConfig
from imgtransfer.garments.figure import Figure
from imgtransfer.garments.garment import refitted_garment
from imgtransfer.simulation.quality import push_out
from render.files.npz import read_npz
from render.mesh.mesh import Mesh

GARMENTS_FILE = "garments.npz"


@dataclass(frozen=True, eq=False)
class Hanging:
    """A garment on the default body.

    Args:
        pattern, settled: (N, 3) float32 metres: as it is put on, and as it hangs. faces: (F, 3) int64.
    """

    pattern: np.ndarray
    settled: np.ndarray
    faces: np.ndarray


def ships(garment: GarmentConfig, body: BodyConfig) -> bool:
    """Whether a garment comes with the package, on every shape of this body."""
    if isinstance(garment, TemplateConfig) or not isinstance(body, AnnyConfig):
        return False
    return garment.model_copy(update={"name": None}) == type(garment)(detail="small")


def hanging_garment(garment: MadeConfig, body: AnnyConfig) -> Mesh:
    """A garment that ships, as it hangs on a shape of the body, outside it.

    Raises:
        InputError: the body's shape leaves no clean surface.
    """
    stored = _hanging(garment.kind)
    if body == body.reference:
        return Mesh(stored.settled.astype(np.float64), stored.faces, garment.title)
    like, wearer = make_body(body.reference), make_body(body)
    pattern = Mesh(stored.pattern.astype(np.float64), stored.faces, garment.title)
    refitted = refitted_garment(pattern, Figure.of(like), wearer, garment).mesh
    hangs = (refitted.vertices + (stored.settled - stored.pattern)).astype(np.float32)
    sdf = BodySdf(wearer.faces, len(wearer.rest))
    sdf.update(wearer.rest)
    return Mesh(push_out(hangs, sdf)[0].astype(np.float64), stored.faces, garment.title)


@cache
def _hanging(kind: str) -> Hanging:
    with as_file(files("imgtransfer.dressing") / GARMENTS_FILE) as path:
        arrays = read_npz(path)
    return Hanging(
        arrays[f"{kind}_pattern"], arrays[f"{kind}_settled"], arrays[f"{kind}_faces"].astype(np.int64)
    )
