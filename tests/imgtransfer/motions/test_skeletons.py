"""Joints found by their names, on skeletons as other programs name them."""

import pytest

from imgtransfer.bodies.smpl import JOINTS, PARENTS
from imgtransfer.motions.skeletons import named_joints
from render import InputError
from tests.helpers.bvh_files import NAMINGS


def skeleton(*chains):
    """Names and parents of chains of names; a chain's first name is a joint that there is, but for the root."""
    names, parents = [], []
    for chain in chains:
        for above, name in zip([None, *chain], chain, strict=False):
            if name not in names:
                names.append(name)
                parents.append(-1 if above is None else names.index(above))
    return names, parents


ARMS = [[f"{s}Shoulder", f"{s}Arm", f"{s}ForeArm", f"{s}Hand"] for s in ("Left", "Right")]
LEGS = [["Hips", f"{s}UpLeg", f"{s}Leg", f"{s}Foot", f"{s}ToeBase"] for s in ("Left", "Right")]


def body(*spine, legs=LEGS, arms=ARMS):
    chest = spine[-1] if spine else "Hips"
    return skeleton(["Hips", *spine], *legs, [chest, "Neck", "Head"], *([chest, *arm] for arm in arms))


def found(names, parents):
    return {joint: names[number] for joint, number in named_joints(names, parents, "file.bvh").items()}


@pytest.mark.parametrize("naming", NAMINGS)
def test_all_joints_of_known_skeletons_are_found(naming):
    names = [NAMINGS[naming][joint] for joint in JOINTS]
    assert named_joints(names, PARENTS, "file.bvh") == {joint: number for number, joint in enumerate(JOINTS)}


def test_a_foot_without_toes_is_the_ankle_and_one_with_an_ankle_the_toes():
    bare = [leg[:-1] for leg in LEGS]
    joints = found(*body("Spine", "Chest", legs=bare))
    assert joints["left_ankle"] == "LeftFoot"
    assert "left_foot" not in joints
    ankles = [["Hips", f"{s}Hip", f"{s}Knee", f"{s}Ankle", f"{s}Foot"] for s in ("Left", "Right")]
    joints = found(*body("Spine", "Chest", legs=ankles))
    assert (joints["right_ankle"], joints["right_foot"]) == ("RightAnkle", "RightFoot")


def test_a_shoulder_above_an_arm_is_the_collar_and_alone_the_shoulder():
    assert found(*body("Spine", "Chest"))["left_collar"] == "LeftShoulder"
    short = [[f"{s}Shoulder", f"{s}Elbow", f"{s}Wrist"] for s in ("Left", "Right")]
    joints = found(*body("Spine", "Chest", arms=short))
    assert joints["left_shoulder"] == "LeftShoulder"
    assert "left_collar" not in joints


@pytest.mark.parametrize(("spine", "wanted"), [
    (["A"], [None, None, "A"]),
    (["A", "B"], ["A", None, "B"]),
    (["A", "B", "C"], ["A", "B", "C"]),
    (["A", "B", "C", "D"], ["A", "C", "D"]),
    (["A", "B", "C", "D", "E"], ["A", "C", "E"]),
])  # fmt: skip
def test_the_spine_is_the_chain_to_the_chest_whatever_it_is_called(spine, wanted):
    joints = found(*body(*spine))
    assert [joints.get(f"spine{number}") for number in (1, 2, 3)] == wanted


@pytest.mark.parametrize(
    "name",
    [
        "mixamorig:LeftUpLeg",
        "mixamorigLeftUpLeg",
        "left_up_leg",
        "LEFTUPLEG",
        "Skel01:L_Thigh",
        "m_avg_L_Hip",
        "f_avg_L_Hip",
    ],
)
def test_prefixes_and_spelling_do_not_matter(name):
    names, parents = body("Spine", "Chest")
    names[names.index("LeftUpLeg")] = name
    assert found(names, parents)["left_hip"] == name


def test_of_two_joints_with_one_name_the_first_counts():
    names, parents = body("Spine", "Chest")
    names, parents = [*names, "extra:Head"], [*parents, names.index("LeftHand")]
    assert named_joints(names, parents, "file.bvh")["head"] == names.index("Head")


def test_what_is_missing_is_named_with_what_there_is():
    names, parents = body("Spine", "Chest")
    names[names.index("RightHand")], names[names.index("LeftLeg")] = "Claw", "Wheel"
    with pytest.raises(InputError) as caught:
        named_joints(names, parents, "robot.bvh")
    message = str(caught.value)
    assert message.startswith(
        "robot.bvh: the skeleton has no joint for left_knee, right_wrist; it has Hips, Spine,"
    )
    assert message.endswith(
        "Claw. Names as in CMU, Mixamo or SMPL skeletons are wanted, or --joints FILE that says which they are "
        "(left_knee: Bone07)"
    )


def test_arms_that_hang_from_the_pelvis_have_no_spine():
    with pytest.raises(InputError, match="no joint for a spine between pelvis and arms"):
        named_joints(*body(), "crab.bvh")


def test_a_skeleton_of_nothing_has_no_joints():
    with pytest.raises(InputError, match=r"no joint for pelvis, head, left_hip, .*; it has "):
        named_joints([], [], "empty.bvh")
