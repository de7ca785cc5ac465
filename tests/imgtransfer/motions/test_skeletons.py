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
        "Claw. Names as in CMU, Mixamo or SMPL skeletons are wanted, or joints that says which they are "
        "(left_knee: Bone07)"
    )


def test_arms_that_hang_from_the_pelvis_have_no_spine():
    with pytest.raises(InputError, match="no joint for a spine between pelvis and arms"):
        named_joints(*body(), "crab.bvh")


def test_a_skeleton_of_nothing_has_no_joints():
    with pytest.raises(InputError, match=r"no joint for pelvis, head, left_hip, .*; it has "):
        named_joints([], [], "empty.bvh")


# Chains of joints as tools name them, {} for the side; and what is wanted: pelvis, hip, knee, ankle, toes, chest,
# collar, shoulder, elbow, wrist.
RIGS = """
biped L R
Bip01, Bip01 Pelvis, Bip01 Spine, Bip01 Spine1, Bip01 Neck, Bip01 Head
Bip01 Spine, Bip01 {} Thigh, Bip01 {} Calf, Bip01 {} Foot, Bip01 {} Toe0
Bip01 Neck, Bip01 {} Clavicle, Bip01 {} UpperArm, Bip01 {} Forearm, Bip01 {} Hand
Bip01 Pelvis, Bip01 {} Thigh, Bip01 {} Calf, Bip01 {} Foot, Bip01 {} Toe0, Bip01 Spine1, Bip01 {} Clavicle,\
 Bip01 {} UpperArm, Bip01 {} Forearm, Bip01 {} Hand

unreal l r
root, pelvis, spine_01, spine_02, spine_03, neck_01, head
pelvis, thigh_{}, calf_{}, foot_{}, ball_{}
spine_03, clavicle_{}, upperarm_{}, lowerarm_{}, hand_{}
pelvis, thigh_{}, calf_{}, foot_{}, ball_{}, spine_03, clavicle_{}, upperarm_{}, lowerarm_{}, hand_{}

poser l r
hip, abdomen, chest, neck, head
hip, {}Buttock, {}Thigh, {}Shin, {}Foot, {}Toe
chest, {}Collar, {}Shldr, {}ForeArm, {}Hand
hip, {}Thigh, {}Shin, {}Foot, {}Toe, chest, {}Collar, {}Shldr, {}ForeArm, {}Hand

daz l r
Genesis8Male, hip, abdomenLower, chestUpper, neckLower, neckUpper, head
hip, pelvis, {}ThighBend, {}ThighTwist, {}Shin, {}Foot, {}Toe
chestUpper, {}Collar, {}ShldrBend, {}ShldrTwist, {}ForearmBend, {}ForearmTwist, {}Hand
hip, {}ThighBend, {}Shin, {}Foot, {}Toe, chestUpper, {}Collar, {}ShldrBend, {}ForearmBend, {}Hand

blender L R
hips, spine, chest, neck, head
hips, thigh.{}, shin.{}, foot.{}, toe.{}
chest, shoulder.{}, upper_arm.{}, forearm.{}, hand.{}
hips, thigh.{}, shin.{}, foot.{}, toe.{}, chest, shoulder.{}, upper_arm.{}, forearm.{}, hand.{}

prefix Left Right
Model_Hips, Model_Spine, Model_Chest, Model_Neck, Model_Head
Model_Hips, Model_{}UpLeg, Model_{}Leg, Model_{}Foot, Model_{}ToeBase
Model_Chest, Model_{}Shoulder, Model_{}Arm, Model_{}ForeArm, Model_{}Hand
Model_Hips, Model_{}UpLeg, Model_{}Leg, Model_{}Foot, Model_{}ToeBase, Model_Chest, Model_{}Shoulder, Model_{}Arm,\
 Model_{}ForeArm, Model_{}Hand

bandai L R
joint_Root, Hips, Spine, Chest, Neck, Head
Hips, UpperLeg_{}, LowerLeg_{}, Foot_{}, Toes_{}
Chest, Shoulder_{}, UpperArm_{}, LowerArm_{}, Hand_{}
Hips, UpperLeg_{}, LowerLeg_{}, Foot_{}, Toes_{}, Chest, Shoulder_{}, UpperArm_{}, LowerArm_{}, Hand_{}

rokoko Left Right
Hips, Spine, Spine2, Spine4, Neck, Head
Hips, {}Thigh, {}Shin, {}Foot, {}Toe
Spine4, {}Shoulder, {}Arm, {}ForeArm, {}Hand
Hips, {}Thigh, {}Shin, {}Foot, {}Toe, Spine4, {}Shoulder, {}Arm, {}ForeArm, {}Hand

optitrack L R
A:Hip, A:Ab, A:Chest, A:Neck, A:Head
A:Hip, A:{}Thigh, A:{}Shin, A:{}Foot, A:{}Toe
A:Chest, A:{}Shoulder, A:{}UArm, A:{}FArm, A:{}Hand
A:Hip, A:{}Thigh, A:{}Shin, A:{}Foot, A:{}Toe, A:Chest, A:{}Shoulder, A:{}UArm, A:{}FArm, A:{}Hand

asf l r
root, lowerback, upperback, thorax, lowerneck, upperneck, head
root, {}hipjoint, {}femur, {}tibia, {}foot, {}toes
thorax, {}clavicle, {}humerus, {}radius, {}wrist, {}hand
root, {}femur, {}tibia, {}foot, {}toes, thorax, {}clavicle, {}humerus, {}radius, {}wrist

kinect LEFT RIGHT
PELVIS, SPINE_NAVAL, SPINE_CHEST, NECK, HEAD
PELVIS, HIP_{}, KNEE_{}, ANKLE_{}, FOOT_{}
SPINE_CHEST, CLAVICLE_{}, SHOULDER_{}, ELBOW_{}, WRIST_{}, HAND_{}
PELVIS, HIP_{}, KNEE_{}, ANKLE_{}, FOOT_{}, SPINE_CHEST, CLAVICLE_{}, SHOULDER_{}, ELBOW_{}, WRIST_{}

maya L R
Root_M, Spine1_M, Chest_M, Neck_M, Head_M
Root_M, Hip_{}, Knee_{}, Ankle_{}, Toes_{}
Chest_M, Scapula_{}, Shoulder_{}, Elbow_{}, Wrist_{}
Root_M, Hip_{}, Knee_{}, Ankle_{}, Toes_{}, Chest_M, Scapula_{}, Shoulder_{}, Elbow_{}, Wrist_{}

vroid L R
Root, J_Bip_C_Hips, J_Bip_C_Chest, J_Bip_C_Neck, J_Bip_C_Head, J_Sec_Hair1, J_Sec_Hair2, J_Sec_Hair3
J_Bip_C_Hips, J_Bip_{}_UpperLeg, J_Bip_{}_LowerLeg, J_Bip_{}_Foot, J_Bip_{}_ToeBase
J_Bip_C_Chest, J_Bip_{}_Shoulder, J_Bip_{}_UpperArm, J_Bip_{}_LowerArm, J_Bip_{}_Hand
J_Bip_C_Hips, J_Bip_{}_UpperLeg, J_Bip_{}_LowerLeg, J_Bip_{}_Foot, J_Bip_{}_ToeBase, J_Bip_C_Chest,\
 J_Bip_{}_Shoulder, J_Bip_{}_UpperArm, J_Bip_{}_LowerArm, J_Bip_{}_Hand
"""
FOUND = ("pelvis", "{}_hip", "{}_knee", "{}_ankle", "{}_foot", "spine3", "{}_collar", "{}_shoulder", "{}_elbow",
         "{}_wrist")  # fmt: skip


@pytest.mark.parametrize("rig", RIGS.strip().split("\n\n"), ids=lambda rig: rig.split()[0])
def test_the_rigs_of_other_tools_are_known(rig):
    sides, *rows = rig.split("\n")
    *chains, wanted = (row.split(", ") for row in rows)
    letters = sides.split()[1:]
    joints = found(
        *skeleton(*([name.format(side) for name in chain] for side in letters for chain in chains))
    )
    for side, letter in zip(("left", "right"), letters, strict=True):
        assert [joints[joint.format(side)] for joint in FOUND] == [name.format(letter) for name in wanted]


def test_a_name_taken_for_another_joint_is_refused_with_the_flag():
    names, parents = body("Spine", "Chest")
    parents[names.index("LeftLeg")] = names.index("Hips")
    with pytest.raises(
        InputError, match="left_knee was taken to be LeftLeg, which does not hang from LeftUpLeg"
    ):
        named_joints(names, parents, "file.bvh")
