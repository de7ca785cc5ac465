"""What every body can do: a rest mesh with linear blend skinning, posed from the 22 SMPL body joints."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from imgtransfer.bodies.rotations import between
from imgtransfer.bodies.smpl import PARENTS

_NEIGHBOURS = 4  # of the skin's vertices, that a point near the skin takes its weights from


@dataclass(frozen=True, eq=False)
class BonePoses:
    """Where the K bones stand in T frames.

    Args:
        rotations: (T, K, 3, 3) float64, world rotation of each bone from its rest pose.
        root: (T, 3) float64, world position of the root bone's head, metres.
    """

    rotations: np.ndarray
    root: np.ndarray


@dataclass(frozen=True, eq=False)
class PosedBody:
    """A body in T frames.

    Args:
        vertices: (T, B, 3) float32, metres. joints: (T, 22, 3) float64, the SMPL joints.
    """

    vertices: np.ndarray
    joints: np.ndarray


@dataclass(frozen=True, eq=False)
class SkinnedBody(ABC):
    """A body's rest mesh and skinning; metres, y up, facing +z, +x to its left.

    Args:
        rest: (B, 3) float32. faces: (G, 3) int32, counter-clockwise seen from outside.
        blend_weights: (B, K) float32, rows sum to 1.
    """

    rest: np.ndarray
    faces: np.ndarray
    blend_weights: np.ndarray

    @property
    @abstractmethod
    def bone_parents(self) -> tuple[int, ...]:
        """K indices, -1 for the root; parents come before their children."""

    @property
    @abstractmethod
    def bone_heads(self) -> np.ndarray:
        """(K, 3) float64, the point about which each bone turns, at rest."""

    @property
    @abstractmethod
    def joint_bones(self) -> np.ndarray:
        """(22,) int64, the bone whose head is each SMPL joint."""

    @property
    @abstractmethod
    def leg_length(self) -> float:
        """Hip to knee to ankle, metres, mean of both sides."""

    @abstractmethod
    def bone_poses(
        self, poses: np.ndarray, trans: np.ndarray, *, leg_length: float | None = None
    ) -> BonePoses:
        """Pose the bones from SMPL joints.

        Args:
            poses: (T, 22, 3) local axis-angle, radians.
            trans: (T, 3) world position of SMPL's pelvis joint, metres, y up.
            leg_length: hip to ankle of the performer `trans` belongs to; the path is scaled to this body's legs.
        """

    @cached_property
    def joints_rest(self) -> np.ndarray:
        """(22, 3) float64, rest position of the SMPL joints."""
        return self.bone_heads[self.joint_bones]

    @property
    def parents(self) -> np.ndarray:
        """(22,) int64, the SMPL joint tree."""
        return np.array(PARENTS)

    def pose(self, poses: np.ndarray, trans: np.ndarray, *, leg_length: float | None = None) -> PosedBody:
        """Skin and joints for SMPL poses; arguments as for `bone_poses`."""
        transforms = self.transforms(self.bone_poses(poses, trans, leg_length=leg_length))
        bones = transforms[:, self.joint_bones]
        joints = np.einsum("tjab,jb->tja", bones[..., :3], self.joints_rest) + bones[..., 3]
        return PosedBody(self.vertices(transforms), joints)

    def rest_pose(self) -> BonePoses:
        """The rest pose as one frame."""
        return BonePoses(np.tile(np.eye(3), (1, len(self.bone_parents), 1, 1)), self.bone_heads[:1])

    def transforms(self, bones: BonePoses) -> np.ndarray:
        """(T, K, 3, 4) float64, rest to posed; a bone's head follows its parent, the root's is at `bones.root`."""
        turned = bones.rotations
        result = np.empty((*turned.shape[:2], 3, 4))
        result[..., :3] = turned
        for bone, (head, parent) in enumerate(zip(self.bone_heads, self.bone_parents, strict=True)):
            stands = bones.root if parent < 0 else result[:, parent, :, :3] @ head + result[:, parent, :, 3]
            result[:, bone, :, 3] = stands - turned[:, bone] @ head
        return result

    def vertices(self, transforms: np.ndarray) -> np.ndarray:
        """(T, K, 3, 4) -> (T, B, 3) float32 by linear blend skinning."""
        return skinned(transforms, self.blend_weights, self.rest)

    def weights_near(self, points: np.ndarray) -> np.ndarray:
        """(P, K) float32 blend weights for points (P, 3) near the rest mesh, such as cloth fixed to the skin."""
        distance, nearest = cKDTree(self.rest).query(points, k=_NEIGHBOURS)
        weights = 1 / np.maximum(distance, 1e-6) ** 2
        weights /= weights.sum(axis=1, keepdims=True)
        return np.einsum("pn,pnk->pk", weights, self.blend_weights[nearest]).astype(np.float32)

    def interpolate(self, start: BonePoses, end: BonePoses, fraction: float | np.ndarray) -> BonePoses:
        """Between two stacks of T frames, by spherical interpolation of each bone's rotation against its parent.

        Args:
            fraction: from 0, the start, to 1, the end; a number or (T, 1).
        """
        turned = between(self._local(start.rotations), self._local(end.rotations), fraction)
        for bone, parent in enumerate(self.bone_parents):
            if parent >= 0:
                turned[:, bone] = turned[:, parent] @ turned[:, bone]
        return BonePoses(turned, (1 - fraction) * start.root + fraction * end.root)

    def _local(self, rotations: np.ndarray) -> np.ndarray:
        """(T, K, 3, 3) rotations against the parent bone's."""
        local = rotations.copy()
        for bone, parent in enumerate(self.bone_parents):
            if parent >= 0:
                local[:, bone] = np.swapaxes(rotations[:, parent], 1, 2) @ rotations[:, bone]
        return local


def skinned(transforms: np.ndarray, weights: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Linear blend skinning.

    Args:
        transforms: (T, K, 3, 4), rest to posed. weights: (P, K). rest: (P, 3), or (T, P, 3) for one shape a frame.

    Returns:
        (T, P, 3) float32.
    """
    blended = np.tensordot(transforms, weights, axes=(1, 1))  # (T, 3, 4, P)
    moved = np.einsum("tijb,bj->tbi" if rest.ndim == 2 else "tijb,tbj->tbi", blended[:, :, :3], rest)
    return (moved + np.swapaxes(blended[:, :, 3], 1, 2)).astype(np.float32)
