"""A body of which only a mesh sequence is known."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from imgtransfer.data.clip_parts import Skeleton
from imgtransfer.data.grid import round_to_grid
from imgtransfer.garments.config import GarmentConfig, TemplateConfig, garment_fingerprint
from imgtransfer.garments.garment import template_garment
from imgtransfer.importers.checks.axes import Axes
from imgtransfer.importers.checks.weld import seam_groups
from imgtransfer.simulation.body_motion.body_sequence import BodySequence
from imgtransfer.simulation.body_motion.dressed_body import BodyMotion, DressedBody, warm_up_fractions
from imgtransfer.simulation.body_motion.shape_interpolation import ShapeInterpolation
from imgtransfer.simulation.body_motion.skin import SkinPoints, covered_skin
from imgtransfer.simulation.config import SimulateConfig
from render import InputError, Mesh, Option
from render.mesh.rigid import heading, rigid_rotation


class MeshBodyMotion(BodyMotion):
    """A mesh sequence: between frames the skin moves on straight lines, and pinned vertices with the skin below them.

    From the rest pose the body comes to its first frame by Poisson shape interpolation. Where on the floor it stands
    and where it faces then has no part in that: the cloth would only be flung about.

    Raises:
        InputError: files that cannot be read, or a garment that does not fit.
    """

    def __init__(self, sequence: BodySequence, config: SimulateConfig) -> None:
        sampled = sequence.read()
        body = sampled.sequence
        self.name, self.fps = sequence.name, sequence.fps
        key = _Rest(sampled.rest_content, body.mesh, sequence.settings.axes)
        self.dressed, self._pinned = _dressed(key, config.garment, garment_fingerprint(config.garment))
        rest = body.mesh.vertices
        vertices = body.vertices()
        self._heading = heading(rigid_rotation(rest, vertices[0].astype(np.float64)))
        self._centres = rest.mean(axis=0), vertices[0].mean(axis=0, dtype=np.float64)
        own = ((vertices - self._centres[1]) @ self._heading + self._centres[0]).astype(np.float32)
        interpolation = ShapeInterpolation(rest, own[0], body.faces, same=seam_groups(body.mesh))
        fractions = warm_up_fractions(config.solver, self.fps)
        warm_up = [interpolation.at(fraction).astype(np.float32) for fraction in fractions[:-1]]
        self.start = len(warm_up)
        self._keys = np.concatenate([np.stack(warm_up), own])
        self._body = round_to_grid(vertices)

    @property
    def skin(self) -> np.ndarray:
        return self._keys[:, self.dressed.covered]

    def between(self, number: int, substeps: int) -> tuple[np.ndarray, np.ndarray]:
        fraction = (np.arange(1, substeps + 1, dtype=np.float32) / substeps)[:, None, None]
        skin = (1 - fraction) * self._keys[number - 1] + fraction * self._keys[number]
        return skin, self._pinned.at(skin)

    @property
    def body(self) -> np.ndarray:
        return self._body

    def placed(self, vertices: np.ndarray) -> np.ndarray:
        return ((vertices - self._centres[0]) @ self._heading.T + self._centres[1]).astype(np.float32)

    def skeleton(self) -> Skeleton:
        return Skeleton()

    def info(self) -> dict[str, str]:
        return {
            "source": f"imgtransfer simulate, body mesh sequence {self.name}",
            "body": f"mesh sequence {self.name}",
        }


def needs_template(garment: GarmentConfig) -> str:
    """What is said of a garment that cannot be made for a body without a skeleton."""
    return (
        f"a {garment.kind} cannot be cut for a body mesh sequence, which has no skeleton; give your own garment by "
        f"{Option('template')} FILE, or by `garment: {{kind: template, path: FILE}}` in the configuration"
    )


@dataclass(frozen=True)
class _Rest:
    """A body at rest, known by what its file holds: sequences of one body share what is made for it."""

    content: str
    mesh: Mesh = field(compare=False)
    axes: Axes


@lru_cache(maxsize=4)
def _dressed(body: _Rest, kind: GarmentConfig, fingerprint: str) -> tuple[DressedBody, SkinPoints]:
    """The garment on the body, and its pinned vertices as points of the skin; `fingerprint` is the garment file's."""
    if not isinstance(kind, TemplateConfig):
        raise InputError(needs_template(kind))
    garment, _ = template_garment(body.mesh, kind, body_axes=body.axes)
    rest, mesh = body.mesh.vertices.astype(np.float32), garment.mesh
    dressed = DressedBody(rest, body.mesh.faces.astype(np.int32), garment, covered_skin(mesh.vertices, rest))
    return dressed, SkinPoints(mesh.vertices[garment.pinned], rest, body.mesh.faces)
