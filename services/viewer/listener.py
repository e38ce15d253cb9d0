"""Follows a coordinator: its poses, what they mean, and what was missed; it costs that next to nothing."""

import logging
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from proto.keys import ClientKeys
from proto.messages import Message, Pose, PoseRequest, Silhouettes, SilhouettesRequest, TakeEnd, TakeInfo
from services.follower import Follower
from services.mocap.body.actor import Actor, build_body
from services.mocap.camera.rig import Rig
from services.mocap.take.folder import Take
from services.mocap.take.marks import PARTS
from services.viewer.asking import Asking
from services.viewer.finished import FinishedTake
from services.viewer.pictures import TakePictures
from services.viewer.reel import RING_FRAMES, STAGES, Reel, Shot
from services.viewer.seen import LivePictures
from services.viewer.show import Show
from services.viewer.tiles import TileArtist

_CHUNK_FRAMES = 64
"""Poses that the coordinator sends at one request, at most."""

_MOST_FRAMES = 100_000
"""How far a timeline reaches at most: some hours of live input, whose end is open."""

log = logging.getLogger(__name__)


class Listener(Follower):
    """Makes a show of whatever the coordinator tracks, take after take."""

    def __init__(
        self,
        endpoint: str,
        keys: ClientKeys | None,
        folder: Take | None,
        present: Callable[[Show], None],
        results: Path | None = None,
    ) -> None:
        """folder: the take's, for its pictures, where this host has it. present is called with each show.

        results: where the results will be, from which frames come that nobody else has any more.
        """
        super().__init__(endpoint, keys)
        self._folder, self._present, self._results = folder, present, results
        self._reel: Reel | None = None
        self._filling, self._scrubbing = Asking(), Asking()
        self._pictures: LivePictures | None = None

    def begin(self, info: TakeInfo) -> None:
        """Begin anew."""
        self._pictures = None
        self._filling, self._scrubbing = Asking(), Asking()
        finished = FinishedTake(self._results, info.take)
        frames = range(info.first_frame, min(info.end_frame, info.first_frame + _MOST_FRAMES))
        self._reel = Reel(frames, RING_FRAMES, lambda frame: self._older(frame, finished))

    def hear(self, message: Message) -> None:
        """Take in what a page may show."""
        if isinstance(message, Pose) and self._reel is not None:
            self._reel.put(_shot(message))
        elif isinstance(message, Silhouettes) and self._pictures is not None:
            self._pictures.add(message)
        elif isinstance(message, TakeEnd) and self._reel is not None:
            self._reel.is_over = True

    def _older(self, frame: int, finished: FinishedTake) -> Shot | None:
        """A frame that has left the ring: from the results, or asked for, with those about it."""
        if self._reel is not None and self._reel.is_over and (shot := finished.shot(frame)) is not None:
            return shot
        is_wanted = self._scrubbing.asks(range(frame, frame + 1), time.monotonic(), self.heard_s)
        if self.info is not None and is_wanted:
            end = frame + _CHUNK_FRAMES
            self.ask(PoseRequest(run=self.info.run, first_frame=frame, end_frame=end))
        return None

    def learn(self, actor: Actor, rig: Rig) -> None:
        """Present the take."""
        info, reel = self.info, self._reel
        if info is None or reel is None:
            return
        body = build_body(actor)
        folder = self._folder if self._folder is not None and self._fits(self._folder, info) else None
        pictures = None if folder is None else TakePictures(folder, None)
        self._pictures = LivePictures(rig, pictures, lambda frame: self.ask(SilhouettesRequest(frame=frame)))
        if folder is None:
            names = tuple(f"camera {c + 1}" for c in range(rig.n_cameras))
        else:
            names = tuple(camera.name for camera in folder.cameras)
        artist = TileArtist(body, rig, self._pictures)
        self._present(Show(info.take, info.fps, reel, body, rig, names, artist, is_live=True))

    def _fits(self, folder: Take, info: TakeInfo) -> bool:
        """Whether a folder is that of the take that is tracked."""
        fits = folder.settings.name == info.take and folder.settings.frames >= info.end_frame
        if not fits:
            log.warning("%s is another take than %s: there are silhouettes only", folder.folder, info.take)
        return fits

    def lacking(self) -> Sequence[Message]:
        """The end of the last gap in the frames, unless the coordinator has nothing so old."""
        gap = None if self._reel is None else self._reel.last_gap(self._filling.gone_end)
        if gap is None or self.info is None:
            return ()
        wanted = gap[-_CHUNK_FRAMES:]
        if not self._filling.asks(wanted, time.monotonic(), self.heard_s):
            return ()
        return (PoseRequest(run=self.info.run, first_frame=wanted.start, end_frame=wanted.stop),)


def _shot(message: Pose) -> Shot:
    return Shot(
        frame=message.frame,
        time_s=message.time_s,
        pose=message.pose,
        energy_px=message.energy_px,
        confidence=np.array([message.confidence.get(part, np.nan) for part in PARTS]),
        distrusted=np.array([part in message.distrusted for part in PARTS]),
        part_px=np.array([message.part_px.get(part, np.nan) for part in PARTS]),
        seconds=np.array([message.seconds.get(stage, np.nan) for stage in STAGES]),
        arrived_s=time.monotonic(),
    )
