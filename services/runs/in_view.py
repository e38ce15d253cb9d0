"""Where in a take the actor is in view for the first time."""

from collections.abc import Callable

from services.mocap.errors import NotInViewError, TakeError
from services.mocap.take.folder import Take
from services.runs.fit import kept_warnings, seen_of
from services.segmentation.segmenters import AUTO, READY, chosen_segmenter, make_segmenter

_EVERY = 10
"""Every n-th frame is looked at."""


def frames_in_view(
    take: Take, frames: range, progress: Callable[[float], None], segmenter: str = AUTO
) -> range:
    """These frames of a take, from the first one on in which the whole actor is in view.

    They are returned as they are if the first frame shows the actor or has another fault, which the search
    for the first pose reports; if no frame shows the actor; and without pictures of the empty stage.
    """
    if chosen_segmenter(take, segmenter) != READY and not all(map(take.has_background, take.cameras)):
        return frames
    made = make_segmenter(take, take.cameras, segmenter)
    with kept_warnings():
        for frame in frames[::_EVERY]:
            progress((frame - frames.start) / len(frames))
            try:
                seen_of(take, range(frame, frame + 1), made, lambda _: None)
            except NotInViewError:
                continue
            except TakeError:
                if frame > frames.start:
                    continue
            return range(frame, frames.stop)
    return frames
