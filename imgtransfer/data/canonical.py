"""The canonical frame: the root joint's motion taken out before maps are made, and put back at the end."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from imgtransfer.data.clip import Clip
from imgtransfer.data.trunk import Trunk
from render.mesh.mesh import check_finite
from render.mesh.rigid import heading

RootMode = Literal["root", "heading"]


@dataclass(frozen=True, eq=False)
class RootFrames:
    """Rigid frames of a clip: canonical x' = Rᵀ(x − t), world x = R x' + t.

    The translation is chosen so that the rest pose maps onto itself: with a root joint that rests at r and
    stands at p, t = p − R r. Canonical meshes therefore lie where the template and the rest body lie.

    Args:
        rotation: (T, 3, 3) float64.
        translation: (T, 3) float64, metres.
    """

    rotation: np.ndarray
    translation: np.ndarray

    def part(self, frames: slice) -> RootFrames:
        """Those of some frames."""
        return RootFrames(self.rotation[frames], self.translation[frames])

    def to_canonical(self, points: np.ndarray) -> np.ndarray:
        """(T, N, 3) world -> (T, N, 3) canonical, float32."""
        return np.einsum("tba,tnb->tna", self.rotation, points - self.translation[:, None]).astype(np.float32)

    def to_world(self, points: np.ndarray) -> np.ndarray:
        """(T, N, 3) canonical -> (T, N, 3) world, float32.

        Raises:
            InputError: a point that is not finite, or beyond `render.limits.FARTHEST`; names its frame.
        """
        turned = np.einsum("tab,tnb->tna", self.rotation, points) + self.translation[:, None]
        check_finite(turned, "vertices")
        return turned.astype(np.float32)


def root_frames(clip: Clip, mode: RootMode) -> RootFrames:
    """The frames that `mode` removes: "root" the whole root rotation (section 4.2 of the paper), "heading"
    only its turn about the vertical, so that gravity keeps its direction.

    A clip without poses gets the motion of its body's trunk (`imgtransfer.data.trunk`); one with poses, but without
    `trans` or `joints_rest`, keeps the root's rotation, and only where its trunk is comes from the body.
    """
    skeleton = clip.skeleton
    rotation = None
    if skeleton.poses is not None:
        rotation = Rotation.from_rotvec(skeleton.poses[:, 0].astype(np.float64)).as_matrix()
    if rotation is not None and skeleton.trans is not None and skeleton.joints_rest is not None:
        rest = skeleton.joints_rest[0].astype(np.float64)
        root = rest + skeleton.trans.astype(np.float64)
    else:
        trunk = Trunk(clip.body.rest, clip.body.faces)
        rotation, translation = trunk.motion(clip.body.vertices, rotation)
        rest = trunk.centre
        root = rotation @ rest + translation
    if mode == "heading":
        rotation = heading(rotation)
    return RootFrames(rotation, root - rotation @ rest)
