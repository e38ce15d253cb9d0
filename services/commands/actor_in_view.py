"""Where in a take the actor comes into view: the work begins there."""

from collections.abc import Callable

from services.commands.consoles import progress_bar, warn
from services.mocap.energy.bitplanes import camera_bit
from services.mocap.errors import NotInViewError, TakeError
from services.mocap.take.folder import Take
from services.runs.reporting import kept_warnings
from services.runs.take_silhouettes import TakeSilhouettes, seen_of
from services.segmentation.silhouettes import Segmenter

_EVERY, _MOST_LOOKS = 10, 60
"""For the actor every tenth frame is looked at, but at most 60 frames of a take."""
_FURTHER_LOOKS = 6
"""After a frame that shows the actor, so many more are looked at for one that every camera sees."""
_NOT_IN_VIEW = (
    "silhouettes: frame {first} does not show the whole actor: the work begins at frame {start}{hints}"
)
_NO_HINTS = "; facing and initial_pose in take.toml describe frame 0 and are not used"


def in_view(silhouettes: TakeSilhouettes, frames: range) -> range:
    """These frames from the first one on that shows the whole actor; a warning says if it is a later one."""
    with progress_bar() as show:
        found = _frames_in_view(silhouettes, frames, lambda share: show("looking for the actor", share))
        show("actor in view", 1.0)
    if found.start > frames.start:
        told = silhouettes.take.settings
        hints = _NO_HINTS if told.facing is not None or told.initial_pose else ""
        warn([_NOT_IN_VIEW.format(first=frames.start, start=found.start, hints=hints)])
    return found


def _frames_in_view(silhouettes: TakeSilhouettes, frames: range, progress: Callable[[float], None]) -> range:
    """These frames of a take, from the first one on in which the whole actor is in view.

    They are returned as they are if the first frame shows the actor or has another fault, which the search
    for the first pose reports; if no frame shows the actor; and if the background is estimated from the
    videos. Of the first frames that show the actor, one that all cameras see is preferred.
    """
    take = silhouettes.take
    if len(take.cameras) < 2 or not silhouettes.has_stage:
        return frames
    segmenter = silhouettes.segmenter
    with kept_warnings():  # what comes after this says them again
        if _cameras_that_see(take, frames.start, segmenter) != 0:
            return frames
        looks = frames[:: max(_EVERY, -(-len(frames) // _MOST_LOOKS))][1:]
        best, most, n_further, before = frames.start, 0, _FURTHER_LOOKS, frames.start
        for frame in looks:
            progress((frame - frames.start) / len(frames))
            n_cameras = _cameras_that_see(take, frame, segmenter) or 0
            if n_cameras > most:
                best, most = frame, n_cameras
            if most > 0:
                n_further -= 1
            else:
                before = frame
            if most == len(take.cameras) or n_further == 0:
                break
        while most > 0 and best - before > _EVERY:  # looks at a long take are far apart
            middle = (before + best) // 2
            if (_cameras_that_see(take, middle, segmenter) or 0) >= most:
                best = middle
            else:
                before = middle
    return range(best, frames.stop)


def _cameras_that_see(take: Take, frame: int, segmenter: Segmenter) -> int | None:
    """How many cameras see the actor in a frame, most of them as a whole; 0 if those are too few, and None if
    the frame cannot be used for another reason."""
    try:
        cameras, seen = seen_of(take, range(frame, frame + 1), segmenter, lambda _: None)
    except NotInViewError:
        return 0
    except TakeError:
        return None
    return sum(bool(camera_bit(seen.silhouettes[0], c).any()) for c in range(len(cameras)))
