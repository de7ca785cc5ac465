"""From SMPL joint rotations to the world rotations of the Anny body's bones.

SMPL rests in a T-pose, Anny in an A-pose with bent elbows. Every limb bone therefore gets a constant rotation that
first carries its rest direction and hinge axis onto the T-pose's; trunk, head and feet need none.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from imgtransfer.bodies.rotations import about, between, segment_frame, twist
from imgtransfer.bodies.smpl import INDEX, segment_direction

# Every bone that moves on its own, with its parent. Anny's other bones move rigidly with one of these: fingers with
# the wrist, the face with the head, and the pelvis bones with the root; the toes of a foot move as one.
BONES: dict[str, str | None] = {"root": None, "spine04": "root"}
for _child, _parent in zip(
    ("spine03", "spine02", "spine01", "neck01", "neck02", "neck03", "head"),
    ("spine04", "spine03", "spine02", "spine01", "neck01", "neck02", "neck03"),
    strict=True,
):
    BONES[_child] = _parent
_ARM = ("clavicle", "shoulder01", "upperarm01", "upperarm02", "lowerarm01", "lowerarm02", "wrist")
_LEG = ("upperleg01", "upperleg02", "lowerleg01", "foot", "toe3-1")
for _side in "LR":
    for _chain, _parent in ((_ARM, "spine01"), (_LEG, "root")):
        for _bone in _chain:
            BONES[f"{_bone}.{_side}"] = _parent
            _parent = f"{_bone}.{_side}"

# The shoulder blade's fraction of the upper arm's swing; 0 pinches raised shoulders.
BLADE_FRACTION = 0.35
_SIDES = (("left", "L"), ("right", "R"))


def bone_rotations(rotations: np.ndarray, heads: Mapping[str, np.ndarray]) -> np.ndarray:
    """World rotation of every bone of `BONES` from its rest pose.

    Args:
        rotations: (T, 22, 3, 3) global rotations of the SMPL joints.
        heads: rest position (3,) of each bone's head, y up; also of "finger2-1", "finger3-1" and "finger5-1",
            which give the hand its direction.

    Returns:
        (T, K, 3, 3) float64 in the order of `BONES`.
    """
    of = {name: rotations[:, number] for name, number in INDEX.items()}
    turned = {
        "root": of["pelvis"],
        "spine04": between(of["pelvis"], of["spine1"], 0.5),
        "spine03": of["spine1"],
        "spine02": of["spine2"],
        "spine01": of["spine3"],
        "neck01": between(of["spine3"], of["neck"], 0.5),
        "neck02": of["neck"],
        "neck03": between(of["neck"], of["head"], 0.5),
        "head": of["head"],
    }
    for side, letter in _SIDES:
        turned |= _arm(of, heads, side, letter) | _leg(of, heads, side, letter)
    return np.stack([turned[bone] for bone in BONES], axis=1)


def _aligned(segment: str, side: str, direction: np.ndarray, rest_hinge: np.ndarray) -> np.ndarray:
    """(3, 3) constant rotation from a segment's rest direction and hinge to those of SMPL's T-pose."""
    sign = 1.0 if side == "left" else -1.0
    hinges = {
        "thigh": (1.0, 0.0, 0.0),
        "shin": (1.0, 0.0, 0.0),
        "upper_arm": (0.0, -sign, 0.0),
        "forearm": (0.0, -sign, 0.0),
        "hand": (0.0, 0.0, 1.0),
    }
    target = segment_frame(segment_direction(segment, side), np.array(hinges[segment]))
    return target @ segment_frame(direction, rest_hinge).T


def _arm(
    of: dict[str, np.ndarray], heads: Mapping[str, np.ndarray], side: str, letter: str
) -> dict[str, np.ndarray]:
    def span(start: str, end: str) -> np.ndarray:
        return heads[f"{end}.{letter}"] - heads[f"{start}.{letter}"]

    upper, fore = span("upperarm01", "lowerarm01"), span("lowerarm01", "wrist")
    elbow = np.cross(upper, fore)
    collar = of[f"{side}_collar"]
    upper_arm = of[f"{side}_shoulder"] @ _aligned("upper_arm", side, upper, elbow)
    forearm = of[f"{side}_elbow"] @ _aligned("forearm", side, fore, elbow)
    hand = of[f"{side}_wrist"] @ _aligned(
        "hand", side, span("wrist", "finger3-1"), span("finger5-1", "finger2-1")
    )
    along_upper, along_fore = upper / np.linalg.norm(upper), fore / np.linalg.norm(fore)
    upper_twist = twist(np.swapaxes(collar, 1, 2) @ upper_arm, along_upper)
    hand_twist = twist(np.swapaxes(forearm, 1, 2) @ hand, along_fore)
    turned = {
        "clavicle": collar,
        "shoulder01": between(collar, upper_arm @ about(along_upper, -upper_twist), BLADE_FRACTION),
        "upperarm01": upper_arm @ about(along_upper, -upper_twist / 2),
        "upperarm02": upper_arm,
        "lowerarm01": forearm,
        "lowerarm02": forearm @ about(along_fore, hand_twist / 2),
        "wrist": hand,
    }
    return {f"{bone}.{letter}": rotation for bone, rotation in turned.items()}


def _leg(
    of: dict[str, np.ndarray], heads: Mapping[str, np.ndarray], side: str, letter: str
) -> dict[str, np.ndarray]:
    hip, knee, ankle = (heads[f"{bone}.{letter}"] for bone in ("upperleg01", "lowerleg01", "foot"))
    hinge = np.array([1.0, 0.0, 0.0])
    thigh = of[f"{side}_hip"] @ _aligned("thigh", side, knee - hip, hinge)
    along = (knee - hip) / np.linalg.norm(knee - hip)
    thigh_twist = twist(np.swapaxes(of["pelvis"], 1, 2) @ thigh, along)
    turned = {
        "upperleg01": thigh @ about(along, -thigh_twist / 2),
        "upperleg02": thigh,
        "lowerleg01": of[f"{side}_knee"] @ _aligned("shin", side, ankle - knee, hinge),
        "foot": of[f"{side}_ankle"],
        "toe3-1": of[f"{side}_foot"],
    }
    return {f"{bone}.{letter}": rotation for bone, rotation in turned.items()}
