"""Looks for mistakes in a take before it is fitted or tracked, which takes seconds."""

from collections.abc import Callable, Iterator

from services.mocap.calibration.mistakes import Mistake, mistakes_in, wrong_up
from services.mocap.calibration.silhouette_faults import silhouette_faults
from services.mocap.errors import TakeError
from services.mocap.take.folder import Take
from services.mocap.take.layout import BACKGROUND
from services.mocap.verdict.verdict import Cause
from services.runs.fit import kept_warnings
from services.runs.outlines import outlines_of
from services.segmentation.segmenters import AUTO, KINDS, READY, chosen_segmenter

_MOST_FRAMES, _FEWEST_FRAMES = 60, 12
_MOST_PX = 40 * 4 * 640 * 480
"""Pixels of videos that are segmented, in all cameras and frames together."""


def check_before(
    take: Take, frames: range, progress: Callable[[float], None], segmenter: str = AUTO
) -> tuple[Cause, ...]:
    """What is wrong with a take, as far as its first frames tell.

    Raises TakeError where it is certain that the take cannot be tracked.
    """
    return tuple(
        Cause(
            what=f"{mistake.file}: {mistake.what}" if mistake.file else mistake.what,
            remedy=mistake.remedy,
            level="usable with gaps" if mistake.is_out_of_step else "good",
        )
        for mistake in _mistakes(take, frames, progress, segmenter)
    )


def _mistakes(
    take: Take, frames: range, progress: Callable[[float], None], segmenter: str
) -> Iterator[Mistake]:
    turned = wrong_up(take.cameras, take.settings.up)
    if turned is not None:
        raise _refused(take, turned)
    kind = chosen_segmenter(take, segmenter)
    if kind != READY and not all(map(take.has_background, take.cameras)):
        if kind.partition(":")[0] in KINDS and KINDS[kind.partition(":")[0]].needs_plate:
            yield Mistake(
                f"{BACKGROUND}/",
                "there is no picture of the empty stage; it is estimated from the videos, and silhouettes "
                "will be wrong where the actor stays",
                f"record the empty stage for a second into {BACKGROUND}/<camera>.mp4",
            )
        return  # what is estimated from the videos is no proof of anything
    if len(take.cameras) < 2:
        return
    n_frames = _MOST_FRAMES
    if kind != READY:
        each_px = sum(camera.width_px * camera.height_px for camera in take.calibrated)
        n_frames = min(max(_MOST_PX // each_px, _FEWEST_FRAMES), _MOST_FRAMES)
    looked_at = range(frames.start, min(frames.stop, frames.start + n_frames))
    with kept_warnings() as warnings:
        cameras, outlines, middle = outlines_of(take, looked_at, 1, progress, segmenter)
    found = mistakes_in(cameras, outlines, take.settings.up)
    for mistake in found:
        if mistake.is_certain:
            raise _refused(take, mistake)
    yield from (Mistake("", sentence, "") for sentence in warnings)
    # One camera alone is segmented less well than all together.
    yield from (mistake for mistake in found if kind == READY or mistake.is_out_of_step)
    yield from silhouette_faults(cameras, outlines, middle)


def _refused(take: Take, mistake: Mistake) -> TakeError:
    return TakeError(f"{take.folder}/{mistake} (--no-check goes on nevertheless)")
