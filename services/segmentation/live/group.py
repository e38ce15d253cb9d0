"""A group of live cameras: a feed of each, and the shots they make together."""

import logging
import threading
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from services.mocap.camera.camera import Camera
from services.mocap.errors import UserError
from services.mocap.take.live import LiveTake
from services.mocap.types import Bytes
from services.segmentation.live.recording import CameraRecording
from services.segmentation.live.shots import CoordinatorClock, Shots
from services.segmentation.live.sources import (
    FileSource,
    Source,
    SourceLostError,
    StreamSource,
    check_size_of,
)

_AGAIN_S = 0.25
"""Between two tries to open a source that is gone."""

log = logging.getLogger(__name__)


class Feed:
    """Gives a camera's pictures to whoever wants them, from a thread of its own.

    The thread reads the camera's source, and opens it again for as long as it is gone. begin: waits until the
    source may be opened, and opens it; raises SourceLostError. give: called in the feed's thread with each
    picture (H, W, 3) and the moment it was taken, by this machine's monotonic clock.
    """

    def __init__(
        self,
        camera: Camera,
        begin: Callable[[threading.Event], Source | None],
        give: Callable[[Bytes, float], None],
    ) -> None:
        self._camera, self._begin, self._give = camera, begin, give
        self._stopped = threading.Event()
        self._is_lost = False
        self.has_ended = False
        """Whether no picture will ever follow."""
        self.problem: UserError | None = None
        """Why it cannot go on, which the user has to mend."""
        self._thread = threading.Thread(target=self._run, name=f"feed-{camera.name}", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        name = self._camera.name
        while not self._stopped.is_set() and not self.has_ended:
            try:
                self._read_all()
            except SourceLostError as problem:
                if not self._is_lost:
                    self._is_lost = True
                    log.warning("%s is gone, and looked for until it is back: %s", name, problem)
                self._stopped.wait(_AGAIN_S)
            except UserError as problem:
                self.problem, self.has_ended = problem, True

    def _read_all(self) -> None:
        """Read a source to its end; raises SourceLostError."""
        source = self._begin(self._stopped)
        if source is None:
            return
        try:
            while not self._stopped.is_set():
                picture = source.read()
                if picture is None:
                    self.has_ended = True
                    return
                check_size_of(self._camera.name, self._camera, *picture.image.shape[:2])
                if self._is_lost:
                    self._is_lost = False
                    log.info("%s is back", self._camera.name)
                self._give(picture.image, picture.taken_s)
        finally:
            source.close()

    def stop(self) -> None:
        """Ask it to end; it does so after the picture that it is waiting for."""
        self._stopped.set()

    def join(self) -> None:
        """Wait for its end, a moment: a source that hangs does not hold up the others."""
        self._thread.join(2.0)


class Group:
    """The feeds of some cameras, and shots once the coordinator's clock tells which is when."""

    def __init__(
        self, take: LiveTake, cameras: Sequence[int], clock: CoordinatorClock, record: Path | None
    ) -> None:
        """record: the folder of a take that is to be made of the pictures."""
        self._take, self._clock, live = take, clock, take.live
        self._begun = threading.Event()
        self._files_begin_s = 0.0
        self.shots = Shots(len(cameras), clock, live.reach_s, live.period_s, live.grace_s)
        self._recordings = [
            CameraRecording(record, take.cameras[c], live.fps) for c in cameras if record is not None
        ]
        self._feeds = [
            Feed(take.cameras[c], partial(self._open, k, c), partial(self._give, k))
            for k, c in enumerate(cameras)
        ]

    def _open(self, k: int, c: int, stopped: threading.Event) -> Source | None:
        """A camera's source; files begin with shot 0, so that each of their pictures has its number."""
        source = self._take.sources[c]
        if not source.is_file:
            return StreamSource(source, self._take.cameras[c], self._take.live.fps)
        while not self._begun.wait(0.1):
            if stopped.is_set():
                return None
        passed_over = partial(self.shots.pass_over, k)
        return FileSource(Path(str(source.source)), self._files_begin_s, stopped, passed_over)

    def _give(self, k: int, image: Bytes, taken_s: float) -> None:
        shot = self.shots.put(k, image, taken_s)
        if shot is not None and self._recordings:
            self._recordings[k].add(shot, image, taken_s - self._files_begin_s)

    def begin(self) -> None:
        """The coordinator's clock tells from now on which shot is when."""
        if not self._begun.is_set():
            self._files_begin_s = self._clock.here_s(self._clock.due_s(0))
            self._begun.set()

    @property
    def is_recording(self) -> bool:
        """Whether a take is made of the pictures."""
        return bool(self._recordings)

    @property
    def has_ended(self) -> bool:
        """Whether no picture will ever follow."""
        return all(feed.has_ended for feed in self._feeds)

    def check(self) -> None:
        """Raise what a user has to mend."""
        for feed in self._feeds:
            if feed.problem is not None:
                raise feed.problem

    def end_before(self, end_shot: int) -> None:
        """Record no shot from this one on."""
        for recording in self._recordings:
            recording.end_before(end_shot)

    def stop(self, end_shot: int | None) -> None:
        """End all feeds and, before this shot, the recordings."""
        for feed in self._feeds:
            feed.stop()
        for feed in self._feeds:
            feed.join()
        if end_shot:
            for recording in self._recordings:
                recording.finish(end_shot)
