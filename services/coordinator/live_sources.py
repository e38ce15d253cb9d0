"""What segmentation says of live cameras: which are there, what was dropped of them, whether all is over."""

from proto.messages import LiveSources
from proto.streams import FROM_LIVE_CAMERAS

_COMPLETE_S = 10.0
"""How long after the first group of cameras others are waited for."""


class SourceWords:
    """The last word of every group of cameras."""

    def __init__(self, n_cameras: int) -> None:
        self._n_cameras = n_cameras
        self._words: dict[tuple[int, ...], tuple[LiveSources, float]] = {}
        """By the group's cameras, and when it was heard."""
        self._first_s: float | None = None

    def note(self, message: LiveSources, now_s: float) -> None:
        """Take a group's word in."""
        self._first_s = self._first_s or now_s
        self._words[tuple(message.cameras)] = (message, now_s)

    @property
    def cameras(self) -> list[int]:
        """Those that anything was heard of."""
        return sorted({c for cameras in self._words for c in cameras})

    def are_complete(self, now_s: float) -> bool:
        """Whether all cameras have been heard of, or that takes too long."""
        waited_s = now_s - (self._first_s or now_s)
        return len(self.cameras) == self._n_cameras or waited_s > _COMPLETE_S

    @property
    def latest_s(self) -> list[float]:
        """When the latest pictures of the cameras were taken."""
        return [taken_s for word, _ in self._words.values() for taken_s in word.latest_s]

    def have_ended(self, now_s: float) -> bool:
        """Whether all sources of those that still speak are files that are over."""
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
