"""Fitting the actor of a take: what `xormocap fit` does, and `track` first where a take has no actor.toml."""

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial

import numpy as np

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.body_mesh import OwnMesh
from services.mocap.body.kinematics import joint_positions
from services.mocap.body.measures import Measure, measure, with_uncertainties
from services.mocap.camera.camera import Camera
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes, unpack
from services.mocap.energy.engine import Engine, open_engine
from services.mocap.energy.picture import Picture
from services.mocap.energy.settings import EngineSettings
from services.mocap.errors import TakeError
from services.mocap.fit.fitting import Fit, fit_actor
from services.mocap.fit.quality import in_best_skirt
from services.mocap.search.both_ways import found_anew
from services.mocap.search.first_frame import FirstFrame, check_alone, first_guess
from services.mocap.search.frame import solve_frame
from services.mocap.search.hull import carve
from services.mocap.search.jobs import LocalLimbs
from services.mocap.search.model import model_on_cpu
from services.mocap.search.settings import SearchSettings
from services.mocap.search.unsure_parts import untold_parts
from services.mocap.take.actor_file import rounded
from services.mocap.take.folder import Take
from services.mocap.take.settings import TakeSettings
from services.mocap.types import Bytes, Floats, Mask
from services.runs.reporting import Clock, Show, kept_warnings
from services.runs.take_silhouettes import TakeSilhouettes, seen_of
from services.runs.way_round import MOTION_FRAMES, Way, fit_best_way_round, tracked_px

log = logging.getLogger(__name__)

DEFAULT_INIT_FRAMES = 10
ROUGH_INIT_FRAMES = 5
"""Before a second fit to frames of the whole take, which then ends with the same body as after ten."""
_SKIRT = (
    "the actor seems to wear a skirt or a coat that hangs %.0f cm under the hip joints: what the legs do in "
    "it is estimated from what is visible of them"
)
_FIRST_FITS = 0.6
"""Progress of the fits from the generic body's pose; one from the fitted body's follows."""
_NEAR_M = 0.1
"""Fits from two first poses end about alike if none of their joints is farther apart."""
_POOR_IOU, _CLEARLY_BETTER_IOU = 0.8, 0.05
"""A fitted body overlaps less with the silhouettes if its first pose is wrong (in coats 0.85 is usual). Other
frames replace the first ones if they are better by so much."""
_LATER = (1 / 3, 2 / 3)
"""Where in a take other frames are tried."""
_FITTED_LATER = (
    "the body was fitted to %s, because in %s the actor's pose was not found (IoU %.2f, %.2f where it was "
    "fitted): the first poses of the take are less certain"
)


@dataclass(frozen=True, eq=False)
class TakeFit:
    """The actor of a take, and the poses of some of its frames, usually the first."""

    frames: Sequence[int]
    """In increasing order."""
    cameras: tuple[Camera, ...]
    """Cameras with usable silhouettes."""
    seen: TriPlanes
    """(F, P, H, W) of these cameras."""
    start: Actor
    """The body before the fit."""
    start_pose: Floats
    """The pose (D,) of the first frame from which the fit began."""
    actor: Actor
    """The fitted actor, as written to actor.toml."""
    fit: Fit
    measures: tuple[Measure, ...]
    seconds: dict[str, float]
    warnings: list[str]
    occluded: Mapping[str, Mask] = field(default_factory=dict)
    """By camera the pixels (h, w) in which something hides the actor, found by tracking; they are unsure in
    `seen`."""
    colour_tables: Mapping[str, Bytes] = field(default_factory=dict)
    """By camera what the actor's colour classes look like there, as tracking told them."""

    @property
    def iou(self) -> float:
        """Mean overlap of the fitted body and the silhouettes (intersection over union)."""
        return float(self.fit.after.iou.mean())


def frames_in_words(found: TakeFit) -> str:
    """Which frames an actor was fitted to."""
    ends = f"{found.frames[0]} to {found.frames[-1]}"
    return f"frames {ends}" if isinstance(found.frames, range) else f"{len(found.frames)} frames from {ends}"


def init_frames(
    take: Take, asked: int | None = None, start: int = 0, usual: int = DEFAULT_INIT_FRAMES
) -> range:
    """The frames for a fit: as many as requested, else as in take.toml, else as usual, from `start` on or,
    near the end of the take, the last ones."""
    n_frames = take.settings.frames
    wanted = min(asked or take.settings.init_frames or usual, n_frames)
    first = min(start, n_frames - wanted)
    return range(first, first + wanted)


def fit_take(
    silhouettes: TakeSilhouettes,
    frames: range,
    engine: EngineSettings,
    search: SearchSettings,
    show: Show,
    mesh: OwnMesh | None = None,
    before: int | None = None,
    *,
    is_refined_next: bool = False,
) -> TakeFit:
    """Fit the actor of a checked take to some of its frames, starting with the first.

    If that fit is poor, the pose of the first frame was probably not found; then as many frames later in the
    take, before a given one, are tried, and the best fit is returned. engine and search: for the first pose;
    the parameters of the search's body vary in the fit as well. mesh: fitted in place of the generic body.
    is_refined_next: whether a fit to frames of the whole take follows, for which a rougher one is enough.
    Cameras with unusable silhouettes in the first frame are left out, with a warning. Raises TakeError if no
    person or more than one is visible, or too few cameras are left.
    """
    take, fit_to = silhouettes.take, partial(_fit_frames, silhouettes, engine, search, mesh, is_refined_next)
    first = found = fit_to(frames, show)
    is_told = take.settings.actor_height is not None
    for start in _later_starts(frames, before or take.settings.frames) if first.iou < _POOR_IOU else ():

        def show_later(stage: str, share: float, start: int = start) -> None:
            show(f"{stage}, from frame {start}", share)

        try:
            later = fit_to(range(start, start + len(frames)), show_later)
            with kept_warnings():
                _check_alone(later, is_told=is_told)
        except TakeError as error:
            log.info("frame %d: %s", start, error)
            continue
        if len(later.cameras) >= len(first.cameras):
            found = max(found, later, key=lambda fit: fit.iou)
    with kept_warnings() as warnings:
        if found.iou < first.iou + _CLEARLY_BETTER_IOU:
            found = first
        else:
            log.warning(_FITTED_LATER, frames_in_words(found), frames_in_words(first), first.iou, found.iou)
        _check_alone(found, is_told=is_told)
    return replace(found, warnings=[*found.warnings, *warnings])


def _later_starts(frames: range, end: int) -> list[int]:
    """Where later, before frame `end`, as many frames as those begin, which do not overlap."""
    last = end - len(frames)
    starts = sorted({round(frames.start + share * (last - frames.start)) for share in _LATER})
    return [start for start in starts if frames.stop <= start <= last]


def _fit_frames(
    silhouettes: TakeSilhouettes,
    engine: EngineSettings,
    search: SearchSettings,
    mesh: OwnMesh | None,
    is_refined_next: bool,
    frames: range,
    show: Show,
) -> TakeFit:
    """Find the pose of the first of these frames, and fit the actor to all of them; as fit_take."""
    take = silhouettes.take
    clock, hints = Clock(show), take.settings.beginning_at(frames.start)
    with kept_warnings() as warnings:
        with clock.stage("looking at silhouettes") as progress:
            warnings += silhouettes.remarks
            made = silhouettes.segmenter
            cameras, seen = seen_of(take, frames, made, progress)
        rig, names = Rig.of(cameras), [camera.name for camera in cameras]
        with clock.stage("finding the first pose"), open_engine(engine) as opened:
            told = search.for_cameras([take.cameras.index(camera) for camera in cameras])
            guess = guess_first_pose(rig, seen[0], hints, opened, told, mesh, names)
        with clock.stage("fitting the actor") as progress:

            def fit_from(actor: Actor, pose: Floats, told: Callable[[float], None]) -> Fit:
                return fit_actor(rig, seen, actor, pose, told, search.body, hints.actor_height)

            @cache
            def later() -> list[TriPlanes]:
                """What is seen (P, H, W) in each of the frames that tell which way round the actor is."""
                longer = range(frames.start, min(frames.stop + MOTION_FRAMES, take.settings.frames))
                _, more = seen_of(take, longer, made, lambda _: None)
                return [more[frame] for frame in range(len(frames), len(longer))]

            way = fit_best_way_round(
                guess.first,
                partial(fit_from, guess.actor),
                lambda fit: tracked_px(rig, later(), fit, told),
                lambda share: progress(_FIRST_FITS * share),
            )
            again = None if hints.initial_pose else partial(_found_again, rig, seen[0], search=told)
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
    """The best of a way and of further fits: one in a skirt, if the actor seems to wear one, and one from the
    first pose as found_again finds it with the fitted body (None: the pose was given).

    is_refined_next: the last one is left out if that pose is near the way's.
    """
    ways = [way]
    dressed = actor.wearing(in_best_skirt(way.fit.actor, way.fit.poses, rig, seen).skirt)
    if dressed.skirt is not None:
        ways.append(Way(way.pose, fit_from(dressed, way.pose, lambda _: None)))
    fitted = ways[-1].fit
    pose = fitted.poses[0] if found_again is None else found_again(fitted.actor, fitted.poses[0])
    if not (is_refined_next and _is_near(fitted.actor, pose, fitted.poses[0])):
        rest = 1.0 - _FIRST_FITS
        ways.append(Way(pose, fit_from(dressed, pose, lambda share: progress(_FIRST_FITS + rest * share))))
    return min(ways, key=lambda way: way.energy_px)


def _found_again(rig: Rig, seen: TriPlanes, actor: Actor, pose: Floats, *, search: SearchSettings) -> Floats:
    """The pose (D,) of the first frame (P, H, W) for a fitted actor: the fit's, or a better one.

    The body by which the first pose was found had other limbs and no skirt.
    """
    with model_on_cpu(actor, rig) as model:
        limbs, picture = LocalLimbs(model), Picture.of_frame(rig, seen)
        starts = pose, found_anew(model, search, limbs, seen, pose)
        fitted, anew = (solve_frame(model, picture, start[None], search, limbs) for start in starts)
    return min(fitted, anew, key=lambda solution: solution.energy_px).pose


def _is_near(actor: Actor, one: Floats, other: Floats) -> bool:
    """Whether no joint is in quite another place in two poses (D,)."""
    joints_m = joint_positions(np.stack([one, other]), build_body(actor).offsets_m)
    return bool(np.linalg.norm(joints_m[1] - joints_m[0], axis=-1).max() < _NEAR_M)


def _check_alone(found: TakeFit, *, is_told: bool) -> None:
    """Raise TakeError if a fitted body covers too little of its first frame; warn if the height is told, as
    that may be wrong as well."""
    rig, names = Rig.of(found.cameras), [camera.name for camera in found.cameras]
    with model_on_cpu(found.fit.actor, rig) as model:
        picture, pose = Picture.of_frame(rig, found.seen[0]), found.fit.poses[0]
        check_alone(model, picture, pose, SearchSettings(), names, is_told=is_told)


def concluded(
    frames: Sequence[int],
    cameras: tuple[Camera, ...],
    seen: TriPlanes,
    start: tuple[Actor, Floats],
    fit: Fit,
    seconds: dict[str, float],
    warnings: list[str],
) -> TakeFit:
    """A fit with its results: the actor to write, its measures, and the unsure parts."""
    actor = rounded(fit.actor)
    with model_on_cpu(actor, Rig.of(cameras)) as model:
        names, when = [camera.name for camera in cameras], f"the {len(frames)} frames of the fit"
        where = "its overlay.png shows where"
        sentence = untold_parts(model, seen, fit.poses, names, when, where)
    if sentence:
        log.warning("%s", sentence)
    if actor.skirt is not None:
        log.warning(_SKIRT, 100.0 * actor.skirt.length * actor.height)
    measures = measure(build_body(actor.wearing(None)))
    if fit.shape_covariance is not None:
        measures = with_uncertainties(measures, actor, fit.shape_covariance)
    return TakeFit(frames, cameras, seen, *start, actor, fit, measures, seconds, warnings)


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

    names: of the cameras. The model's backend is closed. Raises TakeError for an implausible height.
    """
    hull = carve(rig, unpack(seen.silhouettes, rig.n_cameras), unpack(seen.possible, rig.n_cameras))
    picture = Picture.of_frame(rig, seen)
    pool = lambda model, _: LocalLimbs(model)  # noqa: E731
    guess = first_guess(
        hull, picture, rig, None, hints, pool, engine, search, mesh, names=names, is_fitted_next=True
    )
    guess.model.backend.close()
    return guess
