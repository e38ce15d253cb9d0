"""Follows a coordinator: its poses, actor, rig, and missed frames; this costs the coordinator almost
nothing."""

import logging
import threading
import time
from collections.abc import Callable, Sequence
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
from services.mocap.result.layout import journal_of
from services.mocap.take.actor_file import take_actor
from services.mocap.take.folder import Take
from services.mocap.take.live import LiveTake
from services.viewer.frame_history import MOST_FRAMES, FrameHistory
from services.viewer.metrics import FRAMES
from services.viewer.missed_frames import CHUNK_FRAMES, RetryRequests, read_journal
from services.viewer.picture_sources import LivePictures, TakePictures
from services.viewer.show import Show
from services.viewer.solved_frame import solved_frame_of
from services.viewer.tiles import TileArtist

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
        self._folder, self._present = folder, present
        self._journal = None if results is None else journal_of(results)
        self._reads_journal = False
        """Whether the journal is to be read, as soon as it is not being read."""
        self._reading: threading.Thread | None = None
        """The journal of a long take needs seconds, and messages must not wait."""
        has_pictures = folder is not None and not isinstance(folder, LiveTake)
        self._folder_pictures = TakePictures(folder, None) if folder is not None and has_pictures else None
        self._history: FrameHistory | None = None
        self._filling = RetryRequests()
        self._pictures: LivePictures | None = None

    def on_take(self, info: TakeInfo) -> None:
        """Begin anew."""
        self._pictures = None
        self._filling, self._reads_journal = RetryRequests(), True
        frames = range(info.first_frame, info.end_frame)
        self._history = FrameHistory(frames, is_open=len(frames) > MOST_FRAMES)

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
            FRAMES.inc()
            self._history.put(solved_frame_of(message, time.monotonic()))
        elif isinstance(message, Silhouettes) and self._pictures is not None:
            self._pictures.add(message)
        elif isinstance(message, TakeEnd) and self._history is not None and not self._history.is_over:
            self._history.is_over = self._reads_journal = True

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
        """Requests for the end of the last gap in the frames. What the coordinator no longer has is read from
        the journal."""
        info, history, filling = self.info, self._history, self._filling
        if info is None or history is None:
            return ()
        requests = list[Message]()
        if (gap := history.last_gap(filling.gone_end)) is not None:
            wanted, gone_end = gap[-CHUNK_FRAMES:], filling.gone_end
            if filling.asks(wanted, time.monotonic(), self.heard_s):
                requests.append(PoseRequest(run=info.run, first_frame=wanted.start, end_frame=wanted.stop))
            self._reads_journal |= filling.gone_end > gone_end
        is_reading = self._reading is not None and self._reading.is_alive()
        if self._reads_journal and self._journal is not None and not is_reading:
            self._reads_journal = False
            arguments = self._journal, info.run, history
            self._reading = threading.Thread(target=read_journal, args=arguments, daemon=True)
            self._reading.start()
        return requests
