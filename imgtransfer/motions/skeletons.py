"""Which joint of a skeleton is which of SMPL's, by the names that are in use."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence

from imgtransfer.bodies.smpl import JOINTS
from imgtransfer.motions.joint_names import plain_names
from render import InputError, Option

# Names without side, lower case, letters and digits only; the first that the skeleton has and no joint before took.
# CMU and Mixamo call the ankle "foot" and the collar "shoulder", which in SMPL are the toes and the shoulder.
_LIMBS = {
    "hip": ("upleg", "thigh", "upperleg", "thighbend", "femur", "legupper", "hip"),
    "knee": ("leg", "knee", "shin", "calf", "lowerleg", "lowleg", "tibia", "leglower"),
    "ankle": ("ankle", "foot"),
    "foot": ("toebase", "toe", "toes", "ball", "foot"),
    "shoulder": ("arm", "uparm", "upperarm", "uarm", "shldr", "shldrbend", "humerus", "armupper", "shoulder"),
    "collar": ("collar", "clavicle", "collarbone", "scapula", "shoulder"),
    "elbow": ("forearm", "elbow", "lowerarm", "lowarm", "farm", "forearmbend", "radius", "armlower"),
    "wrist": ("wrist", "hand"),
}
_PELVIS = ("hips", "pelvis", "hip", "hipcenter", "spinebase")
_MIDDLE = {
    "pelvis": (*_PELVIS, "root"),
    "neck": ("neck", "necklower", "necktwist"),
    "head": ("head",),
}
_OPTIONAL = {"left_foot", "right_foot", "left_collar", "right_collar", "neck"}
_CHAINS = (("hip", "knee", "ankle"), ("shoulder", "elbow", "wrist"))


def named_joints(
    names: Sequence[str], parents: Sequence[int], source: str, given: Mapping[str, str] | None = None
) -> dict[str, int]:
    """SMPL's joint names with the numbers of the skeleton's joints; those that it lacks are left out.

    The spine's three joints are the first, the middle and the last of the chain from the pelvis to the chest, whatever
    they are called; a shorter chain has no middle one. The pelvis is where legs and head meet, unless a joint above
    both is called so.

    Args:
        parents: number of each joint's parent, -1 for the root.
        source: what messages call the skeleton.
        given: the skeleton's names of some of SMPL's joints; all others are found by their names.

    Raises:
        InputError: joints that a body needs are missing, given ones are not there, or a limb's do not hang from each
            other; names them, and those that there are.
    """
    joints = _given_joints(names, source, given or {})
    fixed = dict(joints)
    plain = _numbers_of(plain_names(names))

    def take(joint: str, candidates: Sequence[str]) -> None:
        for candidate in candidates:
            number = plain.get(candidate)
            if joint not in joints and number is not None and number not in joints.values():
                joints[joint] = number
                return

    for joint, candidates in _MIDDLE.items():
        take(joint, [f"{before}{name}{after}" for before, after in _CENTRES for name in candidates])
    for side in ("left", "right"):
        for joint, candidates in _LIMBS.items():
            take(f"{side}_{joint}", [sided for name in candidates for sided in _sided(name, side)])
    if "pelvis" not in fixed:
        _place_pelvis(joints, names, parents)
    missing = [
        joint for joint in [*_MIDDLE, *_both(_LIMBS)] if joint not in joints and joint not in _OPTIONAL
    ]
    if not missing:
        chain = _spine(joints, parents)
        taken = fixed.values()
        joints |= {
            joint: number for joint, number in chain.items() if joint not in fixed and number not in taken
        }
        missing = [] if "spine3" in joints else ["a spine between pelvis and arms"]
    if missing:
        raise InputError(
            f"{source}: the skeleton has no joint for {', '.join(missing)}; it has {', '.join(names)}. Names as in "
            f"CMU, Mixamo or SMPL skeletons are wanted, or {Option('joints')} that says which they are "
            "(left_knee: Bone07)"
        )
    _check_chains(joints, names, parents, source)
    return joints


# Signs of a joint in the middle, as VRM (C_Hips) and Maya's rigs (Root_M) write them.
_CENTRES = (("", ""), ("c", ""), ("", "c"), ("", "m"))


def _sided(name: str, side: str) -> list[str]:
    return [f"{side}{name}", f"{side[0]}{name}", f"{name}{side}", f"{name}{side[0]}"]


def _numbers_of(plain: Sequence[str]) -> dict[str, int]:
    """The first joint of each name; names without their digits stand for those that have no joint of their own."""
    numbers = {name: number for number, name in reversed(list(enumerate(plain)))}
    bare = {re.sub(r"\d", "", name): number for number, name in reversed(list(enumerate(plain)))}
    return bare | numbers


def _given_joints(names: Sequence[str], source: str, given: Mapping[str, str]) -> dict[str, int]:
    """Numbers of the joints that `given` names."""
    joints: dict[str, int] = {}
    for joint, name in given.items():
        if joint not in JOINTS:
            raise InputError(f"{Option('joints')}: {joint} is none of SMPL's joints, {', '.join(JOINTS)}")
        if name not in names:
            raise InputError(
                f"{source}: joints: {joint} is {name!r}, which the skeleton lacks; it has {', '.join(names)}"
            )
        number = list(names).index(name)
        if number in joints.values():
            other = next(other for other, taken in joints.items() if taken == number)
            raise InputError(f"{source}: joints: both {other} and {joint} are {name!r}")
        joints[joint] = number
    return joints


def _both(joints: Sequence[str] | dict[str, tuple[str, ...]]) -> list[str]:
    return [f"{side}_{joint}" for side in ("left", "right") for joint in joints]


def ancestors(number: int, parents: Sequence[int]) -> list[int]:
    """A joint and all above it, upwards."""
    chain = []
    while number >= 0:
        chain.append(number)
        number = parents[number]
    return chain


def _place_pelvis(joints: dict[str, int], names: Sequence[str], parents: Sequence[int]) -> None:
    """Put the pelvis where legs and head meet, unless a joint of that name is above them all."""
    wanted = ("left_hip", "right_hip", "head")
    if not all(joint in joints for joint in wanted):
        return
    chains = [ancestors(joints[joint], parents)[1:] for joint in wanted]
    meeting = next((number for number in chains[0] if all(number in chain for chain in chains)), None)
    if meeting is None:
        return
    named = joints.get("pelvis")
    called_so = named is not None and not plain_names(names)[named].startswith("root")
    if not called_so or not all(named in chain for chain in chains):
        joints["pelvis"] = meeting


def _spine(joints: dict[str, int], parents: Sequence[int]) -> dict[str, int]:
    """The joints above the pelvis that both arms and the head hang from."""

    def above(number: int) -> list[int]:
        chain = ancestors(number, parents)
        return chain[: chain.index(joints["pelvis"]) if joints["pelvis"] in chain else None][::-1]

    chains = [above(joints[joint]) for joint in ("left_shoulder", "right_shoulder", "head")]
    shared = [numbers[0] for numbers in zip(*chains, strict=False) if len(set(numbers)) == 1]
    # A biped of 3ds Max has its collars at the neck.
    shared = [number for number in shared if number != joints.get("neck")] or shared
    if not shared:
        return {}
    spine = {"spine1": shared[0], "spine3": shared[-1]}
    if len(shared) > 2:
        spine["spine2"] = shared[len(shared) // 2]
    if len(shared) == 1:
        del spine["spine1"]
    return spine


def _check_chains(joints: dict[str, int], names: Sequence[str], parents: Sequence[int], source: str) -> None:
    """Raise InputError where a limb's joint does not hang from the one before: names were taken for others."""
    for side in ("left", "right"):
        for chain in _CHAINS:
            for upper, lower in itertools.pairwise(chain):
                above, below = joints[f"{side}_{upper}"], joints[f"{side}_{lower}"]
                if above not in ancestors(below, parents)[1:]:
                    raise InputError(
                        f"{source}: {side}_{lower} was taken to be {names[below]}, which does not hang from "
                        f"{names[above]}, taken to be {side}_{upper}; say by {Option('joints')} which they are"
                    )
