"""Anatomical joint angles, after the recommendations of the International Society of Biomechanics.

Wu et al. 2002 (hip, ankle) and 2005 (shoulder, elbow, wrist), Grood and Suntay 1983 (knee). Every segment
has axes x forward, y up, z to the right, parallel to the world's in the neutral pose: upright, arms hanging,
palms towards the thighs, thumbs forward. There all angles are zero. The left side is mirrored first, so that
an angle means the same movement on both sides. Turns of a joint are taken apart about the axis of the segment
above, a floating one, and the axis of the segment below, in the order that skeleton_table.py says.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from services.mocap.body.skeleton import JOINT_INDEX, JOINT_NAMES, SIDES, sided
from services.mocap.body.skeleton_table import ROWS
from services.mocap.motion.motion import rest_rotations, turns_from_rest
from services.mocap.motion.root import continuous_angles
from services.mocap.types import Floats

R_ISB_ZUP: Floats = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""From the axes inside (x forward, y left, z up) to ISB's (x forward, y up, z right)."""
_MIRROR = np.diag([1.0, 1.0, -1.0])
_STRAIGHT = 1e-7
"""Below this sine of its elevation an arm's plane of elevation is undefined."""
_SWAP: Floats = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])


@dataclass(frozen=True)
class Angle:
    """One column of angles.csv."""

    name: str
    """Without the side, which is put in front, and without the unit."""
    joint: str
    """The rotating joint, relative to the segment above it; pelvis: relative to the world."""
    order: Literal["ZXY", "YXZ", "YXY"]
    """The axes of the decomposition, in order, each in the frame rotated so far."""
    place: int
    """The index of this angle in the decomposition."""
    sign: int
    """-1 if the positive movement is against the right-hand rule."""
    meaning: str
    """The positive movement, in words."""
    is_sided: bool
    """Whether there is one for the left and one for the right side."""


ANGLES: tuple[Angle, ...] = tuple(
    Angle(name, row.joint, turns.order, place, sign, meaning, row.paired)
    for row in ROWS
    for turns in row.angles
    for place, (name, sign, meaning) in enumerate(turns.named)
)
"""The definitions. Each set of three tells a turn whole; a hinge has one. The arm's turn is told
twice: the first three cannot tell flexion from rotation with the arm straight sideways, the ISB's globe
(order YXY) cannot tell its plane with the arm hanging or straight up."""


def joint_angles_deg(T_world_joint: Floats) -> dict[str, Floats]:
    """Angles (N,) in degrees of N consecutive frames, by name; sided ones begin with left_ or right_.

    T_world_joint: (N, J, 4, 4). Angles are continuous from frame to frame, without jumps of whole turns; the
    first frame is within half a turn.
    """
    turns = R_ISB_ZUP @ turns_from_rest(T_world_joint, rest_rotations("hanging")) @ R_ISB_ZUP.T
    left = [joint.startswith("left_") for joint in JOINT_NAMES]
    turns[:, left] = _MIRROR @ turns[:, left] @ _MIRROR
    by_order = {order: np.degrees(apart(turns)) for order, apart in _APART.items()}
    angles_deg: dict[str, Floats] = {}
    for side in (None, *SIDES):
        for angle in ANGLES:
            if angle.is_sided == (side is not None):
                of_joint = by_order[angle.order][:, JOINT_INDEX[sided(angle.joint, side)]]
                angles_deg[sided(angle.name, side)] = angle.sign * of_joint[:, angle.place] + 0.0  # no -0
    return angles_deg


def _yxz(R: Floats) -> Floats:
    """Angles (N, J, 3) of turns about y, then the new x, then the new z, of R (N, J, 3, 3), without jumps."""
    return -continuous_angles(_SWAP @ R @ _SWAP)  # seen in a mirror that swaps y and z, all turn backwards


def _yxy(R: Floats) -> Floats:
    """ISB's globe angles (N, J, 3) of R (N, J, 3, 3): a raised arm turns negatively about x, from -π to 0."""
    angles = Rotation.from_matrix(R.reshape(-1, 3, 3)).as_euler("YXY", suppress_warnings=True)
    plane, raised, axial = np.moveaxis(angles.reshape(*R.shape[:2], 3), -1, 0)  # scipy: raised from 0 to π
    # Hanging or straight up only the sum or difference of plane and axial rotation is defined: no plane.
    straight = np.sin(raised) < _STRAIGHT
    axial = np.where(straight, axial + np.where(raised < 1.0, plane, -plane), axial + np.pi)
    plane = np.where(straight, 0.0, plane + np.pi)
    first, last = (np.unwrap((a + np.pi) % (2 * np.pi) - np.pi, axis=0) for a in (plane, axial))
    return np.stack([first, -raised, last], axis=-1)


_APART = {"ZXY": continuous_angles, "YXZ": _yxz, "YXY": _yxy}
