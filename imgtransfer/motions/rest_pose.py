"""How a skeleton stands at rest: where no joint is turned, or where its joints are oriented along their bones."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from imgtransfer.bodies.smpl import JOINTS, PARENTS, segment_direction
from render import InputError

_UP = np.array([0.0, 1.0, 0.0])
# Which segment starts at a joint and where it ends; the hand keeps the forearm's correction.
_SEGMENTS = {"hip": ("thigh", "knee"), "knee": ("shin", "ankle"), "shoulder": ("upper_arm", "elbow"),
             "elbow": ("forearm", "wrist"), "wrist": ("forearm", None)}  # fmt: skip
# Where the joints between point in the T-pose, left side; roughly, as it only tells which frame is the nearest.
_BETWEEN = {"ankle": ("foot", (0.0, -0.35, 0.94)), "collar": ("shoulder", (1.0, 0.0, 0.0))}
_STRAIGHT = 0.5  # cosine from which on a limb goes on as its T-pose does
_NEAR = np.radians(30.0)  # from a turn by right angles, which is what modelling programs have, it is meant


def own_axes(rest: np.ndarray, joints: Mapping[str, int], path: Path) -> np.ndarray:
    """(3, 3) rotation from the file's axes to ours (x to the body's left, y up), each of them one of the file's.

    Args:
        rest: (J, 3) positions where no joint is turned.
        joints: numbers of the skeleton's joints by SMPL's names.
        path: of the file.

    Raises:
        InputError: hips and chest are along one axis, or at one point.
    """
    across = rest[joints["left_hip"]] - rest[joints["right_hip"]]
    above = rest[joints["spine3"]] - (rest[joints["left_hip"]] + rest[joints["right_hip"]]) / 2
    left, up = (np.sign(v[i]) * np.eye(3)[i] for v in (across, above) for i in [np.abs(v).argmax()])
    if abs(left @ up) > 0 or not across.any() or not above.any():
        raise InputError(
            f"{path}: the skeleton at rest has its left hip towards {across} and its chest towards {above}; these "
            "should be different axes, a standing skeleton is wanted"
        )
    return np.stack([left, up, np.cross(left, up)])


def stands(rest: np.ndarray, joints: Mapping[str, int]) -> bool:
    """Whether (J, 3) positions in our axes are those of somebody who stands: legs down, arms neither up nor crossed.

    The shoulders must be across the body as the hips are.

    Joints that are oriented along their bones (LaFAN1, Rokoko, Bandai-Namco) have limbs along the spine where none is
    turned.
    """
    shoulders = rest[joints["left_shoulder"]] - rest[joints["right_shoulder"]]
    if shoulders.any() and _unit(shoulders)[0] < 0.5:
        return False
    for side, outwards in (("left", 1.0), ("right", -1.0)):
        leg = _unit(rest[joints[f"{side}_ankle"]] - rest[joints[f"{side}_hip"]])
        arm = _unit(rest[joints[f"{side}_wrist"]] - rest[joints[f"{side}_shoulder"]])
        if leg[1] > -0.5 or arm[1] > 0.7 or outwards * arm[0] < -0.3:
            return False
    return True


def standing_turns(
    rest: np.ndarray, rotations: np.ndarray, joints: Mapping[str, int]
) -> dict[str, np.ndarray]:
    """(3, 3) turn of each SMPL joint from where no joint is turned to the T-pose, for joints along their bones.

    The trunk rests where it is turned by right angles, or not at all, nearest to what it mostly is: chests may have
    other axes than hips. A limb is straight where it is not turned, as it is in the T-pose; how it hangs from the
    trunk is taken from the frame in which it is nearest to the T-pose, as the turn by right angles that is next to
    it, if one is. The foot rests as it does in the frame in which it is flattest against the shin.

    Args:
        rest: (J, 3) positions where no joint is turned. rotations: (T, J, 3, 3) from there. Both in our axes.
    """
    turns: dict[str, np.ndarray] = {}
    # The same with limbs along the axes, as they are where the foot is flat.
    upright: dict[str, np.ndarray] = {}
    for number, name in enumerate(JOINTS):
        parent = JOINTS[PARENTS[number]] if number else ""
        while parent and parent not in joints:
            parent = JOINTS[PARENTS[JOINTS.index(parent)]]
        turns[name], upright[name] = turns.get(parent, np.eye(3)), upright.get(parent, np.eye(3))
        if not parent or name not in joints:
            continue
        side, _, kind = name.partition("_")
        against = np.swapaxes(rotations[:, joints[parent]], 1, 2) @ rotations[:, joints[name]]
        if not kind:
            turns[name] = upright[name] = turns[name] @ _by_right_angles(_mean(against), otherwise=np.eye(3))
            continue
        segment = _bone(rest, joints, side, kind)
        if segment is None:
            continue
        bone, wanted = segment
        of_trunk = "_" not in parent
        if not of_trunk and _unit(turns[name] @ bone) @ wanted > _STRAIGHT:
            continue
        nearest = upright[name] @ against[((turns[name] @ against @ bone) @ wanted).argmax()]
        turn = nearest if kind == "ankle" else _by_right_angles(nearest, otherwise=nearest)
        upright[name] = turn
        turns[name] = turn if kind in _BETWEEN else shortest_turn(turn @ bone, wanted) @ turn
    return turns


def _mean(rotations: np.ndarray) -> np.ndarray:
    """(3, 3) the rotation that is nearest to (T, 3, 3) rotations."""
    return Rotation.from_matrix(rotations).mean().as_matrix()


def _bone(
    rest: np.ndarray, joints: Mapping[str, int], side: str, kind: str
) -> tuple[np.ndarray, np.ndarray] | None:
    """Unit directions of the bone that starts at a limb's joint: where it is not turned, and in the T-pose."""
    if kind in _BETWEEN:
        end, direction = _BETWEEN[kind]
        wanted = np.array(direction) * ([1, 1, 1] if side == "left" else [-1, 1, 1])
    elif kind in _SEGMENTS and (end := _SEGMENTS[kind][1] or ""):
        wanted = segment_direction(_SEGMENTS[kind][0], side)
    else:
        return None
    start, stop = (joints.get(f"{side}_{joint}") for joint in (kind, end))
    if start is None or stop is None or not (rest[stop] - rest[start]).any():
        return None
    return _unit(rest[stop] - rest[start]), _unit(wanted)


def correction(name: str, joints: Mapping[str, int], rest: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """(3, 3) the shortest turn from a segment's direction in the T-pose to where the skeleton has it at rest.

    Args:
        rest: (J, 3) positions where no joint is turned, in our axes; the joint rests turned by `turn` from there.
    """
    side, _, kind = name.partition("_")
    if kind not in _SEGMENTS:
        return np.eye(3)
    segment, end = _SEGMENTS[kind]
    start, stop = (
        joints[f"{side}_{joint}"] for joint in (("elbow", "wrist") if end is None else (kind, end))
    )
    return shortest_turn(segment_direction(segment, side), turn @ (rest[stop] - rest[start]))


def shortest_turn(given: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """(3, 3) the rotation by the least angle from the direction `given` to `wanted`; half a turn is about x."""
    axis = np.cross(given, wanted)
    if np.linalg.norm(axis) <= 1e-9 * np.linalg.norm(wanted):  # along it, against it, or of no length
        return np.diag([1.0, -1.0, -1.0]) if given @ wanted < 0 and abs(given[0]) < 0.5 else np.eye(3)
    angle = np.arctan2(np.linalg.norm(axis), given @ wanted)
    return Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix()


def _by_right_angles(turn: np.ndarray, *, otherwise: np.ndarray) -> np.ndarray:
    """The nearest of the 24 rotations that map axes to axes; `otherwise` where none is within 30 degrees."""
    candidates = [
        np.eye(3)[list(order)] * signs
        for order in itertools.permutations(range(3))
        for signs in itertools.product((1.0, -1.0), repeat=3)
    ]
    best = max((c for c in candidates if np.linalg.det(c) > 0), key=lambda c: float((c * turn).sum()))
    angle = np.arccos(np.clip(((best * turn).sum() - 1) / 2, -1, 1))
    return best if angle < _NEAR else otherwise


def leg_length(rest: np.ndarray, joints: Mapping[str, int]) -> float:
    """Hip to knee to ankle, mean of both sides, in the file's unit."""
    chains = [[joints[f"{side}_{joint}"] for joint in ("hip", "knee", "ankle")] for side in ("left", "right")]
    return float(np.mean([np.linalg.norm(np.diff(rest[chain], axis=0), axis=1).sum() for chain in chains]))


def _unit(vector: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(vector)
    return vector / length if length > 0 else vector
