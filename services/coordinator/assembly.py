"""Putting a frame together from what several segmentation processes send, without a socket."""

from proto.messages import Silhouettes
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes, fit_together, joined


class FrameAssembler:
    """Collects the cameras of each frame of a run; hands frames out whole and in order."""

    def __init__(self, take: str, run: str, rig: Rig, first_frame: int, end_frame: int) -> None:
        self._ids, self._rig = (take, run), rig
        self._next, self._end = first_frame, end_frame
        self._partial: dict[int, dict[int, tuple[TriPlanes, int]]] = {}
        self.dropped = 0
        """Messages that belonged to another take, run or frame, or made no sense."""

    @property
    def next_frame(self) -> int:
        """The frame that is handed out next."""
        return self._next

    def add(self, message: Silhouettes, credit_end: int) -> None:
        """Take in some cameras of a frame; what is not wanted is counted and dropped.

        credit_end: frames from it on were not asked for, so that memory stays bounded.
        """
        wanted = range(self._next, min(self._end, credit_end))
        ids = (message.take, message.run)
        if ids != self._ids or message.frame not in wanted or not self._fits(message):
            self.dropped += 1
            return
        planes = TriPlanes.of_sent(message.planes, message.unsure)
        places = {camera: (planes, k) for k, camera in enumerate(message.cameras)}
        self._partial.setdefault(message.frame, {}).update(places)

    def _fits(self, message: Silhouettes) -> bool:
        cameras = message.cameras
        known = len(set(cameras)) == len(cameras) and max(cameras) < self._rig.n_cameras
        return known and fit_together(message.planes, message.unsure, len(cameras), self._rig.shape_px)

    def take_next(self) -> TriPlanes | None:
        """Planes (P, H, W) of the next frame once all its cameras are there, else None."""
        places = self._partial.get(self._next, {})
        if len(places) < self._rig.n_cameras:
            return None
        del self._partial[self._next]
        self._next += 1
        return joined([places[c] for c in range(self._rig.n_cameras)])

    def first_lacking(self) -> int:
        """The first frame from the next one on of which a camera is lacking."""
        frame = self._next
        while len(self._partial.get(frame, {})) == self._rig.n_cameras:
            frame += 1
        return frame

    @property
    def n_ready(self) -> int:
        """Whole frames that wait to be handed out."""
        return self.first_lacking() - self._next

    def waiting_for(self) -> list[int]:
        """Cameras that the next frame still lacks."""
        have = self._partial.get(self._next, {})
        return [c for c in range(self._rig.n_cameras) if c not in have]
