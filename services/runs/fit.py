"""Fitting the actor of a take: what `xormocap fit` does, and `track` first where a take has no actor.toml."""

import logging
from dataclasses import replace
from functools import partial

from services.mocap.body.body_mesh import OwnMesh
from services.mocap.camera.rig import Rig
from services.mocap.energy.picture import Picture
from services.mocap.energy.settings import EngineSettings
from services.mocap.errors import TakeError
from services.mocap.search.model import model_on_cpu
from services.mocap.search.settings import SearchSettings
from services.mocap.search.single_person import check_alone
from services.mocap.take.folder import Take
from services.runs.fit_frames import fit_frames
from services.runs.past_furniture import fit_past_furniture
from services.runs.reporting import Show, kept_warnings
from services.runs.take_fit import TakeFit, frames_in_words, warn_of_occluded
from services.runs.take_silhouettes import TakeSilhouettes

log = logging.getLogger(__name__)

DEFAULT_INIT_FRAMES = 10
ROUGH_INIT_FRAMES = 5
"""Before a second fit to frames of the whole take, which then ends with the same body as after ten."""
_POOR_IOU, _CLEARLY_BETTER_IOU = 0.8, 0.05
"""A fitted body overlaps less with the silhouettes if its first pose is wrong (in coats 0.85 is usual). Other
frames replace the first ones if they are better by so much."""
_LATER = (1 / 3, 2 / 3)
"""Where in a take other frames are tried."""
_FITTED_LATER = (
    "the body was fitted to %s, because in %s the actor's pose was not found (IoU %.2f, %.2f where it was "
    "fitted): the first poses of the take are less certain"
)


def init_frames(
    take: Take, asked: int | None = None, start: int = 0, *, is_refined_next: bool = False
) -> range:
    """The frames for a fit: as many as requested, else as in take.toml, else ten, from `start` on or, near
    the end of the take, the last ones; at most ROUGH_INIT_FRAMES if it is refined next."""
    n_frames = take.settings.frames
    wanted = min(asked or take.settings.init_frames or DEFAULT_INIT_FRAMES, n_frames)
    if is_refined_next:
        wanted = min(wanted, ROUGH_INIT_FRAMES)
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
    take = silhouettes.take

    def fit_to(some: range, show: Show) -> TakeFit:
        return fit_past_furniture(
            partial(fit_frames, silhouettes, engine, search, mesh, some, is_refined_next=is_refined_next),
            lambda: silhouettes.segmenter.source.blind(),
            show,
        )

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
        warn_of_occluded(take, found.occluded)
    return replace(found, warnings=[*found.warnings, *warnings])


def _later_starts(frames: range, end: int) -> list[int]:
    """Where later, before frame `end`, as many frames as those begin, which do not overlap."""
    last = end - len(frames)
    starts = sorted({round(frames.start + share * (last - frames.start)) for share in _LATER})
    return [start for start in starts if frames.stop <= start <= last]


def _check_alone(found: TakeFit, *, is_told: bool) -> None:
    """Raise TakeError if a fitted body covers too little of its first frame; warn if the height is told, as
    that may be wrong as well."""
    rig, names = Rig.of(found.cameras), [camera.name for camera in found.cameras]
    with model_on_cpu(found.fit.actor, rig) as model:
        picture, pose = Picture.of_frame(rig, found.seen[0]), found.fit.poses[0]
        check_alone(model, picture, pose, SearchSettings(), names, is_told=is_told)
