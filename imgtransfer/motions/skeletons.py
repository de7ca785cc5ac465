"""Which joint of a skeleton is which of SMPL's, by the names that are in use."""

from __future__ import annotations

import re
from collections.abc import Sequence

from render import InputError

# Names without side, lower case, letters and digits only; the first that the skeleton has and no joint before took.
# CMU and Mixamo call the ankle "foot" and the collar "shoulder", which in SMPL are the toes and the shoulder.
_LIMBS = {
    "hip": ("upleg", "thigh", "upperleg", "hip"),
    "knee": ("leg", "knee", "shin", "calf", "lowerleg", "lowleg"),
    "ankle": ("ankle", "foot"),
    "foot": ("toebase", "toe", "toes", "foot"),
    "shoulder": ("arm", "uparm", "upperarm", "shoulder"),
    "collar": ("collar", "clavicle", "shoulder"),
    "elbow": ("forearm", "elbow", "lowerarm", "lowarm"),
    "wrist": ("wrist", "hand"),
}
_MIDDLE = {"pelvis": ("hips", "pelvis", "hip", "root"), "neck": ("neck",), "head": ("head",)}
_OPTIONAL = {"left_foot", "right_foot", "left_collar", "right_collar", "neck"}


def named_joints(names: Sequence[str], parents: Sequence[int], source: str) -> dict[str, int]:
    """SMPL's joint names with the numbers of the skeleton's joints; those that it lacks are left out.

    The spine's three joints are the first, the middle and the last of the chain from the pelvis to the chest, whatever
    they are called; a shorter chain has no middle one.

    Args:
        parents: number of each joint's parent, -1 for the root.
        source: what messages call the skeleton.

    Raises:
        InputError: joints that a body needs are missing; names them, and those that there are.
    """
    plain = {_plain(name): number for number, name in reversed(list(enumerate(names)))}
    joints: dict[str, int] = {}

    def take(joint: str, candidates: Sequence[str]) -> None:
        for candidate in candidates:
            number = plain.get(candidate)
            if number is not None and number not in joints.values():
                joints[joint] = number
                return

    for joint, candidates in _MIDDLE.items():
        take(joint, candidates)
    for side, letter in (("left", "l"), ("right", "r")):
        for joint, candidates in _LIMBS.items():
            take(f"{side}_{joint}", [f"{prefix}{name}" for name in candidates for prefix in (side, letter)])
    missing = [
        joint for joint in [*_MIDDLE, *_both(_LIMBS)] if joint not in joints and joint not in _OPTIONAL
    ]
    if not missing:
        joints |= _spine(joints, parents)
        missing = [] if "spine3" in joints else ["a spine between pelvis and arms"]
    if missing:
        raise InputError(
            f"{source}: the skeleton has no joint for {', '.join(missing)}; it has {', '.join(names)}. Names as in "
            "CMU, Mixamo or SMPL skeletons are wanted"
        )
    return joints


def _both(joints: Sequence[str] | dict[str, tuple[str, ...]]) -> list[str]:
    return [f"{side}_{joint}" for side in ("left", "right") for joint in joints]


def _plain(name: str) -> str:
    """Without a prefix such as mixamorig: or SMPL's m_avg_, in lower case, letters and digits only."""
    name = name.rpartition(":")[2].lower()
    return re.sub(r"[^a-z0-9]|^mixamorig|^(m|f)_avg_", "", name)


def _spine(joints: dict[str, int], parents: Sequence[int]) -> dict[str, int]:
    """The joints above the pelvis that both arms and the head hang from."""

    def above(number: int) -> list[int]:
        chain = []
        while number >= 0 and number != joints["pelvis"]:
            chain.append(number)
            number = parents[number]
        return chain[::-1]

    chains = [above(joints[joint]) for joint in ("left_shoulder", "right_shoulder", "head")]
    shared = [numbers[0] for numbers in zip(*chains, strict=False) if len(set(numbers)) == 1]
    if not shared:
        return {}
    spine = {"spine1": shared[0], "spine3": shared[-1]}
    if len(shared) > 2:
        spine["spine2"] = shared[len(shared) // 2]
    if len(shared) == 1:
        del spine["spine1"]
    return spine
