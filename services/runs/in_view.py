"""Where in a take the actor is in view for the first time."""

from collections.abc import Callable

from services.mocap.errors import NotInViewError, TakeError
from services.mocap.take.folder import Take
from services.runs.fit import kept_warnings, seen_of
from services.segmentation.segmenters import AUTO, READY, chosen_segmenter, make_segmenter
from services.segmentation.silhouettes import Segmenter

_EVERY, _MOST_LOOKS = 10, 60
"""Every tenth frame is looked at, but at most 60 frames of a take, because each look opens all videos."""
_FURTHER_LOOKS = 6
"""After a frame that shows the actor, so many more are looked at for one that every camera sees."""


def frames_in_view(
    take: Take, frames: range, progress: Callable[[float], None], segmenter: str = AUTO
) -> range:
    """These frames of a take, from the first one on in which the whole actor is in view.

    They are returned as they are if the first frame shows the actor or has another fault, which the search
    for the first pose reports; if no frame shows the actor; and if the background is estimated from the
    videos. Of the first frames that show the actor, one that all cameras see is preferred.
    """
    is_ready = chosen_segmenter(take, segmenter) == READY
    if len(take.cameras) < 2 or not (is_ready or all(map(take.has_background, take.cameras))):
        return frames
    with kept_warnings():
        # Plates are checked by what comes after this, and said then.
        made = make_segmenter(take, take.cameras, segmenter, later=lambda _: None)
        if _cameras_that_see(take, frames.start, made, of_other_faults=1):
            return frames
        looks = frames[:: max(_EVERY, len(frames) // _MOST_LOOKS)][1:]
        best, most, n_further = frames.start, 0, _FURTHER_LOOKS
        for frame in looks:
            progress((frame - frames.start) / len(frames))
            n_cameras = _cameras_that_see(take, frame, made)
            if n_cameras > most:
                best, most = frame, n_cameras
            n_further -= most > 0
            if most == len(take.cameras) or n_further == 0:
                break
    return range(best, frames.stop)


def _cameras_that_see(take: Take, frame: int, made: Segmenter, of_other_faults: int = 0) -> int:
    """How many cameras see the actor in a frame, most of them as a whole; 0 if those are too few.

    of_other_faults: returned for a frame that cannot be used for another reason.
    """
    try:
        cameras, _ = seen_of(take, range(frame, frame + 1), made, lambda _: None)
    except NotInViewError:
        return 0
    except TakeError:
        return of_other_faults
    return len(cameras)
