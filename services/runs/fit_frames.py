"""Fitting the actor of a take to some successive frames, from the pose that is found in the first of them."""

from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial

import numpy as np

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.body_mesh import OwnMesh
from services.mocap.body.kinematics import joint_positions
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes, unpack
from services.mocap.energy.engine import Engine, open_engine
from services.mocap.energy.picture import Picture
from services.mocap.energy.settings import EngineSettings
from services.mocap.fit.fitting import Fit, fit_actor
from services.mocap.fit.worn import as_worn
from services.mocap.search.both_ways import found_anew
from services.mocap.search.first_frame import FirstFrame, FirstFrameSearch
from services.mocap.search.found import BY_ENERGY
from services.mocap.search.hull import carve
from services.mocap.search.jobs import LocalLimbs
from services.mocap.search.model import model_on_cpu
from services.mocap.search.settings import SearchSettings
from services.mocap.take.settings import TakeSettings
from services.mocap.types import Floats, Mask
from services.runs.reporting import Clock, Show, kept_warnings
from services.runs.take_fit import TakeFit, concluded
from services.runs.take_silhouettes import TakeSilhouettes, seen_of
from services.runs.way_round import MOTION_FRAMES, Way, fit_best_way_round, solved, tracked_px

_FIRST_FITS = 0.6
"""Progress of the fits from the generic body's pose; one from the fitted body's follows."""
_NEAR_M = 0.1
"""Fits from two first poses end about alike if none of their joints is farther apart."""


def fit_frames(
    silhouettes: TakeSilhouettes,
    engine: EngineSettings,
    search: SearchSettings,
    mesh: OwnMesh | None,
    frames: range,
    unsure: Mapping[str, Mask],
    show: Show,
    *,
    is_refined_next: bool,
) -> TakeFit:
    """Find the pose of the first of these frames, and fit the actor to all of them; as fit_take.

    unsure: by camera further pixels (h, w) that count for nothing.
    """
    take = silhouettes.take
    clock, hints = Clock(show), take.settings.beginning_at(frames.start)
    with kept_warnings() as warnings:
        with clock.stage("looking at silhouettes") as progress:
            warnings += silhouettes.remarks
            segmenter = silhouettes.segmenter
            known = segmenter.knowing(unsure) if unsure else segmenter
            cameras, seen = seen_of(take, frames, known, progress)
        rig, names = Rig.of(cameras), [camera.name for camera in cameras]
        with clock.stage("finding the first pose"), open_engine(engine) as opened:
            used_search = search.for_cameras([take.cameras.index(camera) for camera in cameras])
            guess = guess_first_pose(rig, seen[0], hints, opened, used_search, mesh, names)
        with clock.stage("fitting the actor") as progress:

            def fit_from(actor: Actor, pose: Floats, show_share: Callable[[float], None]) -> Fit:
                return fit_actor(rig, seen, actor, pose, show_share, search.body, hints.actor_height)

            @cache
            def later() -> list[TriPlanes]:
                """What is seen (P, H, W) in each of the frames that tell which way round the actor is."""
                longer = range(frames.start, min(frames.stop + MOTION_FRAMES, take.settings.frames))
                _, more = seen_of(take, longer, known, lambda _: None)
                return [more[frame] for frame in range(len(frames), len(longer))]

            way = fit_best_way_round(
                guess.first,
                partial(fit_from, guess.actor),
                lambda fit: tracked_px(rig, later(), fit, used_search),
                lambda share: progress(_FIRST_FITS * share),
            )
            again = None if hints.initial_pose else partial(_found_again, rig, seen[0], search=used_search)
            way = _fitted_once_more(
                way, guess.actor, rig, seen, fit_from, again, progress, is_refined_next=is_refined_next
            )
        start = (guess.actor, way.pose)
        return concluded(frames, cameras, seen, start, way.fit, clock.seconds, warnings)


def _fitted_once_more(
    way: Way,
    actor: Actor,
    rig: Rig,
    seen: TriPlanes,
    fit_from: Callable[[Actor, Floats, Callable[[float], None]], Fit],
    found_again: Callable[[Actor, Floats], Floats] | None,
    progress: Callable[[float], None],
    *,
    is_refined_next: bool,
) -> Way:
    """The best of a way and of further fits: one in a skirt or a hat, if the actor seems to wear one, and
    one from the first pose as found_again finds it with the fitted body (None: the pose was given).

    is_refined_next: the last one is left out if that pose is near the way's.
    """
    ways = [way]
    worn = as_worn(way.fit.actor, way.fit.poses, rig, seen)
    dressed = actor.in_skirt(worn.skirt).in_hat(worn.hat)
    if dressed != dressed.bare:
        ways.append(Way(way.pose, fit_from(dressed, way.pose, lambda _: None)))
    fitted = ways[-1].fit
    pose = fitted.poses[0] if found_again is None else found_again(fitted.actor, fitted.poses[0])
    if not (is_refined_next and _is_near(fitted.actor, pose, fitted.poses[0])):
        rest = 1.0 - _FIRST_FITS
        ways.append(Way(pose, fit_from(dressed, pose, lambda share: progress(_FIRST_FITS + rest * share))))
    return min(ways, key=BY_ENERGY)


def _found_again(rig: Rig, seen: TriPlanes, actor: Actor, pose: Floats, *, search: SearchSettings) -> Floats:
    """The pose (D,) of the first frame (P, H, W) for a fitted actor: the fit's, or a better one.

    The body by which the first pose was found had other limbs, and no skirt or hat.
    """
    with model_on_cpu(actor, rig) as model:
        anew = found_anew(model, search, LocalLimbs(model), seen, pose)
        return min((solved(model, seen, start, search) for start in (pose, anew)), key=BY_ENERGY).pose


def _is_near(actor: Actor, one: Floats, other: Floats) -> bool:
    """Whether no joint is in quite another place in two poses (D,)."""
    joints_m = joint_positions(np.stack([one, other]), build_body(actor).offsets_m)
    return bool(np.linalg.norm(joints_m[1] - joints_m[0], axis=-1).max() < _NEAR_M)


def guess_first_pose(
    rig: Rig,
    seen: TriPlanes,
    hints: TakeSettings,
    engine: Engine,
    search: SearchSettings,
    mesh: OwnMesh | None = None,
    names: Sequence[str] = (),
) -> FirstFrame:
    """The generic body or the mesh, and its pose in the first frame, whose silhouettes are `seen` (P, H, W).

    names: of the cameras. The model is closed. Raises TakeError for an implausible height.
    """
    hull = carve(rig, unpack(seen.silhouettes, rig.n_cameras), unpack(seen.possible, rig.n_cameras))
    first = FirstFrameSearch(
        rig, hints, lambda model, _: LocalLimbs(model), engine, search, names=names, mesh=mesh
    )
    guess = first.guess(hull, Picture.of_frame(rig, seen), None, is_fitted_next=True)
    guess.model.close()
    return guess
