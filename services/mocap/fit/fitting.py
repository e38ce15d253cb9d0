"""Fitting an actor and the poses of some frames to silhouettes, coarse to fine."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from services.mocap.body import shape_space
from services.mocap.body.actor import Actor, build_body
from services.mocap.body.kinematics import clip_to_limits
from services.mocap.body.skeleton import BODY_DOFS, JOINTS, BodyName, dofs_of, pose_of_body
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.fit.contours import Contour, contours_of
from services.mocap.fit.least_squares import CONTOUR_POINTS, Fitting
from services.mocap.fit.normal_equations import ALL_DOFS, FitStage, State
from services.mocap.fit.priors import Prior
from services.mocap.fit.quality import FitQuality, quality_of
from services.mocap.types import Floats

_MOST_ENERGY = 1.05
"""A result with more than so many times the start's energy is dropped. A likelier body may have a little
more, because a search found the start's poses for the start's body."""
_ROOT = dofs_of(JOINTS[0].name)
_HEIGHT = shape_space.of_kind("height")
_SKELETON = shape_space.of_kind("height", "bone")
_EVERYTHING = shape_space.of_kind("height", "bone", "joint", "profile")

_PLACING = (FitStage(_HEIGHT, _ROOT, 20.0, 6), FitStage(_HEIGHT, ALL_DOFS, 15.0, 10))
"""The first frame: position, height, then the limbs."""
_FOLLOWING = (FitStage((), ALL_DOFS, 15.0, 6),)
"""Every further frame, from the previous frame's pose."""
_SHAPING = (
    FitStage(_SKELETON, ALL_DOFS, 8.0, 6, damping=0.003),
    FitStage(_EVERYTHING, ALL_DOFS, 4.0, 8, damping=0.003),
    # The data hardly determine the division between neighbouring bones, so many steps with small gains are
    # needed.
    FitStage(_EVERYTHING, ALL_DOFS, 1.5, 12, damping=0.003, patience=12),
    # Missing pieces of silhouettes all have the same effect: they would shorten thin limbs.
    FitStage(_EVERYTHING, ALL_DOFS, 0.8, 18, damping=0.003, patience=18, is_strict=True),
)
"""All frames together."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted actor, its poses, and its quality before and after."""

    actor: Actor
    poses: Floats
    """(F, D)"""
    before: FitQuality
    after: FitQuality
    shape_covariance: Floats | None = None
    """(n, n) of the actor's shape vector (shape_space); None if the start is returned unchanged."""


def fit_actor(
    rig: Rig,
    seen: TriPlanes,
    start: Actor,
    poses: Floats,
    progress: Callable[[float], None] = lambda _: None,
    body: BodyName = "anatomical",
    height_m: float | None = None,
) -> Fit:
    """Fit an actor and the poses of F frames to silhouettes (F, P, H, W), starting from an actor and poses
    near them.

    poses: (F, D), or (D,) for the first frame, from which those of the others are followed. progress is
    called with the share done, 0 to 1. body: whose pose parameters vary; the others become zero. height_m:
    the actor's, if it is known. A result with clearly more energy than the start, in the first frame's pose
    if no other is given, is dropped for the start.
    Raises ValueError for inconsistent array shapes.
    """
    n_frames, following = len(seen), poses.ndim == 1
    starts = np.tile(poses, (n_frames, 1)) if following else np.array(poses, np.float64)
    if starts.shape != (n_frames, len(ALL_DOFS)):
        raise ValueError(f"poses: expected ({n_frames}, {len(ALL_DOFS)}) or one pose, got {poses.shape}")
    starts = pose_of_body(clip_to_limits(starts), body)
    contours, shaping = contours_of(rig, seen, CONTOUR_POINTS), _of_body(_SHAPING, body)
    step = _step_counter(progress, n_frames, n_starts=2 if following else 1)
    begun = State(shape_space.vector_of(start), starts)
    state = _place(rig, contours, begun, following, partial(step, 1), body, start)
    prior = Prior(state.poses, height_m)
    fitting = Fitting(rig, contours, prior, start)
    for stage in shaping:
        state = fitting.run(state, stage, partial(step, n_frames))
    x = state.x if height_m is not None else shape_space.with_true_height(state.x, start)
    actor = shape_space.actor_of(x, start)
    before = quality_of(build_body(start), starts, rig, seen)
    covariance = fitting.shape_covariance(state, shaping[-1])
    after = quality_of(build_body(actor), state.poses, rig, seen)
    progress(1.0)
    if after.energy_px.sum() > _MOST_ENERGY * before.energy_px.sum():
        return Fit(start, starts, before, before)
    return Fit(actor, state.poses, before, after, covariance)


def _place(
    rig: Rig,
    contours: list[list[Contour]],
    state: State,
    following: bool,
    on_step: Callable[[], None],
    body: BodyName,
    start: Actor,
) -> State:
    """Height, and all poses, one frame after the other.

    Legs that pass each other look alike, so a frame is searched from the previous pose and from its linear
    extrapolation.
    """
    poses, x = state.poses.copy(), state.x
    for f, views in enumerate(contours):
        stages = _of_body(_FOLLOWING if f else _PLACING, body)
        starts = [poses[f]]
        if following and f:
            starts = [poses[f - 1]]
            if f > 1:
                starts.append(clip_to_limits(2.0 * poses[f - 1] - poses[f - 2]))
        found = list[tuple[State, float]]()
        for pose in starts:
            fitting, at = Fitting(rig, [views], Prior(pose[None]), start), State(x, pose[None])
            for stage in stages:
                at = fitting.run(at, stage, on_step)
            found.append((at, fitting.cost(at, stages[-1])))
        best = min(found, key=lambda way: way[1])[0]
        x, poses[f] = best.x, best.poses[0]
    return State(x, poses)


def _of_body(stages: tuple[FitStage, ...], body: BodyName) -> tuple[FitStage, ...]:
    """The stages with only the pose parameters that vary in a body."""
    return tuple(
        replace(stage, dofs=tuple(d for d in stage.dofs if d in BODY_DOFS[body])) for stage in stages
    )


def _step_counter(progress: Callable[[float], None], n_frames: int, n_starts: int) -> Callable[[int], None]:
    """A function to call at every step with its number of frames, which reports the share that is done."""
    followed = 1 + n_starts * (n_frames - 2) if n_frames > 1 else 0  # the second frame has one start
    total = sum(stage.steps for stage in _PLACING) + followed * sum(stage.steps for stage in _FOLLOWING)
    total += n_frames * sum(stage.steps for stage in _SHAPING)
    done = 0

    def step(frames: int) -> None:
        nonlocal done
        progress(done / total)
        done += frames

    return step
