"""Follows a coordinator: its poses, actor, rig, and missed frames; this costs the coordinator almost
nothing."""

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from proto.keys import ClientKeys
from proto.messages import Message, Pose, PoseRequest, Silhouettes, SilhouettesRequest, TakeEnd, TakeInfo
from services.follower import Follower
from services.mocap.body.actor import Actor, build_body
from services.mocap.body.kinematics import N_DOF
from services.mocap.camera.rig import Rig
from services.mocap.errors import UserError
from services.mocap.export.model_painter import ModelPainter
from services.mocap.take.actor_file import take_actor
from services.mocap.take.folder import Take
from services.mocap.take.live import LiveTake
from services.viewer.archive import CHUNK_FRAMES, Archive, RetryRequests, solved_frame_of
from services.viewer.frame_history import KEPT_FRAMES, FrameHistory
from services.viewer.picture_sources import LivePictures, TakePictures
from services.viewer.show import Show
from services.viewer.tiles import TileArtist

_MOST_FRAMES = 100_000
"""Longest timeline: some hours of live input, whose end is open."""

log = logging.getLogger(__name__)


class TakePresenter(Follower):
    """Presents the coordinator's takes, one after the other."""

    def __init__(
        self,
        endpoint: str,
        keys: ClientKeys | None,
        folder: Take | None,
        present: Callable[[Show], None],
        results: Path | None = None,
    ) -> None:
        """folder: the take folder, for its pictures, if it is on this host. present is called with each show.

        results: the path of the results on this host; the recorder's journal is next to it.
        """
        super().__init__(endpoint, keys)
        self._folder, self._present, self._results = folder, present, results
        has_pictures = folder is not None and not isinstance(folder, LiveTake)
        self._folder_pictures = TakePictures(folder, None) if folder is not None and has_pictures else None
        self._history: FrameHistory | None = None
        self._archive: Archive | None = None
        self._filling = RetryRequests()
        self._pictures: LivePictures | None = None

    def on_take(self, info: TakeInfo) -> None:
        """Begin anew."""
        self._pictures = None
        self._filling = RetryRequests()
        last_end = info.first_frame + _MOST_FRAMES
        frames, is_open = range(info.first_frame, min(info.end_frame, last_end)), info.end_frame > last_end
        self._archive = Archive(info, frames, self._results, self.ask, lambda: self.heard_s)
        self._history = FrameHistory(frames, KEPT_FRAMES, self._archive, is_open=is_open)

    def prepare(self) -> None:
        """Prepare in advance what the first pictures need; call it in a separate thread.

        Loads what draws the model, and opens the videos.
        """
        try:
            if self._folder is not None:
                body = build_body(take_actor(self._folder) or Actor())
                ModelPainter(body, Rig.of(self._folder.cameras)).segment_masks(np.zeros(N_DOF))
            if self._folder_pictures is not None:
                self._folder_pictures.open()
        except UserError as error:  # reported when pictures are requested
            log.warning("%s", error)

    def on_message(self, message: Message) -> None:
        """Store a message's content for the page."""
        if isinstance(message, Pose) and self._history is not None:
            self._history.put(replace(solved_frame_of(message), arrived_s=time.monotonic()))
        elif isinstance(message, Silhouettes) and self._pictures is not None:
            self._pictures.add(message)
        elif isinstance(message, TakeEnd) and self._history is not None and self._archive is not None:
            self._history.is_over = self._archive.is_over = True

    def on_content(self, actor: Actor, rig: Rig) -> None:
        """Present the take."""
        info, history = self.info, self._history
        if info is None or history is None:
            return
        body, folder, pictures = build_body(actor), self._folder, self._folder_pictures
        names = tuple(f"camera {c + 1}" for c in range(rig.n_cameras))
        if folder is not None:
            if folder.settings.name == info.take and folder.settings.frames >= info.end_frame:
                names = tuple(camera.name for camera in folder.cameras)
            else:
                pictures = None
                log.warning("%s is another take than %s: showing only silhouettes", folder.folder, info.take)
        self._pictures = LivePictures(rig, pictures, lambda frame: self.ask(SilhouettesRequest(frame=frame)))
        artist, has_pictures = TileArtist(body, rig, self._pictures), pictures is not None
        show = Show(info.take, info.fps, history, body, rig, names, artist, True, has_pictures)
        self._present(show)

    def lacking(self) -> Sequence[Message]:
        """Requests for the end of the last gap in the frames, unless the coordinator no longer has them."""
        gap = None if self._history is None else self._history.last_gap(self._filling.gone_end)
        if gap is None or self.info is None:
            return ()
        wanted = gap[-CHUNK_FRAMES:]
        if not self._filling.asks(wanted, time.monotonic(), self.heard_s):
            return ()
        return (PoseRequest(run=self.info.run, first_frame=wanted.start, end_frame=wanted.stop),)
