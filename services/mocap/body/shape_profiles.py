"""The generic actor's shape as numbers: tables of cross-sections along each bone, all in body heights.

Breadths, depths, girths and heights of landmarks follow the 2012 US Army survey (Gordon et al. 2014,
NATICK/TR-15/007), each divided by stature, between the sexes and on its slender side, as the survey's
soldiers are heavier than most actors. How an outline runs between the measured places is drawn by eye.
Where the flesh of the legs lies about the axes through the joints follows the mean of 40 random adults of
MakeHuman (CC0): calves lie behind and outside of the line from knee to ankle, lower thighs inside of the line
from hip to knee, and feet outside of the ankle. The heel reaches as far back as in Delp et al. 1990 (IEEE
Trans. Biomed. Eng. 37(8)), where its bone ends 49 mm behind the ankle in a person of 1.8 m.
"""

from services.mocap.body.shape_loft import Bump, Loft, Stations


def _centred(*rows: tuple[float, float, float, float, float, float]) -> Stations:
    """Stations symmetric across, from (along, half width, back, front, squareness of back and front)."""
    return tuple((row[0], -row[1], *row[1:]) for row in rows)


def _oval(*rows: tuple[float, float, float, float, float]) -> Stations:
    """Elliptic stations, from (along, lowest and highest across, lowest and highest depth)."""
    return tuple((*row, 2.0, 2.0) for row in rows)


def _pair(left: Bump) -> tuple[Bump, Bump]:
    """A bump on the left and its mirror image."""
    (x, y, z), (push_x, push_y, push_z) = left.centre, left.push
    return left, Bump((x, -y, z), left.spread, (push_x, -push_y, push_z))


_WAIST = 0.087
"""Height of the waist over the pelvis joint (skeleton_table.py)."""

# Pelvis and torso in one table, z from the pelvis joint, so that the two meet without a step.
_TRUNK = _centred(
    (-0.054, 0.0800, -0.0600, 0.0460, 2.0, 2.0),
    (-0.018, 0.0960, -0.0770, 0.0560, 2.3, 2.2),
    (0.007, 0.0975, -0.0800, 0.0580, 2.4, 2.3),
    (0.032, 0.0945, -0.0750, 0.0600, 2.4, 2.3),
    (0.057, 0.0890, -0.0660, 0.0620, 2.4, 2.3),
    (0.087, 0.0830, -0.0580, 0.0630, 2.4, 2.3),
    (0.112, 0.0800, -0.0550, 0.0620, 2.4, 2.3),
    (0.137, 0.0805, -0.0560, 0.0610, 2.4, 2.4),
    (0.172, 0.0840, -0.0610, 0.0630, 2.4, 2.4),
    (0.207, 0.0880, -0.0670, 0.0670, 2.4, 2.4),
    (0.227, 0.0905, -0.0690, 0.0680, 2.4, 2.4),
    (0.252, 0.0985, -0.0700, 0.0640, 2.4, 2.4),
    (0.274, 0.1110, -0.0680, 0.0550, 2.3, 2.3),
    (0.294, 0.1170, -0.0620, 0.0450, 2.1, 2.1),
    (0.310, 0.1130, -0.0550, 0.0360, 2.0, 2.0),
    (0.321, 0.0900, -0.0500, 0.0300, 2.0, 2.0),
    (0.332, 0.0630, -0.0460, 0.0270, 2.0, 2.0),
    (0.346, 0.0430, -0.0420, 0.0270, 2.0, 2.0),
    (0.364, 0.0340, -0.0350, 0.0280, 2.0, 2.0),
)
_UPPER_TRUNK: Stations = tuple((row[0] - _WAIST, *row[1:]) for row in _TRUNK)
_NECK = _centred(
    (-0.040, 0.034, -0.034, 0.028, 2.0, 2.0),
    (0.000, 0.035, -0.038, 0.030, 2.0, 2.0),
    (0.020, 0.0335, -0.035, 0.031, 2.0, 2.0),
    (0.045, 0.033, -0.031, 0.034, 2.0, 2.0),
    (0.090, 0.032, -0.026, 0.037, 2.0, 2.0),
)
_HEAD = _centred(
    (-0.042, 0.022, 0.008, 0.046, 2.0, 2.2),
    (-0.034, 0.027, -0.004, 0.054, 2.0, 2.2),
    (-0.024, 0.0325, -0.018, 0.0555, 2.0, 2.2),
    (-0.010, 0.0370, -0.033, 0.0555, 2.0, 2.2),
    (0.004, 0.0395, -0.043, 0.0560, 2.1, 2.2),
    (0.020, 0.0415, -0.050, 0.0565, 2.2, 2.2),
    (0.035, 0.0430, -0.0545, 0.0570, 2.2, 2.2),
    (0.050, 0.0438, -0.0565, 0.0580, 2.2, 2.2),
    (0.065, 0.0438, -0.0565, 0.0575, 2.2, 2.2),
    (0.094, 0.0430, -0.0530, 0.0530, 2.2, 2.2),
)
# Arms: y from the joint outwards; across is down and up, depth back and front.
_UPPER_ARM = _oval(
    (-0.032, -0.0260, 0.0200, -0.0310, 0.0285),
    (0.000, -0.0295, 0.0270, -0.0345, 0.0320),
    (0.025, -0.0325, 0.0310, -0.0350, 0.0340),
    (0.050, -0.0310, 0.0300, -0.0330, 0.0325),
    (0.080, -0.0275, 0.0265, -0.0300, 0.0305),
    (0.110, -0.0255, 0.0240, -0.0275, 0.0295),
    (0.140, -0.0225, 0.0220, -0.0240, 0.0255),
    (0.165, -0.0215, 0.0215, -0.0235, 0.0235),
    (0.190, -0.0200, 0.0200, -0.0225, 0.0225),
)
_FOREARM = _oval(
    (-0.024, -0.0205, 0.0205, -0.0230, 0.0225),
    (0.000, -0.0215, 0.0215, -0.0235, 0.0235),
    (0.032, -0.0240, 0.0245, -0.0250, 0.0265),
    (0.055, -0.0230, 0.0235, -0.0240, 0.0255),
    (0.090, -0.0190, 0.0195, -0.0205, 0.0215),
    (0.125, -0.0145, 0.0150, -0.0175, 0.0180),
    (0.152, -0.0130, 0.0135, -0.0175, 0.0180),
    (0.168, -0.0130, 0.0135, -0.0180, 0.0185),
)
# Hand: across is from the little finger's side to the thumb's, depth from palm to back.
_PALM: Stations = (
    (-0.014, -0.0165, 0.0170, -0.0120, 0.0125, 2.0, 2.0),
    (0.000, -0.0175, 0.0180, -0.0125, 0.0125, 2.0, 2.0),
    (0.020, -0.0200, 0.0210, -0.0125, 0.0110, 2.2, 2.2),
    (0.040, -0.0235, 0.0235, -0.0110, 0.0090, 2.5, 2.5),
    (0.058, -0.0240, 0.0235, -0.0095, 0.0075, 2.6, 2.6),
    (0.070, -0.0230, 0.0225, -0.0090, 0.0065, 2.6, 2.6),
)
_THUMB = _oval(
    (0.008, 0.0000, 0.0210, -0.0150, 0.0040),
    (0.025, 0.0110, 0.0310, -0.0160, 0.0010),
    (0.042, 0.0210, 0.0370, -0.0165, -0.0025),
    (0.055, 0.0270, 0.0410, -0.0170, -0.0045),
    (0.068, 0.0320, 0.0440, -0.0175, -0.0065),
)
# Thigh and shank: across is from the inner to the outer side of the left leg, depth from back to front.
_THIGH = _oval(
    (-0.266, -0.0310, 0.0290, -0.0345, 0.0340),
    (-0.231, -0.0330, 0.0300, -0.0360, 0.0365),
    (-0.213, -0.0353, 0.0293, -0.0370, 0.0375),
    (-0.178, -0.0378, 0.0318, -0.0400, 0.0415),
    (-0.128, -0.0435, 0.0365, -0.0475, 0.0495),
    (-0.078, -0.0500, 0.0415, -0.0580, 0.0550),
    (-0.043, -0.0540, 0.0440, -0.0670, 0.0570),
    (-0.018, -0.0545, 0.0455, -0.0715, 0.0560),
    (0.012, -0.0500, 0.0430, -0.0690, 0.0525),
    (0.060, -0.0400, 0.0360, -0.0500, 0.0420),
)
_SHANK = _oval(
    (-0.264, -0.0190, 0.0210, -0.0240, 0.0210),
    (-0.242, -0.0185, 0.0225, -0.0250, 0.0215),
    (-0.220, -0.0143, 0.0227, -0.0250, 0.0200),
    (-0.195, -0.0136, 0.0244, -0.0275, 0.0190),
    (-0.150, -0.0182, 0.0288, -0.0360, 0.0200),
    (-0.100, -0.0260, 0.0370, -0.0460, 0.0235),
    (-0.070, -0.0283, 0.0393, -0.0475, 0.0255),
    (-0.030, -0.0283, 0.0343, -0.0415, 0.0305),
    (0.000, -0.0325, 0.0305, -0.0367, 0.0353),
    (0.034, -0.0315, 0.0285, -0.0343, 0.0343),
)
# Foot, in a shoe but for its sole: x from the ankle joint; across is from the inner to the outer side, depth
# from sole to instep.
_FOOT: Stations = (
    (-0.031, -0.0160, 0.0160, -0.040, -0.008, 4.0, 2.0),
    (-0.021, -0.0185, 0.0185, -0.040, 0.005, 4.0, 2.0),
    (-0.011, -0.0175, 0.0205, -0.040, 0.0155, 4.0, 2.0),
    (0.001, -0.0165, 0.0225, -0.040, 0.0230, 4.0, 2.0),
    (0.014, -0.0160, 0.0250, -0.040, 0.0230, 4.0, 2.0),
    (0.033, -0.0168, 0.0276, -0.040, 0.0125, 4.0, 2.0),
    (0.053, -0.0207, 0.0313, -0.040, -0.0030, 4.0, 2.2),
    (0.078, -0.0247, 0.0333, -0.040, -0.0165, 4.0, 2.4),
    (0.095, -0.0275, 0.0285, -0.040, -0.0210, 4.0, 2.5),
    (0.108, -0.0263, 0.0217, -0.040, -0.0240, 4.0, 2.5),
    (0.117, -0.0220, 0.0140, -0.040, -0.0265, 4.0, 2.5),
)


def _finger(base: float, tip: float, reach: float, half_width: float) -> Loft:
    """A slightly bent finger from inside the palm to `reach`; its centre runs from `base` to `tip` across."""
    start, half_depth, drop = 0.050, 0.0058, 0.008
    rows = []
    for part, girth in ((0.0, 1.0), (0.35, 1.0), (0.7, 0.95), (1.0, 0.88)):
        across, depth = base + (tip - base) * part, -0.001 - drop * part**1.5
        a, d = half_width * girth, half_depth * girth
        rows.append((start + (reach - start) * part, across - a, across + a, depth - d, depth + d))
    return Loft("yxz", _oval(*rows), start, reach, half_width, half_width)


_BUTTOCKS = _pair(Bump((-0.075, 0.042, 0.000), (0.030, 0.030, 0.028), (-0.010, 0.0, 0.0)))
_CHEST = _pair(Bump((0.065, 0.042, 0.128), (0.030, 0.028, 0.024), (0.011, 0.0, -0.002)))
_NOSE = Bump((0.060, 0.0, 0.010), (0.020, 0.0075, 0.009), (0.014, 0.0, -0.002))
_CHIN = Bump((0.054, 0.0, -0.030), (0.020, 0.012, 0.007), (0.004, 0.0, 0.0))
_EARS = _pair(Bump((0.000, 0.041, 0.018), (0.008, 0.020, 0.013), (-0.002, 0.009, 0.0)))
_KNEECAP = Bump((0.036, 0.0, -0.225), (0.020, 0.015, 0.016), (0.003, 0.0, 0.0))

# The closed surfaces of each segment, of the left arm and leg.
PELVIS = (Loft("zyx", _TRUNK, -0.050, 0.122, 0.045, 0.020, _BUTTOCKS),)
TORSO = (Loft("zyx", _UPPER_TRUNK, -0.040, 0.270, 0.020, 0.015, _CHEST),)
NECK = (Loft("zyx", _NECK, -0.036, 0.088, 0.020, 0.020),)
HEAD = (Loft("zyx", _HEAD, -0.040, 0.094, 0.012, 0.048, (_NOSE, _CHIN, *_EARS)),)
UPPER_ARM = (Loft("yzx", _UPPER_ARM, -0.028, 0.188, 0.036, 0.023),)
FOREARM = (Loft("yzx", _FOREARM, -0.023, 0.166, 0.023, 0.014),)
HAND = (
    Loft("yxz", _PALM, -0.013, 0.069, 0.013, 0.010),
    Loft("yxz", _THUMB, 0.010, 0.067, 0.010, 0.008),
    _finger(0.0166, 0.0172, 0.099, 0.0066),
    _finger(0.0056, 0.0054, 0.108, 0.0066),
    _finger(-0.0054, -0.0064, 0.102, 0.0064),
    _finger(-0.0160, -0.0182, 0.086, 0.0058),
)
THIGH = (Loft("zyx", _THIGH, -0.264, 0.054, 0.034, 0.048, (_KNEECAP,)),)
SHANK = (Loft("zyx", _SHANK, -0.262, 0.033, 0.021, 0.033),)
FOOT = (Loft("xyz", _FOOT, -0.031, 0.117, 0.016, 0.014),)
_SKIRT_TOP, _SKIRT_CAP, _EASE = 0.015, 0.004, 0.006
"""Where a skirt begins over the hip joints, inside the pelvis; its rounding; its distance from the hips."""


def skirt(length: float, flare: float) -> Loft:
    """A cone that hangs `length` under the hip joints, with its hem `flare` outside of the hips."""
    _, _, half_width, back, front, *_ = min(_TRUNK, key=lambda row: abs(row[0]))
    rows = []
    for z, out in ((-length, _EASE + flare), (0.0, _EASE), (_SKIRT_TOP, _EASE)):
        across = half_width + out
        rows.append((z, -across, across, back - out, front + out, 2.3, 2.3))
    return Loft("zyx", tuple(rows), -length, _SKIRT_TOP, _SKIRT_CAP, _SKIRT_CAP)


_HAT_HEAD = (0.0438, -0.0565, 0.0575)
"""Half width, back and front of the head where it is largest."""
_BRIM_THICKNESS, _CROWN_EASE, _CROWN_CAP = 0.006, 1.1, 0.02
"""Of a brim; a crown's size over that of the head; the rounding of its top."""


def hat(brim: float, peak: float, rim: float, crown: float) -> tuple[Loft, Loft]:
    """A brim, `brim` times as large as the head and in front `peak` times, `rim` over the head's joint, and a
    crown, `crown` over its top."""
    half_width, back, front = _HAT_HEAD
    middle, half_depth = (back + front) / 2, (front - back) / 2

    def row(z: float, size: float, ahead: float) -> tuple[float, float, float, float, float, float, float]:
        across = half_width * size
        return (z, -across, across, middle - half_depth * size, middle + half_depth * ahead, 2.0, 2.0)

    over, top, cap = rim + _BRIM_THICKNESS, HEAD[0].end + crown, _BRIM_THICKNESS / 2
    return (
        Loft("zyx", (row(rim, brim, peak), row(over, brim, peak)), rim, over, cap, cap),
        Loft("zyx", (row(rim, _CROWN_EASE, _CROWN_EASE), row(top, 1.0, 1.0)), rim, top, cap, _CROWN_CAP),
    )
