"""What somebody else's skeleton is like at rest: which bones are ours, its axes and size, where bones point.

From it follow rotations between the two skeletons' rest poses, whether the other one's is a T pose, an A pose
or something else.
"""

from dataclasses import dataclass
from math import cos, radians
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from services.mocap.body.actor import Body
from services.mocap.body.humanoid_names import matched_joints
from services.mocap.body.skeleton import JOINT_INDEX, SIDES
from services.mocap.errors import UserError, in_short
from services.mocap.synth.bvh_file import BvhMotion
from services.mocap.synth.legs import reach_m
from services.mocap.types import Floats

NEEDED = ("head", *(f"{side}_{name}" for name in ("hip", "knee", "shoulder", "elbow") for side in SIDES))
_LAST_BONES = {
    f"{side}_{end}": f"{side}_{joint}"
    for side in SIDES
    for end, joint in (("wrist", "elbow"), ("ankle", "knee"))
}
"""Joints that some files only have as the tip of the bone before."""
_UPRIGHT = cos(radians(45))


@dataclass(frozen=True, eq=False)
class RestPose:
    """A skeleton at rest, in its own unit, in our axes: x forward, y to its left, z up."""

    columns: dict[str, int]
    """Our joint -> the file's joint; all the NEEDED, the wrists and the ankles, and others where known."""
    R_ours_file: Floats
    """(3, 3) from the file's axes to ours."""
    places: dict[str, Floats]
    """Our joint -> (3,) where it is in the rest pose."""
    toes_ahead: dict[str, Floats]
    """Ankle -> (3,) from it to the toes in the rest pose, where the file has them."""

    @property
    def leg(self) -> float:
        """From hip to knee to ankle, mean of both sides, in the file's unit."""
        bones = [
            self.places[f"{side}_{child}"] - self.places[f"{side}_{joint}"]
            for side in SIDES
            for joint, child in (("hip", "knee"), ("knee", "ankle"))
        ]
        return float(np.linalg.norm(bones, axis=1).sum()) / len(SIDES)

    def alignment(self, joint: str, child: str, offsets_m: Floats) -> Floats:
        """R (3, 3) that turns our bone from joint to child, as it is in our rest pose, into the file's."""
        return shortest_turn(offsets_m[JOINT_INDEX[child]], self.places[child] - self.places[joint])

    def foot_alignment(self, side: str) -> Floats:
        """R (3, 3) that turns our level foot into the file's, which stands level unless it points down."""
        ahead = self.toes_ahead.get(f"{side}_ankle")
        if ahead is None:
            return np.eye(3)
        flat = ahead * (1.0, 1.0, 0.0)
        level = np.linalg.norm(flat) > _UPRIGHT * np.linalg.norm(ahead)
        return shortest_turn(np.array([1.0, 0.0, 0.0]), flat if level else ahead)

    def head_alignment(self) -> Floats:
        """R (3, 3) for the head: none where the neck stands upright in the rest pose."""
        if "neck" not in self.places:
            return np.eye(3)
        neck = self.places["head"] - self.places["neck"]
        if neck[2] >= _UPRIGHT * np.linalg.norm(neck):
            return np.eye(3)
        return shortest_turn(np.array([0.0, 0.0, 1.0]), neck)


def shortest_turn(start: Floats, end: Floats) -> Floats:
    """R (3, 3) that turns the direction of one vector into that of another by the shortest way."""
    R: Floats = Rotation.align_vectors(end[None], start[None])[0].as_matrix()
    return R


def scale_m(rest: RestPose, body: Body) -> float:
    """Metres per the file's unit, for the file's legs to be as long as the actor's."""
    return reach_m(body.offsets_m, "left") / rest.leg


def read_rest_pose(motion: BvhMotion, path: Path) -> RestPose:
    """Find our joints in a file's skeleton; raises UserError that names the first one it lacks."""
    names = [joint.name for joint in motion.joints]
    columns = {joint: names.index(name) for joint, name in matched_joints(names).items()}
    for end, joint in _LAST_BONES.items():
        if end not in columns and joint in columns and (tips := _children(motion, columns[joint])):
            columns[end] = tips[0]
    for joint in (*NEEDED, *_LAST_BONES):
        if joint not in columns:
            raise UserError(
                f"{path}: has no joint for the actor's {joint.replace('_', ' ')}: expected one with a usual"
                f" name, such as {_USUAL[joint.split('_')[-1]]}, found {in_short(', '.join(names))}"
            )
    rest = motion.rest()
    R_ours_file = _axes({joint: rest[j] for joint, j in columns.items()}, path)
    rest = rest @ R_ours_file.T
    ankles = {joint: j for joint, j in columns.items() if joint.endswith("ankle")}
    return RestPose(
        columns,
        R_ours_file,
        {joint: rest[j] for joint, j in columns.items()},
        {ankle: ahead for ankle, j in ankles.items() if (ahead := _toes_ahead(motion, j, rest)) is not None},
    )


_USUAL = {
    "head": "Head",
    "hip": "LeftUpLeg or thigh_l",
    "knee": "LeftLeg or calf_l",
    "ankle": "LeftFoot or foot_l",
    "shoulder": "LeftArm or upperarm_l",
    "elbow": "LeftForeArm or lowerarm_l",
    "wrist": "LeftHand or hand_l",
}


def _children(motion: BvhMotion, parent: int) -> list[int]:
    return [j for j, joint in enumerate(motion.joints) if joint.parent == parent]


def _toes_ahead(motion: BvhMotion, ankle: int, rest: Floats) -> Floats | None:
    """(3,) from the ankle to its child that lies farthest ahead; None where none lies apart from it."""
    children = rest[_children(motion, ankle)] - rest[ankle]
    apart = children[np.linalg.norm(children, axis=1) > 1e-3 * np.ptp(rest)]
    if not len(apart):
        return None
    ahead: Floats = apart[apart[:, 0].argmax()]
    return ahead


def _axes(places: dict[str, Floats], path: Path) -> Floats:
    """R_ours_file (3, 3): up is the file's axis nearest to hips to head, left that nearest to hip to hip."""
    up = _nearest_axis(places["head"] - (places["left_hip"] + places["right_hip"]) / 2)
    left = _nearest_axis((places["left_hip"] - places["right_hip"]) * (up == 0.0))
    if not np.isfinite(up).all() or not up.any() or not left.any():
        raise UserError(f"{path}: HIERARCHY: expected a rest pose with the head over two hips that lie apart")
    return np.stack([np.cross(left, up), left, up])


def _nearest_axis(direction: Floats) -> Floats:
    axis = np.zeros(3)
    longest = int(np.abs(direction).argmax())
    axis[longest] = np.sign(direction[longest])
    return axis
