"""A garment on a resting body, and how that body moves: what a simulation needs of whoever wears the garment."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from fusion import BodySdf
from imgtransfer.data.clip_parts import Skeleton
from imgtransfer.garments.garment import Garment
from imgtransfer.simulation.cloth.model import ClothOnBody
from imgtransfer.simulation.config import ClothConfig, SolverConfig
from imgtransfer.simulation.quality import push_out

SETTLE_DAMPING = 0.85  # of velocities, a frame, while the cloth comes to rest


@dataclass(frozen=True, eq=False)
class DressedBody:
    """A garment on its body at rest.

    Args:
        rest: (B, 3) float32 the skin, metres. faces: (G, 3) int32.
        garment: where it is put on.
        covered: (M,) int64, the skin's vertices that the garment covers.
    """

    rest: np.ndarray
    faces: np.ndarray
    garment: Garment
    covered: np.ndarray

    def cloth(self, config: ClothConfig, solver: SolverConfig) -> ClothOnBody:
        """The garment where it is put on, ready to be stepped."""
        return ClothOnBody(
            self.garment.mesh, self.rest, self.faces, config, solver, pinned=self.garment.pinned
        )


class BodyMotion(ABC):
    """How a body moves: from its rest pose to the first frame of a clip, and on to the last.

    It is known at key frames, 1 / `fps` apart, of which the first is the rest pose and number `start` the clip's first
    frame. The cloth is simulated in a frame of the movement's own, in which gravity points down and nothing moves at
    rest; `placed` takes it to the world.
    """

    name: str
    fps: float
    dressed: DressedBody
    start: int

    @property
    @abstractmethod
    def skin(self) -> np.ndarray:
        """(K, M, 3) float32, the covered skin at the key frames."""

    @abstractmethod
    def between(self, number: int, substeps: int) -> tuple[np.ndarray, np.ndarray]:
        """(S, B, 3) skin and (S, H, 3) pinned vertices, float32, at the ends of `substeps` even parts of a movement.

        The movement is that from key frame `number` - 1 to `number`.
        """

    @property
    @abstractmethod
    def body(self) -> np.ndarray:
        """(T, B, 3) float32, the skin in the clip's frames, in the world."""

    @abstractmethod
    def placed(self, vertices: np.ndarray) -> np.ndarray:
        """Cloth (T, N, 3) float32 in the movement's own frame -> in the world."""

    @abstractmethod
    def skeleton(self) -> Skeleton:
        """What a clip stores of the body beside its meshes."""

    @abstractmethod
    def info(self) -> dict[str, str]:
        """What a clip's `info` says of the body: its `source` and `body`."""


def warm_up_fractions(solver: SolverConfig, fps: float) -> np.ndarray:
    """(W,) from 0, the rest pose, to 1, the first frame, slow at both ends."""
    fraction = np.linspace(0, 1, 1 + max(1, round(solver.warm_up_seconds * fps)))
    return fraction * fraction * (3 - 2 * fraction)


@lru_cache(maxsize=4)
def settled(dressed: DressedBody, material: ClothConfig, solver: SolverConfig, fps: float) -> np.ndarray:
    """(N, 3) the cloth at rest on the resting body, outside it; for every clip, hence computed once a process."""
    cloth = dressed.cloth(material, solver)
    for _ in range(round(solver.settle_seconds * fps)):
        for _ in range(solver.min_substeps):
            cloth.step(dressed.rest, 1 / (fps * solver.min_substeps))
        cloth.place(cloth.vertices, SETTLE_DAMPING * cloth.velocities, dressed.rest)
    sdf = BodySdf(dressed.faces, len(dressed.rest))
    sdf.update(dressed.rest)
    return push_out(cloth.vertices, sdf)[0]
