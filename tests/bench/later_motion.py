"""What the bench's random people do after the first frames, and where a tracker finds them then."""

from dataclasses import dataclass

import numpy as np

from bench.random_bodies import FPS, Person, seen_of
from services.mocap.body.actor import Actor
from services.mocap.body.kinematics import clip_to_limits
from services.mocap.body.skeleton import DOF_INDEX
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.energy.engine import Engine
from services.mocap.search.jobs import LocalLimbs
from services.mocap.search.model import model_of
from services.mocap.search.settings import SearchSettings
from services.mocap.search.tracker import Tracker
from services.mocap.synth.motions import make_motion
from services.mocap.synth.walk import STAND_S
from services.mocap.types import Floats, Mask

MOTIONS = ("walk", "basic", "dance")
"""What people go on with, by turns."""
_JOINED_S = 0.6
"""From how somebody stood to the motion."""


@dataclass(frozen=True, eq=False)
class Later:
    """What somebody does after the first frames, and what is seen of it."""

    poses: Floats
    """(F, D)"""
    seen: TriPlanes
    """(F, P, H, W)"""


@dataclass(frozen=True, eq=False)
class Tracked:
    """What a tracker finds in frames."""

    poses: Floats
    """(F, D)"""
    distrusted: Mask
    """(F,) whether the tracker marks any part."""


def going_on(person: Person, rig: Rig, motion: str, n_frames: int, seed: int) -> Later:
    """So many frames of one of MOTIONS, in silhouettes as bad as those of the first frames."""
    still = round(STAND_S * FPS)  # as motions begin: long enough to come from another stance
    poses = make_motion(motion, still + n_frames, FPS, person.body, seed).poses[still:]
    poses = _joined(person.poses[-1], poses)
    for pose in poses:
        pose[DOF_INDEX["root_z"]] -= person.body.lowest_point_m(pose)
    return Later(poses, seen_of(person.body, poses, rig, np.random.default_rng((seed, 6))))


def _joined(last: Floats, poses: Floats) -> Floats:
    """Poses (F, D), moved and turned to go on smoothly from the last one (D,) before them."""
    heading = DOF_INDEX["root_heading"]
    turn_rad = last[heading] - poses[0, heading]
    (c, s), from_m = (np.cos(turn_rad), np.sin(turn_rad)), poses[0, :2].copy()
    joined = poses.copy()
    joined[:, :2] = last[:2] + (poses[:, :2] - from_m) @ np.array([[c, s], [-s, c]])
    joined[:, heading] += turn_rad
    t = np.clip(np.arange(1, len(poses) + 1) / (_JOINED_S * FPS), 0.0, 1.0)[:, None]
    share = t * t * (3.0 - 2.0 * t)
    return clip_to_limits((1.0 - share) * last + share * joined)


def tracked(actor: Actor, first_poses: Floats, seen: TriPlanes, rig: Rig, engine: Engine) -> Tracked:
    """Track an actor through what is seen (F, P, H, W) after frames with known poses (N, D)."""
    model, settings = model_of(actor, rig, engine), SearchSettings()
    tracker = Tracker(model, settings, LocalLimbs(model), first_poses[-2:])
    solutions = [tracker.solve(seen[f]) for f in range(len(seen))]
    model.close()
    return Tracked(
        np.array([solution.pose for solution in solutions]),
        np.array([bool(solution.distrusted) for solution in solutions]),
    )
