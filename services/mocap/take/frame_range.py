"""A range of a take's frames, as users write it."""

from services.mocap.errors import UserError
from services.mocap.take.folder import Take


def frame_range(text: str, take: Take) -> range:
    """A:B, either of which may be left out, as frames A up to but not including B; raises UserError."""
    first, colon, end = text.partition(":")
    n_frames = take.settings.frames
    try:
        if not colon:
            raise ValueError
        frames = range(int(first or 0), int(end or n_frames))
    except ValueError:
        raise UserError(f"--frames {text}: expected A:B, such as 0:50") from None
    if not 0 <= frames.start < frames.stop <= n_frames:
        raise UserError(f"--frames {text}: expected a range within 0:{n_frames}, the frames of {take.folder}")
    return frames
