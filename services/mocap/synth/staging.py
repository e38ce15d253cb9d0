"""From a choreography to poses: the pelvis over the feet that bear it, the legs by inverse kinematics."""

from math import ceil

import numpy as np
from scipy.ndimage import gaussian_filter1d, minimum_filter1d

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import N_DOF, joint_transforms
from services.mocap.body.skeleton import DOF_INDEX, JOINT_INDEX, SIDES, Side
from services.mocap.synth.choreography import HANGING, TOE_OUT, Choreography, Leg
from services.mocap.synth.footwork import FootTrack, track_foot
from services.mocap.synth.gait import SoleRoll
from services.mocap.synth.legs import put_feet, reach_m
from services.mocap.types import Floats, Ints

_DENSE_HZ = 240  # at least
_BEND = 0.996  # of the straight leg's length: knees are never locked
_UPPER_DOFS = (
    *("root_lean", "root_pitch", "head_pitch", "head_lean", "head_turn"),
    *(name for side in SIDES for name in HANGING.channels(side)),
)


def perform(choreography: Choreography, n_frames: int, fps: float, body: Body) -> Floats:
    """Poses (n_frames, D) of the choreography's first n_frames / fps seconds."""
    substeps = ceil(_DENSE_HZ / fps)
    rate_hz = fps * substeps
    time_s = np.arange(ceil((n_frames / fps + 0.5) * rate_hz)) / rate_hz
    tracks = _tracks(choreography, time_s, body)
    poses = _upper_body(choreography, time_s)
    _put_root(poses, choreography, tracks, time_s, body)
    frames = np.arange(n_frames, dtype=np.int32) * substeps
    standing = put_feet(poses[frames], body.offsets_m, {s: tracks[s].targets.at(frames) for s in SIDES})
    return _free_legs(standing, choreography, time_s, frames)


def _tracks(choreography: Choreography, time_s: Floats, body: Body) -> dict[Side, FootTrack]:
    roll, play = SoleRoll(body), choreography.score.play
    hop_m = play("hop", time_s) * body.height_m
    return {
        side: track_foot(
            time_s, choreography.feet[side], roll, np.radians(play(f"{side}_heel", time_s)), hop_m
        )
        for side in SIDES
    }


def _upper_body(choreography: Choreography, time_s: Floats) -> Floats:
    poses = np.zeros((len(time_s), N_DOF))
    for name in _UPPER_DOFS:
        poses[:, DOF_INDEX[name]] = np.radians(choreography.score.play(name, time_s))
    return poses


def _put_root(
    poses: Floats, choreography: Choreography, tracks: dict[Side, FootTrack], time_s: Floats, body: Body
) -> None:
    """Set the root's heading, its place over the feet in proportion to the load they bear, and its height."""
    play = choreography.score.play
    foot_yaws = [tracks[side].yaw - sign * TOE_OUT for side, sign in zip(SIDES, (1.0, -1.0), strict=True)]
    facing = np.mean(foot_yaws, axis=0)
    loads = np.stack([tracks[side].load for side in SIDES]) + 0.02
    xy_m = np.einsum("sn,sni->ni", loads / loads.sum(axis=0), [tracks[side].support_xy_m for side in SIDES])
    ahead_m, left_m = (play(f"shift_{way}", time_s) * body.height_m for way in ("ahead", "left"))
    xy_m += ahead_m[:, None] * np.column_stack([np.cos(facing), np.sin(facing)])
    xy_m += left_m[:, None] * np.column_stack([-np.sin(facing), np.cos(facing)])
    rate_hz = 1.0 / float(time_s[1] - time_s[0])
    poses[:, :2] = gaussian_filter1d(xy_m, 0.06 * rate_hz, axis=0, mode="nearest", truncate=3.0)
    poses[:, DOF_INDEX["root_heading"]] = facing + np.radians(play("trunk_turn", time_s))
    given_way_m = play("drop", time_s) * reach_m(body.offsets_m, "left")
    poses[:, DOF_INDEX["root_z"]] = _ceiling_m(poses, choreography, tracks, time_s, body) - given_way_m


def _ceiling_m(
    poses: Floats, choreography: Choreography, tracks: dict[Side, FootTrack], time_s: Floats, body: Body
) -> Floats:
    """The root's height (N,) where the leg that reaches least high is straight, smoothed from below."""
    hips_m = joint_transforms(poses, body.offsets_m)[:, :, :3, 3]
    hop_m, ceilings_m = choreography.score.play("hop", time_s) * body.height_m, []
    for side in SIDES:
        way_m = tracks[side].targets.ankle_world_m - hips_m[:, JOINT_INDEX[f"{side}_hip"]]
        reach2 = (_BEND * reach_m(body.offsets_m, side)) ** 2 - (way_m[:, :2] ** 2).sum(axis=1)
        released_m = 0.3 * body.height_m * choreography.score.play(f"{side}_free", time_s)
        ceilings_m.append(way_m[:, 2] + np.sqrt(np.maximum(reach2, 0.0)) + released_m - hop_m)
    radius = round(0.08 / float(time_s[1] - time_s[0]))
    lowest_m = minimum_filter1d(np.minimum(*ceilings_m), 2 * radius + 1, mode="nearest")
    smooth_m: Floats = gaussian_filter1d(lowest_m, radius / 3, mode="nearest", truncate=3.0)
    return smooth_m + hop_m


def _free_legs(poses: Floats, choreography: Choreography, time_s: Floats, frames: Ints) -> Floats:
    """Go over from where the footwork puts a leg to how its joints are posed in the air."""
    for side in SIDES:
        share = choreography.score.play(f"{side}_free", time_s)[frames]
        for name in Leg(0, 0, 0).channels(side):
            posed = np.radians(choreography.score.play(name, time_s)[frames])
            poses[:, DOF_INDEX[name]] += share * (posed - poses[:, DOF_INDEX[name]])
        poses[:, DOF_INDEX[f"{side}_ankle_inversion"]] *= 1.0 - share
    return poses
