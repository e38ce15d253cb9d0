"""Rounds of choreographed movements, and from a choreography to poses.

A round is all of a repertoire once, in a new order, tempo and side each time. The pelvis is put over the feet
that bear it, the legs follow by inverse kinematics.
"""

from collections.abc import Callable, Sequence
from math import ceil

import numpy as np
from scipy.ndimage import gaussian_filter1d

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import DOF_INDEX, SIDES, Side
from services.mocap.synth.basic import BASIC
from services.mocap.synth.choreography import HANGING, TOE_OUT, Choreography, Leg
from services.mocap.synth.dance import DANCE
from services.mocap.synth.footwork import FootTrack, track_foot
from services.mocap.synth.gait import SoleRoll
from services.mocap.synth.legs import hip_rises_m, put_feet, reach_m, smoothed_from_below
from services.mocap.synth.walk import STAND_S
from services.mocap.types import Floats, Ints

_DENSE_HZ = 240  # at least
_BEND = 0.996  # of the straight leg's length: knees are never locked
_UPPER_DOFS = (
    *("root_lean", "root_pitch", "head_pitch", "head_lean", "head_turn"),
    *(name for side in SIDES for name in HANGING.channels(side)),
)

ROUND_S = 400 / 15
"""The paper's sequences are about 400 frames at 15 frames a second: so long is one round, in seconds."""
_FIRST_MOVEMENT_S = STAND_S + 0.5

Movement = Callable[[Choreography], None]


def perform(choreography: Choreography, n_frames: int, fps: float, body: Body) -> Floats:
    """Poses (n_frames, D) of the choreography's first n_frames / fps seconds."""
    substeps = ceil(_DENSE_HZ / fps)
    rate_hz = fps * substeps
    time_s = np.arange(ceil((n_frames / fps + 0.5) * rate_hz)) / rate_hz
    roll, play = SoleRoll(body), choreography.score.play
    hop_m = play("hop", time_s) * body.height_m
    tracks: dict[Side, FootTrack] = {}
    for side, foot in choreography.feet.items():
        tracks[side] = track_foot(time_s, foot, roll, np.radians(play(f"{side}_heel", time_s)), hop_m)
    poses = np.zeros((len(time_s), N_DOF))
    for name in _UPPER_DOFS:
        poses[:, DOF_INDEX[name]] = np.radians(play(name, time_s))
    _put_root(poses, choreography, tracks, time_s, body)
    frames = np.arange(n_frames, dtype=np.int32) * substeps
    standing = put_feet(poses[frames], body.offsets_m, {s: tracks[s].targets.at(frames) for s in SIDES})
    return _free_legs(standing, choreography, time_s, frames)


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
    targets = {side: tracks[side].targets for side in SIDES}
    hop_m, ceilings_m = choreography.score.play("hop", time_s) * body.height_m, []
    for side, rise_m in hip_rises_m(poses, body.offsets_m, targets, _BEND).items():
        released_m = 0.3 * body.height_m * choreography.score.play(f"{side}_free", time_s)
        ceilings_m.append(rise_m + released_m - hop_m)
    radius = round(0.08 / float(time_s[1] - time_s[0]))
    return smoothed_from_below(np.minimum(*ceilings_m), radius) + hop_m


def _free_legs(poses: Floats, choreography: Choreography, time_s: Floats, frames: Ints) -> Floats:
    """Go over from where the footwork puts a leg to how its joints are posed in the air."""
    for side in SIDES:
        share = choreography.score.play(f"{side}_free", time_s)[frames]
        for name in Leg(0, 0, 0).channels(side):
            posed = np.radians(choreography.score.play(name, time_s)[frames])
            poses[:, DOF_INDEX[name]] += share * (posed - poses[:, DOF_INDEX[name]])
        poses[:, DOF_INDEX[f"{side}_ankle_inversion"]] *= 1.0 - share
    return poses


def basic(n_frames: int, fps: float, body: Body, seed: int = 0) -> Floats:
    """Poses (n_frames, D) of slow single movements; see _rounds."""
    return _rounds(BASIC, n_frames, fps, body, seed, in_order=True)


def dance(n_frames: int, fps: float, body: Body, seed: int = 0) -> Floats:
    """Poses (n_frames, D) of a fast dance with the whole body; see _rounds."""
    return _rounds(DANCE, n_frames, fps, body, seed, in_order=False)


def _rounds(
    repertoire: Sequence[Movement], n_frames: int, fps: float, body: Body, seed: int, *, in_order: bool
) -> Floats:
    """It stands in the A pose for STAND_S, then performs the whole repertoire in 26.7 s, then repeats it.

    A shorter take shows the beginning. The seed gives the sides, the tempo of each movement and, unless they
    stay in order, the order.
    """
    rng = np.random.default_rng((seed, 5))
    choreography = Choreography(body)
    choreography.put(STAND_S, **dict.fromkeys(("drop", "head_pitch"), 0.0))
    choreography.hold_arms(STAND_S)
    choreography.put(_FIRST_MOVEMENT_S, HANGING, HANGING)
    choreography.done(_FIRST_MOVEMENT_S)
    begin_s, round_s = _FIRST_MOVEMENT_S, ROUND_S - _FIRST_MOVEMENT_S
    while begin_s < n_frames / fps:
        order = [int(i) for i in (range(len(repertoire)) if in_order else rng.permutation(len(repertoire)))]
        mirrored = rng.random(len(repertoire)) < 0.5
        tempos = rng.uniform(0.94, 1.06, len(repertoire))
        for tempo, i, mirror in zip(
            _fitted(repertoire, order, tempos, round_s, body), order, mirrored, strict=True
        ):
            choreography.tempo, choreography.mirrored = float(tempo), bool(mirror)
            repertoire[i](choreography)
        begin_s = choreography.now_s
    return perform(choreography, n_frames, fps, body)


def _fitted(
    repertoire: Sequence[Movement], order: Sequence[int], tempos: Floats, round_s: float, body: Body
) -> Floats:
    """The tempos (M,) scaled so that the movements in that order take a round's time."""
    beats = []
    for i in order:
        alone = Choreography(body)
        repertoire[i](alone)
        beats.append(alone.now_s)
    return tempos * round_s / float(np.dot(tempos, beats))
