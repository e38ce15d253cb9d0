"""The table of the body: a row for each segment and the joint that carries it.

How many parameters, joints and segments there are follows from it (skeleton.py), and so does what the search
moves, what a fit may change, and what the files list. The body of Theobalt et al. 2003 is the same without
the parameters marked in_paper=False: those of the waist, as its trunk is rigid.

The rest pose (all parameters zero) is an upright T pose: x forward, y to the actor's left, z up; arms
along ±y with the palms down, legs straight down. Every joint frame is parallel to the body frame there.
A parameter means the same movement on both sides (positive elbow flexion bends either elbow).

Rotations: a joint turns by a swing (the rotation vector made of its swing parameters) after a twist about
the bone. This keeps ball joints free of gimbal lock wherever the swing stays below half a turn. The root
turns by heading about z, then side lean about x, then pitch about y; its only singularity is a side lean
of a quarter turn. The T pose is the shoulder's zero, so an arm hanging down, forward or overhead has a swing
of about a quarter turn.

Joint centres in body heights follow de Leva 1996 (J. Biomechanics 29(9)) and Drillis and Contini 1966.
Deviations and ranges of lengths follow the spread over both sexes in the 2012 US Army survey (Gordon et al.
2014, NATICK/TR-15/007) of each measure over stature, with room for heavier people, children and clothes.
Those of the arm, 0.034 and 0.046 in that survey, are wider here, as body models differ in where they put its
joints: over stature, MakeHuman's upper arm is 7 % shorter than de Leva's, and its forearm 9 %. Mean factors
are over stature: of arms those of women and men in de Leva, from joint centre to joint centre; of legs those
of the heights of trochanter, epicondyle and malleolus in the survey.
The waist stands for the lumbar and the thoracic spine. Young adults flex the lumbar spine by 73, extend it by
29 and bend it sideways by 28 degrees (Troke et al. 2005, Manual Therapy 10, 198-206); the thoracic spine adds
to the bending and does nearly all the turning (White and Panjabi 1990, Clinical Biomechanics of the Spine).
In motions of 30 people, recorded at Carnegie Mellon University or made by a model that learnt from such
recordings, shoulders lean by up to 46 degrees against hips, and thighs are spread by up to 94 and turned by
up to 69 degrees; the limits leave out the last few. A lunge bends a loaded ankle by about 40 degrees (Konor
et al. 2012, Int. J. Sports Physical Therapy 7(3)).
Windows are those of Theobalt et al. 2003, section 4.2. In the T pose an arm's width is its height, palms
down, and the depth of a hand its thickness; a foot runs from heel to toes, its depth from sole to instep.
"""

from services.mocap.body import shape_profiles as shapes
from services.mocap.body.segment_row import Length, Parameter, Section, SegmentRow, Tip, Turns

_X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
_BACK, _RIGHT, _DOWN = (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)
_WHOLE_PICTURE, _LIMB_WINDOW_PX, EXTREMITY_WINDOW_PX = 0, 128, 64


def _controls(prefix: str, *places: str) -> tuple[str, ...]:
    return tuple(f"{prefix}_{place}" for place in places)


PELVIS = SegmentRow(
    name="pelvis", joint="pelvis", parent=None, offset_heights=(0.0, 0.0, 0.0), offset_bones={},
    paired=False, part="torso", window_px=_WHOLE_PICTURE,
    parameters=(
        Parameter("root_x", "translation", _X),
        Parameter("root_y", "translation", _Y),
        Parameter("root_z", "translation", _Z),
        Parameter("root_heading", "heading", _Z),
        Parameter("root_lean", "lean", _X),
        Parameter("root_pitch", "pitch", _Y),
    ),
    angles=(
        Turns("YXZ", (
            ("pelvis_rotation", 1, "turned to the left about up; 0 along the world's x axis (z-up)"),
            ("pelvis_list", 1, "leaning to the right"),
            ("pelvis_tilt", -1, "leaning forward"),
        )),
    ),
    lengths=(
        Length("hip_width", 0.105, "", 0.08, 0.65, 1.5),
        Length("pelvis", 0.087, "z", 0.08, 0.65, 1.5, looks_changed_by_clothes=True),
    ),
    section=Section("zyx", 0.0, 0.087),
    width=_controls("trunk_width", "hip", "belly", "waist"),
    depth=_controls("trunk_depth", "hip", "belly", "waist"),
    lofts=shapes.PELVIS, garment="trousers", continued_by="torso",
    aliases=("hips", "pelvis", "hip", "root"),
    tool_names={"mixamo": "Hips", "cmu": "Hips", "unity": "Hips"},
)  # fmt: skip

TORSO = SegmentRow(
    name="torso", joint="waist", parent="pelvis",
    offset_heights=(0.0, 0.0, 0.087), offset_bones={"z": "pelvis"},
    paired=False, part="torso", window_px=_WHOLE_PICTURE,
    parameters=(
        Parameter("waist_pitch", "swing", _Y, -30.0, 70.0, rest=0.1, in_paper=False),
        Parameter("waist_lean", "swing", _X, -45.0, 45.0, rest=0.1, in_paper=False),
        Parameter("waist_turn", "twist", _Z, -45.0, 45.0, rest=0.3, in_paper=False),
    ),
    angles=(
        Turns("ZXY", (
            ("trunk_flexion", -1, "trunk forward over the pelvis"),
            ("trunk_lateral_bending", 1, "trunk to the right"),
            ("trunk_rotation", 1, "trunk to the left"),
        )),
    ),
    lengths=(
        Length("torso", 0.248, "z", 0.05, 0.70, 1.45, looks_changed_by_clothes=True),
        Length("shoulder_width", 0.215, "", 0.06, 0.70, 1.45),
    ),
    section=Section("zyx", 0.0, 0.248),
    width=_controls("trunk_width", "waist", "ribs", "chest", "top"),
    depth=_controls("trunk_depth", "waist", "ribs", "chest", "top"),
    lofts=shapes.TORSO, garment="shirt",
    aliases=("waist", "lowerback", "abdomen", "abdomenlower", "tospine", "spine", "chest", "torso"),
    tool_names={"mixamo": "Spine", "cmu": "LowerBack", "unity": "Spine"},
)  # fmt: skip

NECK = SegmentRow(
    name="neck", joint="neck", parent="waist",
    offset_heights=(0.0, 0.0, 0.248), offset_bones={"z": "torso"},
    paired=False, part="head", window_px=EXTREMITY_WINDOW_PX,
    parameters=(
        Parameter("head_pitch", "swing", _Y, -60.0, 70.0),
        Parameter("head_lean", "swing", _X, -50.0, 50.0),
        Parameter("head_turn", "twist", _Z, -80.0, 80.0),
    ),
    angles=(
        Turns("ZXY", (
            ("neck_flexion", -1, "head forward"),
            ("neck_lateral_bending", 1, "head to the right shoulder"),
            ("neck_rotation", 1, "face to the left"),
        )),
    ),
    lengths=(Length("neck", 0.058, "z", 0.08, 0.60, 1.7),),
    section=Section("zyx", 0.0, 0.058), width=("neck_girth",), depth=("neck_girth",),
    lofts=shapes.NECK, garment="skin",
    aliases=("neck", "necklower", "lowerneck"),
    tool_names={"mixamo": "Neck", "cmu": "Neck", "unity": "Neck"},
)  # fmt: skip

HEAD = SegmentRow(
    name="head", joint="head", parent="neck",
    offset_heights=(0.006, 0.0, 0.058), offset_bones={"z": "neck"},
    paired=False, part="head", window_px=EXTREMITY_WINDOW_PX,
    parameters=(), angles=(),
    lengths=(Length("head", 0.094, "xyz", 0.10, 0.70, 1.6),),
    section=Section("zyx", 0.0, 0.094), width=("head_width",), depth=("head_depth",),
    lofts=shapes.HEAD, garment="skin",
    aliases=("head",),
    tool_names={"mixamo": "Head", "cmu": "Head", "unity": "Head"},
    tip=Tip((0.010, 0.0, 0.094), "head_top", ("headtop", "headtopend", "headend", "headnub", "headsite")),
)  # fmt: skip

UPPER_ARM = SegmentRow(
    name="upper_arm", joint="shoulder", parent="waist",
    offset_heights=(0.0, 0.1075, 0.200), offset_bones={"y": "shoulder_width", "z": "torso"},
    paired=True, part="arm", window_px=_LIMB_WINDOW_PX,
    parameters=(
        Parameter("shoulder_elevation", "swing", _X, -115.0, 100.0),
        Parameter("shoulder_forward", "swing", _DOWN, -70.0, 140.0),
        # Outward by 150 degrees, to which the shoulder blade adds its part: hands on the head need 130 and
        # more, a pitcher 170 (Fleisig et al., Journal of Applied Biomechanics 12, 1996).
        Parameter("shoulder_twist", "twist", _RIGHT, -100.0, 150.0, rest=0.1),
    ),
    angles=(
        Turns("ZXY", (
            ("shoulder_flexion", 1, "arm forward"),
            ("shoulder_adduction", 1, "arm to the trunk; abduction is negative"),
            ("shoulder_rotation", 1, "inward (internal)"),
        )),
        Turns("YXY", (
            ("shoulder_plane_of_elevation", 1, "in which the arm is raised: 0 sideways, 90 forward"),
            ("shoulder_elevation", -1, "arm away from hanging, in that plane; 0 to 180"),
            ("shoulder_axial_rotation", 1, "inward (internal), after both"),
        )),
    ),
    lengths=(Length("upper_arm", 0.165, "y", 0.07, 0.75, 1.30, mean_factor=0.97),),
    section=Section("yzx", 0.0, 0.165),
    width=_controls("arm_girth", "shoulder", "biceps", "elbow"),
    depth=_controls("arm_girth", "shoulder", "biceps", "elbow"),
    lofts=shapes.UPPER_ARM, garment="shirt", continued_by="forearm",
    aliases=("upperarm", "uparm", "shldr", "shldrbend", "arm", "humerus", "shoulder"),
    tool_names={"mixamo": "Arm", "cmu": "Arm", "unity": "UpperArm"},
)  # fmt: skip

FOREARM = SegmentRow(
    name="forearm", joint="elbow", parent="shoulder",
    offset_heights=(0.0, 0.165, 0.0), offset_bones={"y": "upper_arm"},
    paired=True, part="arm", window_px=_LIMB_WINDOW_PX,
    parameters=(Parameter("elbow_flexion", "swing", _DOWN, 0.0, 150.0),),
    angles=(Turns("ZXY", (("elbow_flexion", 1, "forearm to the upper arm"),)),),
    lengths=(Length("forearm", 0.152, "y", 0.08, 0.75, 1.30, mean_factor=1.01),),
    section=Section("yzx", 0.0, 0.152),
    width=_controls("arm_girth", "elbow", "forearm", "wrist"),
    depth=_controls("arm_girth", "elbow", "forearm", "wrist"),
    lofts=shapes.FOREARM, garment="skin",
    aliases=("elbow", "forearm", "lowerarm", "lowarm", "lorearm", "forearmbend", "radius"),
    tool_names={"mixamo": "ForeArm", "cmu": "ForeArm", "unity": "LowerArm"},
)  # fmt: skip

HAND = SegmentRow(
    name="hand", joint="wrist", parent="elbow",
    offset_heights=(0.0, 0.152, 0.0), offset_bones={"y": "forearm"},
    paired=True, part="arm", window_px=EXTREMITY_WINDOW_PX,
    parameters=(
        Parameter("wrist_flexion", "swing", _BACK, -75.0, 80.0, rest=1.0),
        Parameter("wrist_deviation", "swing", _DOWN, -35.0, 25.0, rest=1.0),
        Parameter("wrist_twist", "twist", _RIGHT, -90.0, 90.0, rest=0.1),
    ),
    angles=(
        Turns("YXZ", (
            ("forearm_pronation", 1, "thumb inward from pointing forward; supination is negative"),
            ("wrist_flexion", 1, "palm to the forearm"),
            ("wrist_deviation", -1, "hand to the little finger's side (ulnar)"),
        )),
    ),
    lengths=(Length("hand", 0.108, "xyz", 0.045, 0.70, 1.5),),
    section=Section("yxz", 0.0, 0.108), width=("hand_girth",), depth=("hand_girth",),
    lofts=shapes.HAND, garment="skin",
    aliases=("wrist", "hand"),
    tool_names={"mixamo": "Hand", "cmu": "Hand", "unity": "Hand"},
    tip=Tip((0.0, 0.108, 0.0)),
)  # fmt: skip

THIGH = SegmentRow(
    name="thigh", joint="hip", parent="pelvis",
    offset_heights=(0.0, 0.0525, 0.0), offset_bones={"y": "hip_width"},
    paired=True, part="leg", window_px=_LIMB_WINDOW_PX,
    parameters=(
        Parameter("hip_flexion", "swing", _RIGHT, -40.0, 130.0),
        Parameter("hip_abduction", "swing", _X, -35.0, 90.0),
        Parameter("hip_twist", "twist", _DOWN, -65.0, 65.0, rest=0.1),
    ),
    angles=(
        Turns("ZXY", (
            ("hip_flexion", 1, "thigh forward"),
            ("hip_adduction", 1, "thigh to the other one; abduction is negative"),
            ("hip_rotation", 1, "inward (internal)"),
        )),
    ),
    lengths=(Length("thigh", 0.231, "z", 0.05, 0.75, 1.30, mean_factor=1.02, looks_changed_by_clothes=True),),
    section=Section("zyx", 0.0, -0.231),
    width=_controls("leg_girth", "hip", "thigh", "knee"),
    depth=_controls("leg_girth", "hip", "thigh", "knee"),
    lofts=shapes.THIGH, garment="trousers", continued_by="shank",
    aliases=("upleg", "upperleg", "thigh", "thighbend", "femur", "hip"),
    tool_names={"mixamo": "UpLeg", "cmu": "UpLeg", "unity": "UpperLeg"},
)  # fmt: skip

SHANK = SegmentRow(
    name="shank", joint="knee", parent="hip",
    offset_heights=(0.0, 0.0, -0.231), offset_bones={"z": "thigh"},
    paired=True, part="leg", window_px=_LIMB_WINDOW_PX,
    parameters=(Parameter("knee_flexion", "swing", _Y, -8.0, 150.0),),
    angles=(Turns("ZXY", (("knee_flexion", -1, "heel to the buttocks"),)),),
    lengths=(
        Length("shank", 0.242, "z", 0.05, 0.75, 1.30, mean_factor=1.005, looks_changed_by_clothes=True),
    ),
    section=Section("zyx", 0.0, -0.242),
    width=_controls("leg_girth", "knee", "calf", "ankle"),
    depth=_controls("leg_girth", "knee", "calf", "ankle"),
    lofts=shapes.SHANK, garment="trousers",
    aliases=("knee", "lowleg", "lowerleg", "shin", "calf", "shank", "tibia", "leg"),
    tool_names={"mixamo": "Leg", "cmu": "Leg", "unity": "LowerLeg"},
)  # fmt: skip

FOOT = SegmentRow(
    name="foot", joint="ankle", parent="knee",
    offset_heights=(0.0, 0.0, -0.242), offset_bones={"z": "shank"},
    paired=True, part="leg", window_px=EXTREMITY_WINDOW_PX,
    parameters=(
        Parameter("ankle_flexion", "swing", _RIGHT, -55.0, 45.0, rest=0.3),
        Parameter("ankle_inversion", "swing", _BACK, -30.0, 30.0, rest=0.3),
    ),
    angles=(
        Turns("ZXY", (
            ("ankle_dorsiflexion", 1, "toes up; plantarflexion is negative"),
            ("ankle_inversion", 1, "sole inward; eversion is negative"),
            ("ankle_rotation", 1, "toes inward (internal)"),
        )),
    ),
    lengths=(Length("foot", 0.148, "xy", 0.045, 0.70, 1.5),),
    section=Section("xyz", -0.031, 0.117), width=("foot_width",), depth=("foot_depth",),
    lofts=shapes.FOOT, garment="shoes",
    aliases=("ankle", "foot"),
    tool_names={"mixamo": "Foot", "cmu": "Foot", "unity": "Foot"},
    tip=Tip((0.113, 0.0, -0.040)),
)  # fmt: skip

ROWS = (PELVIS, TORSO, NECK, HEAD, UPPER_ARM, FOREARM, HAND, THIGH, SHANK, FOOT)
"""Parents before their children."""
