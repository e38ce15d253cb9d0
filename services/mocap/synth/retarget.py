"""Retargets the motion of another skeleton to our body: a start from its bones' rotations, then least
squares.

The other skeleton may bend at more joints of the trunk, and its limbs have other lengths. The pelvis and the
feet go where its own go, scaled by the legs' length, so that standing feet stand still. Pelvis, arms and head
turn as its own do; the chest turns against the pelvis as its shoulders and neck do, however many joints bend
in between.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import N_DOF, joint_positions, joint_transforms
from services.mocap.body.skeleton import (
    DOF_INDEX,
    JOINT_INDEX,
    JOINT_NAMES,
    JOINTS,
    LOWER,
    SEGMENTS,
    SIDES,
    UPPER,
    dofs_of,
)
from services.mocap.synth.legs import set_ball_joint
from services.mocap.synth.rest_pose import RestPose, scale_m
from services.mocap.types import Floats

_PAIRED = {segment.joint for segment in SEGMENTS if segment.side}
_BONES = tuple((joint.parent, joint.name) for joint in JOINTS if joint.parent in _PAIRED)
"""Of arms and legs, from joint to joint."""
_ON_CHEST = ("left_shoulder", "right_shoulder", "neck")
_PLACED = ("pelvis", "left_ankle", "right_ankle")
_TURNED = tuple(name for name in JOINT_NAMES if dofs_of(name) and not name.endswith("knee"))
"""Joints with parameters; how a knee turns, its bones tell."""
_TURN_LEVER_M = 0.04
"""A radian of a segment's turn counts like this distance of a joint: places lead, turns settle the rest."""
_PLACED_ROWS, _TURNED_ROWS = ([JOINT_INDEX[j] for j in names] for names in (_PLACED, _TURNED))
_BONE_ROWS = np.array([[JOINT_INDEX[j] for j in bone] for bone in _BONES])


@dataclass(frozen=True, eq=False)
class Targets:
    """What the body is to do, frame by frame, in metres and our axes."""

    places_world_m: Floats
    """(N, 3, 3) of the joints _PLACED."""
    bones_m: Floats
    """(N, 8, 3) vectors of the _BONES, as long as ours."""
    R_world_joint: Floats
    """(N, T, 3, 3) of the joints _TURNED."""


def retarget(places: Floats, R: Floats, rest: RestPose, body: Body) -> Floats:
    """Poses (N, D) within the joint limits; the heading goes on beyond half a turn.

    places (N, J, 3) and R (N, J, 3, 3): of the file's joints in the file's world, as BvhMotion.sample gives
    them. The floor is not looked at.
    """
    targets = make_targets(places, R, rest, body)
    guesses = _first_guess(targets)
    poses, slack = np.empty_like(guesses), 1e-9
    for n, guess in enumerate(guesses):
        found = least_squares(
            lambda pose, *fixed: _residuals(pose[None], *fixed)[0],
            np.clip(guess, LOWER + slack, UPPER - slack),
            jac=_jacobian,
            bounds=(LOWER, UPPER),
            args=(body.offsets_m, targets, n),
            xtol=1e-7,
            ftol=1e-9,
            max_nfev=30,
        )
        poses[n] = found.x
    return poses


def joint_errors_m(places: Floats, R: Floats, rest: RestPose, poses: Floats, body: Body) -> Floats:
    """(N, K) distances of the body's joints from the file's, had the file's skeleton the body's bone lengths.

    Arguments and results as of retarget.
    """
    targets = make_targets(places, R, rest, body)
    wanted_m, turns = {"pelvis": targets.places_world_m[:, 0]}, dict(_by_joint(targets))
    for joint in ("waist", "neck", *(f"{s}_{j}" for s in SIDES for j in ("shoulder", "hip"))):
        parent, beside_m = JOINTS[JOINT_INDEX[joint]].parent or "", body.offsets_m[JOINT_INDEX[joint]]
        wanted_m[joint] = wanted_m[parent] + turns[parent] @ beside_m
    for i, (joint, child) in enumerate(_BONES):
        wanted_m[child] = wanted_m[joint] + targets.bones_m[:, i]
    found_m = joint_positions(poses, body.offsets_m)[:, [JOINT_INDEX[joint] for joint in wanted_m]]
    errors_m: Floats = np.linalg.norm(found_m - np.stack(list(wanted_m.values()), axis=1), axis=2)
    return errors_m


def make_targets(places: Floats, R: Floats, rest: RestPose, body: Body) -> Targets:
    """What the file's joints ask of the body; arguments as for retarget."""
    turn = rest.R_ours_file
    places_m = places @ turn.T * scale_m(rest, body)
    R_joint = turn @ R @ turn.T

    def at(joint: str) -> Floats:
        return places_m[:, rest.columns[joint]]

    turns = _trunk_turns(places_m, R_joint, rest, body)
    turns["neck"] = R_joint[:, rest.columns["head"]] @ rest.head_alignment()
    for side in SIDES:
        for joint, child in (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee")):
            align = rest.alignment(f"{side}_{joint}", f"{side}_{child}", body.offsets_m)
            turns[f"{side}_{joint}"] = R_joint[:, rest.columns[f"{side}_{joint}"]] @ align
            if joint == "elbow":  # the hand goes straight on in the rest pose
                turns[f"{side}_wrist"] = R_joint[:, rest.columns[f"{side}_wrist"]] @ align
        turns[f"{side}_ankle"] = R_joint[:, rest.columns[f"{side}_ankle"]] @ rest.foot_alignment(side)
    middle_m = (at("left_hip") + at("right_hip")) / 2
    bones = []
    for joint, child in _BONES:
        bone = at(child) - at(joint)
        length_m = np.linalg.norm(body.offsets_m[JOINT_INDEX[child]])
        bones.append(bone * (length_m / np.linalg.norm(bone, axis=1, keepdims=True)))
    return Targets(
        np.stack([middle_m, at("left_ankle"), at("right_ankle")], axis=1),
        np.stack(bones, axis=1),
        np.stack([turns[joint] for joint in _TURNED], axis=1),
    )


def _by_joint(targets: Targets) -> Iterator[tuple[str, Floats]]:
    """The joints _TURNED, each with its turns (N, 3, 3)."""
    yield from zip(_TURNED, np.moveaxis(targets.R_world_joint, 1, 0), strict=True)


def _trunk_turns(places_m: Floats, R_joint: Floats, rest: RestPose, body: Body) -> dict[str, Floats]:
    """R (N, 3, 3) of pelvis and waist.

    The pelvis turns as the file's own joint; where the file has none, as hips, shoulders and neck together.
    The waist, which the file need not have either, lies over the hips as our own does; what is above it turns
    as the shoulders and, where known, the neck.
    """
    hips, above = ("left_hip", "right_hip"), tuple(j for j in _ON_CHEST if j in rest.columns)
    columns = [rest.columns[joint] for joint in (*hips, *above)]
    now_m, then = places_m[:, columns], np.array([rest.places[joint] for joint in (*hips, *above)])
    hips_now_m, hips_then = now_m[:, :2].mean(axis=1, keepdims=True), then[:2].mean(axis=0)
    if "pelvis" in rest.columns:
        R_pelvis = R_joint[:, rest.columns["pelvis"]]
    else:
        R_pelvis = _turns_between(then - hips_then, now_m - hips_now_m)
    waist_m, shoulder_m = (body.offsets_m[JOINT_INDEX[j], 2] for j in ("waist", "left_shoulder"))
    to_waist = (then[2:4].mean(axis=0) - hips_then) * (waist_m / (waist_m + shoulder_m))
    scale = scale_m(rest, body)
    waist_now_m = hips_now_m + (R_pelvis @ to_waist)[:, None] * scale
    chest_then = then[2:] - hips_then - to_waist
    return {"pelvis": R_pelvis, "waist": _turns_between(chest_then, now_m[:, 2:] - waist_now_m)}


def _turns_between(then: Floats, now: Floats) -> Floats:
    """R (N, 3, 3) that turns the vectors then (K, 3) into now (N, K, 3) best (Kabsch)."""
    U, _, Vt = np.linalg.svd(np.einsum("nki,kj->nij", now, then))
    flip = np.ones((len(now), 3))
    flip[:, 2] = np.linalg.det(U @ Vt)
    R: Floats = (U * flip[:, None]) @ Vt
    return R


def _first_guess(targets: Targets) -> Floats:
    """Poses (N, D) from the segments' turns alone, some of them perhaps beyond the limits."""
    R = dict(_by_joint(targets))
    poses = np.zeros((len(targets.bones_m), N_DOF))
    poses[:, :3] = targets.places_world_m[:, 0]
    heading, lean, pitch = Rotation.from_matrix(R["pelvis"]).as_euler("ZXY").T
    poses[:, 3:6] = np.stack([np.unwrap(heading), lean, pitch], axis=1)
    back = {joint: turns.transpose(0, 2, 1) for joint, turns in R.items()}
    set_ball_joint(poses, "waist", back["pelvis"] @ R["waist"])
    set_ball_joint(poses, "neck", back["waist"] @ R["neck"])
    bones = dict(zip((joint for joint, _ in _BONES), np.moveaxis(targets.bones_m, 1, 0), strict=True))
    for side in SIDES:
        for joint, parent, middle in (("shoulder", "waist", "elbow"), ("hip", "pelvis", "knee")):
            set_ball_joint(poses, f"{side}_{joint}", back[parent] @ R[f"{side}_{joint}"])
            upper, lower = bones[f"{side}_{joint}"], bones[f"{side}_{middle}"]
            bend = np.arctan2(np.linalg.norm(np.cross(upper, lower), axis=1), (upper * lower).sum(axis=1))
            poses[:, DOF_INDEX[f"{side}_{middle}_flexion"]] = bend
        set_ball_joint(poses, f"{side}_wrist", back[f"{side}_elbow"] @ R[f"{side}_wrist"])
    return poses


def _residuals(poses: Floats, offsets_m: Floats, targets: Targets, n: int) -> Floats:
    """(P, R) in metres: places, bones, and turns times their lever, of poses (P, D) against frame n."""
    T = joint_transforms(poses, offsets_m)
    joints_m = T[:, :, :3, 3]
    places_m = joints_m[:, _PLACED_ROWS] - targets.places_world_m[n]
    bones_m = joints_m[:, _BONE_ROWS[:, 1]] - joints_m[:, _BONE_ROWS[:, 0]] - targets.bones_m[n]
    turns = T[:, _TURNED_ROWS, :3, :3] - targets.R_world_joint[n]
    flat = [part.reshape(len(poses), -1) for part in (places_m, bones_m, turns * _TURN_LEVER_M)]
    return np.concatenate(flat, axis=1)


def _jacobian(pose: Floats, offsets_m: Floats, targets: Targets, n: int) -> Floats:
    """(R, D) by central differences, all poses in one batch."""
    step = 1e-6
    ends = _residuals(
        np.concatenate([pose + step * np.eye(N_DOF), pose - step * np.eye(N_DOF)]), offsets_m, targets, n
    )
    return (ends[:N_DOF] - ends[N_DOF:]).T / (2 * step)
