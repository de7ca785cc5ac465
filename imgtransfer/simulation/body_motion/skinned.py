"""A body with a skeleton, posed by a motion."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from imgtransfer.bodies.config import BodyConfig, make_body
from imgtransfer.bodies.skinned import BonePoses, SkinnedBody, skinned
from imgtransfer.data.clip_parts import Skeleton
from imgtransfer.data.grid import round_to_grid
from imgtransfer.garments.config import GarmentConfig, garment_fingerprint
from imgtransfer.garments.garment import make_garment
from imgtransfer.motions.motion import Motion
from imgtransfer.simulation.body_motion.dressed_body import BodyMotion, DressedBody, warm_up_fractions
from imgtransfer.simulation.body_motion.skin import covered_skin
from imgtransfer.simulation.config import SimulateConfig


class SkinnedBodyMotion(BodyMotion):
    """The configuration's body in a motion: its bones turn evenly, the skin follows by linear blend skinning.

    The clip is moved so that the root starts where it rests: nothing here needs a floor.

    Raises:
        InputError: a body or a garment that cannot be made.
    """

    def __init__(self, motion: Motion, config: SimulateConfig) -> None:
        self.name, self.fps = motion.name, motion.fps
        self._motion, self._config = motion, config
        self.dressed, self._body, self._weights = dressed_body(
            config.body, config.garment, garment_fingerprint(config.garment)
        )
        body = self._body
        bones = body.bone_poses(motion.poses, motion.trans, leg_length=motion.leg_length)
        self._bones = BonePoses(bones.rotations, bones.root - bones.root[0] + body.joints_rest[0])
        fractions = warm_up_fractions(config.solver, self.fps)[:, None]
        first = _frame(self._bones, 0)
        warm_up = body.interpolate(
            _repeated(body.rest_pose(), len(fractions)), _repeated(first, len(fractions)), fractions
        )
        self.start = len(fractions) - 1
        self._keys = BonePoses(
            *(
                np.concatenate([getattr(warm_up, name)[:-1], getattr(self._bones, name)])
                for name in ("rotations", "root")
            )
        )
        self._transforms = body.transforms(self._bones)

    @property
    def skin(self) -> np.ndarray:
        transforms = self._body.transforms(self._keys).astype(np.float32)
        return self._body.vertices(transforms)[:, self.dressed.covered]

    def between(self, number: int, substeps: int) -> tuple[np.ndarray, np.ndarray]:
        fraction = np.arange(1, substeps + 1)[:, None] / substeps
        start, end = (_repeated(_frame(self._keys, key), substeps) for key in (number - 1, number))
        transforms = self._body.transforms(self._body.interpolate(start, end, fraction)).astype(np.float32)
        garment = self.dressed.garment
        pinned = garment.mesh.vertices[garment.pinned]
        return self._body.vertices(transforms), skinned(transforms, self._weights, pinned)

    @property
    def body(self) -> np.ndarray:
        return round_to_grid(self._body.vertices(self._transforms))

    def placed(self, vertices: np.ndarray) -> np.ndarray:
        return vertices

    def skeleton(self) -> Skeleton:
        # Weights and transforms give the body before rounding, that is within 8 µm.
        return Skeleton(
            poses=self._motion.poses.astype(np.float32),
            trans=(self._bones.root - self._body.joints_rest[0]).astype(np.float32),
            joints_rest=self._body.joints_rest.astype(np.float32),
            parents=self._body.parents,
            blend_weights=self._body.blend_weights,
            joint_transforms=self._transforms.astype(np.float32),
        )

    def info(self) -> dict[str, str]:
        return {
            "source": f"imgtransfer simulate, motion {self.name}",
            "body": self._config.body.model_dump_json(exclude_unset=True),
        }


@lru_cache(maxsize=4)
def dressed_body(
    wearer: BodyConfig, kind: GarmentConfig, fingerprint: str
) -> tuple[DressedBody, SkinnedBody, np.ndarray]:
    """The garment on the body, the body, and the blend weights (H, K) with which the garment's pinned vertices move.

    Args:
        fingerprint: of the garment's file, so that another one of the same name is read anew.
    """
    body = make_body(wearer)
    # Refitted from the default shape, so that a garment has the same faces on every shape of a body.
    like = None if wearer == wearer.reference else make_body(wearer.reference)
    garment = make_garment(body, kind, like=like)
    mesh = garment.mesh
    weights = body.weights_near(mesh.vertices[garment.pinned])
    return DressedBody(body.rest, body.faces, garment, covered_skin(mesh.vertices, body.rest)), body, weights


def _repeated(bones: BonePoses, frames: int) -> BonePoses:
    """One frame, so many times."""
    return BonePoses(np.repeat(bones.rotations, frames, axis=0), np.repeat(bones.root, frames, axis=0))


def _frame(bones: BonePoses, number: int) -> BonePoses:
    return BonePoses(bones.rotations[number : number + 1], bones.root[number : number + 1])
