"""BVH files with skeletons named as CMU, Mixamo and SMPL name theirs."""

import numpy as np
from scipy.spatial.transform import Rotation

from imgtransfer.bodies.smpl import JOINTS, PARENTS, segment_direction

MIXAMO = {
    "pelvis": "Hips",
    "spine1": "Spine",
    "spine2": "Spine1",
    "spine3": "Spine2",
    "neck": "Neck",
    "head": "Head",
}

LIMBS = {"hip": "UpLeg", "knee": "Leg", "ankle": "Foot", "foot": "ToeBase", "collar": "Shoulder", "shoulder": "Arm",
         "elbow": "ForeArm", "wrist": "Hand"}  # fmt: skip

for _side in ("left", "right"):
    MIXAMO |= {f"{_side}_{joint}": _side.capitalize() + name for joint, name in LIMBS.items()}

NAMINGS = {
    "mixamo": {joint: f"mixamorig:{name}" for joint, name in MIXAMO.items()},
    "cmu": MIXAMO | {"spine1": "LowerBack", "spine2": "Spine", "spine3": "Spine1"},
    "smpl": {joint: joint.replace("left", "m_avg_L").replace("right", "m_avg_R").title() for joint in JOINTS},
}

Y_UP = np.eye(3)

Z_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # ours to a file in which z is up and bodies face -y


def offsets(arms_down=False):
    """(22, 3) offsets of an SMPL-like T-pose, or with the arms hanging, in centimetres."""
    found = np.zeros((22, 3))
    up = {"spine1": 10, "spine2": 12, "spine3": 8, "neck": 22, "head": 10}
    for joint, length in up.items():
        found[JOINTS.index(joint), 1] = length
    for side, sign in (("left", 1), ("right", -1)):
        turn = Rotation.from_euler("z", -sign * 80 * arms_down, degrees=True)
        of = {
            "hip": np.array([sign * 9.0, -9, 0]),
            "knee": 40 * segment_direction("thigh", side),
            "ankle": 42 * segment_direction("shin", side),
            "foot": np.array([0, -5.0, 12]),
            "collar": np.array([sign * 7.0, 12, 0]),
            "shoulder": np.array([sign * 11.0, 3, 0]),
            "elbow": turn.apply(28 * segment_direction("upper_arm", side)),
            "wrist": turn.apply(26 * segment_direction("forearm", side)),
        }
        for joint, offset in of.items():
            found[JOINTS.index(f"{side}_{joint}")] = offset
    return found


def along_bones():
    """(22, 3, 3) orientations of an SMPL-like T-pose's joints with x along the bone, as LaFAN1 has them."""
    spine, leg = (
        np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]),
        np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]),
    )
    foot = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    found = np.broadcast_to(spine, (22, 3, 3)).copy()
    for side, arm in (("left", np.eye(3)), ("right", np.diag([-1.0, -1, 1]))):
        for joint in ("hip", "knee"):
            found[JOINTS.index(f"{side}_{joint}")] = leg
        for joint in ("ankle", "foot"):
            found[JOINTS.index(f"{side}_{joint}")] = foot
        for joint in ("collar", "shoulder", "elbow", "wrist"):
            found[JOINTS.index(f"{side}_{joint}")] = arm
    return found


def along_bones_mirrored():
    """The same as Bandai-Namco has them: the chest's z to the left, and x against the bone on the right side."""
    found = along_bones()
    for joint in ("spine1", "spine2", "spine3", "neck", "head"):
        found[JOINTS.index(joint)] = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    for number, joint in enumerate(JOINTS):
        if joint.startswith("right_"):
            found[number] = found[JOINTS.index(joint.replace("right", "left"))] @ np.diag([-1.0, 1, -1])
    return found


def write_bvh(
    path, motion, names, *, axes=Y_UP, rest=None, order="ZYX", leave_out=(), world=None, oriented=None
):
    """A BVH file of a motion, on a skeleton that rests with the offsets (22, 3); (T, 22) joint by joint.

    `axes` turns both skeleton and world, `world` (3, 3) the motion alone; `oriented` (22, 3, 3) are the joints' own
    axes at rest.
    """
    rest = (offsets() if rest is None else rest) @ axes.T
    local = Rotation.from_rotvec(motion.poses.reshape(-1, 3) @ axes.T).as_matrix().reshape(-1, 22, 3, 3)
    if world is not None:
        local[:, 0] = world @ local[:, 0]
    if oriented is not None:
        above = np.stack([np.eye(3), *(oriented[parent] for parent in PARENTS[1:])])
        rest = np.stack([offset @ turn for offset, turn in zip(rest, above, strict=True)])
        local = np.swapaxes(above, 1, 2) @ local @ oriented
    angles = Rotation.from_matrix(local.reshape(-1, 3, 3)).as_euler(order, degrees=True)
    angles = angles.reshape(*motion.poses.shape)
    channels = " ".join(f"{axis}rotation" for axis in order)
    numbers = []

    def joint(number, depth):
        numbers.append(number)
        pad = "  " * depth
        kind = "JOINT" if depth else "ROOT"
        position = "" if depth else "Xposition Yposition Zposition "
        lines = [f"{pad}{kind} {names[JOINTS[number]]}", f"{pad}{{"]
        lines += [f"{pad}  OFFSET {' '.join(map(str, rest[number]))}"]
        lines += [f"{pad}  CHANNELS {3 if depth else 6} {position}{channels}"]
        children = [n for n, parent in enumerate(PARENTS) if parent == number and JOINTS[n] not in leave_out]
        for child in children:
            lines += joint(child, depth + 1)
        if not children:
            lines += [f"{pad}  End Site", f"{pad}  {{", f"{pad}    OFFSET 0 5 0", f"{pad}  }}"]
        return [*lines, f"{pad}}}"]

    lines = [
        "HIERARCHY",
        *joint(0, 0),
        "MOTION",
        f"Frames: {len(motion.poses)}",
        f"Frame Time: {1 / motion.fps:.9f}",
    ]
    path_cm = motion.trans @ axes.T @ (np.eye(3) if world is None else world.T) * 82 / 0.8
    for frame in range(len(motion.poses)):
        row = np.concatenate([path_cm[frame], angles[frame][numbers].ravel()])
        lines.append(" ".join(f"{value:.6f}" for value in row))
    path.write_text("\n".join(lines) + "\n")
    return path
