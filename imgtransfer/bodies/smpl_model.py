"""A body of the SMPL model, from the user's own model files.

SMPL: A Skinned Multi-Person Linear Model, Loper et al. 2015. Its files may not be passed on, so none come with this
project; they are those that `smplx.SMPL` reads, and the body is the same. Hands stay flat.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from imgtransfer.bodies.skinned import BonePoses, SkinnedBody, skinned
from imgtransfer.bodies.smpl import INDEX, JOINTS, global_rotations
from render import InputError

GET = (
    "register at https://smpl.is.tue.mpg.de, download SMPL for Python (version 1.0.0 or 1.1.0), unpack it, and give "
    "the folder with its .pkl files as the body's path"
)


@dataclass(frozen=True, eq=False)
class SmplBody(SkinnedBody):
    """An SMPL body of one shape, in its T-pose; see `SkinnedBody`.

    Args:
        joints: (K, 3) float64, rest position of every joint, the root first.
        tree: K indices of parents, -1 for the root.
        pose_shapes: (9 (K - 1), 3 B) float32, what a joint's rotation adds to the rest shape.
    """

    joints: np.ndarray
    tree: tuple[int, ...]
    pose_shapes: np.ndarray

    @property
    def bone_parents(self) -> tuple[int, ...]:
        """K indices, -1 for the root."""
        return self.tree

    @property
    def bone_heads(self) -> np.ndarray:
        """(K, 3) float64."""
        return self.joints

    @property
    def joint_bones(self) -> np.ndarray:
        """(22,) int64."""
        return np.arange(len(JOINTS))

    @cached_property
    def leg_length(self) -> float:
        """Hip to knee to ankle, metres, mean of both sides."""
        chains = [
            [INDEX[f"{side}_{joint}"] for joint in ("hip", "knee", "ankle")] for side in ("left", "right")
        ]
        return float(np.linalg.norm(np.diff(self.joints[chains], axis=1), axis=-1).sum(axis=1).mean())

    def bone_poses(
        self, poses: np.ndarray, trans: np.ndarray, *, leg_length: float | None = None
    ) -> BonePoses:
        """Pose the bones from SMPL joints; see `SkinnedBody.bone_poses`."""
        turned = np.empty((len(poses), len(self.tree), 3, 3))
        turned[:, : len(JOINTS)] = global_rotations(poses)
        for bone in range(len(JOINTS), len(self.tree)):
            turned[:, bone] = turned[:, self.tree[bone]]
        scale = 1.0 if leg_length is None else self.leg_length / leg_length
        return BonePoses(turned, scale * np.asarray(trans, np.float64))

    def vertices(self, transforms: np.ndarray) -> np.ndarray:
        """(T, K, 3, 4) -> (T, B, 3) float32 by linear blend skinning of the pose's shape."""
        local = self._local(transforms[..., :3])[:, 1:] - np.eye(3)
        moved = local.reshape(len(local), -1) @ self.pose_shapes
        return skinned(transforms, self.blend_weights, self.rest + moved.reshape(len(local), -1, 3))


def load_smpl(path: str | Path, *, betas: Sequence[float] = (), gender: str = "neutral") -> SmplBody:
    """A SMPL body from its model file.

    Args:
        path: SMPL_NEUTRAL.pkl or .npz and the like, or the folder they lie in; of a pickle only arrays are read.
        betas: shape coefficients; those that are not given are 0.
        gender: female, male or neutral: which file of a folder.

    Raises:
        InputError: no such file (the message says what to get and where to put it), something in it is missing or
            has another shape, or betas that the model lacks.
    """
    from imgtransfer.importers.smpl import find_smpl, smpl_body  # noqa: PLC0415 (importers use bodies)

    try:
        file = find_smpl(Path(path), gender, needed_by="body")
    except InputError as error:
        raise InputError(f"body: no SMPL model of a {gender} body at {path}; {GET}") from error
    model = smpl_body(file)
    shape = np.array(betas, np.float64)
    if len(shape) > model.shapedirs.shape[2] or not np.isfinite(shape).all():
        raise InputError(
            f"betas {list(betas)}: at most {model.shapedirs.shape[2]} finite numbers are wanted for {file}"
        )
    rest = model.rest(shape)
    return SmplBody(
        rest=rest.astype(np.float32),
        faces=model.faces.astype(np.int32),
        blend_weights=model.weights.astype(np.float32),
        joints=model.joints(shape),
        tree=tuple(model.parents.tolist()),
        pose_shapes=model.posedirs.reshape(rest.size, -1).T.astype(np.float32),
    )
