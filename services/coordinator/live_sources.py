"""Reports of segmentation on live cameras: which are present, what was dropped, whether they have ended."""

from proto.messages import LiveSources
from proto.streams import FROM_LIVE_CAMERAS

_COMPLETE_S = 10.0
"""How long to wait for other groups of cameras after the first."""


class SourceWords:
    """The last report of every group of cameras."""

    def __init__(self, n_cameras: int) -> None:
        self._n_cameras = n_cameras
        self._words: dict[tuple[int, ...], tuple[LiveSources, float]] = {}
        """By the group's cameras, and when it was heard."""
        self._first_s: float | None = None

    def note(self, message: LiveSources, now_s: float) -> None:
        """Store a group's report."""
        self._first_s = self._first_s or now_s
        self._words[tuple(message.cameras)] = (message, now_s)

    @property
    def cameras(self) -> list[int]:
        """Cameras with a report."""
        return sorted({c for cameras in self._words for c in cameras})

    def are_complete(self, now_s: float) -> bool:
        """Whether all cameras have reported, or the time limit has passed."""
        waited_s = now_s - (self._first_s or now_s)
        return len(self.cameras) == self._n_cameras or waited_s > _COMPLETE_S

    @property
    def latest_s(self) -> list[float]:
        """When the latest pictures of the cameras were taken."""
        return [taken_s for word, _ in self._words.values() for taken_s in word.latest_s]

    def have_ended(self, now_s: float) -> bool:
        """Whether the sources of all groups that still report are files that have ended."""
        here = [
            word for word, heard_s in self._words.values() if now_s - heard_s < FROM_LIVE_CAMERAS.silence_s
        ]
        return bool(here) and all(word.ended for word in here)

    def drops(self) -> dict[int, tuple[int, int, int]]:
        """Of each camera: pictures that did not come, that segmentation dropped, that were not sent."""
        return {
            c: (word.missed[k], word.dropped[k], word.unsent)
            for cameras, (word, _) in self._words.items()
            for k, c in enumerate(cameras[: min(len(word.missed), len(word.dropped))])
        }
