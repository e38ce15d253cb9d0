import pytest

from services.mocap.body.humanoid_names import matched_joints
from services.mocap.body.skeleton import JOINT_NAMES

# What tools call: pelvis, neck, head, then of the left side shoulder, elbow, wrist, hip, knee, ankle.
SKELETONS = {
    "ours": "pelvis neck head left_shoulder left_elbow left_wrist left_hip left_knee left_ankle",
    "mixamo": "mixamorig:Hips mixamorig:Neck mixamorig:Head mixamorig:LeftArm mixamorig:LeftForeArm"
    " mixamorig:LeftHand mixamorig:LeftUpLeg mixamorig:LeftLeg mixamorig:LeftFoot",
    "poser": "hip neck head lShldr lForeArm lHand lThigh lShin lFoot",
    "unreal": "pelvis neck_01 head upperarm_l lowerarm_l hand_l thigh_l calf_l foot_l",
    "rigify": "DEF-hips DEF-neck DEF-head DEF-upper_arm.L DEF-forearm.L DEF-hand.L"
    " DEF-thigh.L DEF-shin.L DEF-foot.L",
    "smpl": "Pelvis Neck Head L_Shoulder L_Elbow L_Wrist L_Hip L_Knee L_Ankle",
    "vrm": "J_Bip_C_Hips J_Bip_C_Neck J_Bip_C_Head J_Bip_L_UpperArm J_Bip_L_LowerArm J_Bip_L_Hand"
    " J_Bip_L_UpperLeg J_Bip_L_LowerLeg J_Bip_L_Foot",
    "makehuman": "root neck01 head upperarm01.L lowerarm01.L wrist.L upperleg01.L lowerleg01.L foot.L",
}
OURS = SKELETONS["ours"].split()


@pytest.mark.parametrize("tool", SKELETONS)
def test_knows_the_names_of_tools(tool: str) -> None:
    names = SKELETONS[tool].split()
    found = matched_joints(names)
    assert [found[joint] for joint in OURS] == names


def test_tells_names_that_mean_other_things_beside_others() -> None:
    found = matched_joints(
        ["Hips", "LHipJoint", "LeftUpLeg", "LeftLeg", "LeftShoulder", "LeftArm", "L_Foot", "L_Ankle"]
    )
    assert found["left_shoulder"] == "LeftArm"
    assert found["left_knee"] == "LeftLeg"
    assert found["left_ankle"] == "L_Ankle"
    assert matched_joints(["RightShoulder", "RightElbow"])["right_shoulder"] == "RightShoulder"
    assert "right_hip" not in found


def test_finds_all_of_our_own_and_nothing_in_a_table() -> None:
    assert matched_joints(JOINT_NAMES) == {name: name for name in JOINT_NAMES}
    assert matched_joints(["table", "leg_of_table", "drawer_l"]) == {}
