"""A group of live cameras: a feed of each, and the shots they make together."""

import logging
import threading
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from services.mocap.camera.camera import Camera
from services.mocap.camera.undistort import reduce_picture
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

_REOPEN_EVERY_S = 0.25
"""Time between two attempts to reopen a lost source."""

log = logging.getLogger(__name__)


class Feed:
    """Delivers a camera's pictures from its own thread.

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
        self._lost_because, self._has_given = "", False
        self.has_ended = False
        """Whether no picture will ever follow."""
        self.problem: UserError | None = None
        """The user's error that stopped it, if any."""
        self._thread = threading.Thread(target=self._run, name=f"feed-{camera.name}", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        name = self._camera.name
        while not self._stopped.is_set() and not self.has_ended:
            try:
                self._read_all()
            except SourceLostError as problem:
                if str(problem) != self._lost_because:
                    self._lost_because = str(problem)
                    log.warning("%s is lost; trying to reconnect: %s", name, problem)
                self._stopped.wait(_REOPEN_EVERY_S)
            except UserError as problem:
                self.problem, self.has_ended = problem, True
            except Exception as problem:
                log.exception("%s cannot be read", name)
                what = f"{type(problem).__name__}: {problem}"
                self.problem, self.has_ended = UserError(f"{name}: cannot be read ({what})"), True

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
                self._check_size(picture.image)
                if self._lost_because:
                    self._lost_because = ""
                    log.info("%s is back", self._camera.name)
                self._has_given = True
                self._give(picture.image, picture.taken_s)
        finally:
            source.close()

    def _check_size(self, image: Bytes) -> None:
        """Raise UserError for another size than the calibration's at the start; a camera that returns with
        another one is still lost."""
        try:
            check_size_of(self._camera.name, self._camera, *image.shape[:2])
        except UserError as problem:
            if self._has_given:
                raise SourceLostError(str(problem)) from None
            raise

    def stop(self) -> None:
        """Request its end; it stops after the next picture."""
        self._stopped.set()

    def join(self) -> None:
        """Wait briefly for its end: a source that hangs must not delay the others."""
        self._thread.join(2.0)


class Group:
    """The feeds of some cameras, and their shots once the coordinator's clock is known."""

    def __init__(
        self, take: LiveTake, cameras: Sequence[int], clock: CoordinatorClock, record: Path | None
    ) -> None:
        """record: the folder in which to record the pictures as a take."""
        self._take, self._clock, live = take, clock, take.live
        self._begun = threading.Event()
        self._files_begin_s = 0.0
        self.shots = Shots(len(cameras), clock, live.reach_s, live.period_s, live.grace_s)
        self._recordings = [
            CameraRecording(record, take.calibrated[c], live.fps) for c in cameras if record is not None
        ]
        self._feeds = [
            Feed(take.calibrated[c], partial(self._open, k, c), partial(self._give, k, take.cameras[c]))
            for k, c in enumerate(cameras)
        ]

    def _open(self, k: int, c: int, stopped: threading.Event) -> Source | None:
        """A camera's source; files start with shot 0, so that each picture has its number."""
        source = self._take.sources[c]
        if not source.is_file:
            return StreamSource(source, self._take.calibrated[c], self._take.live.fps)
        while not self._begun.wait(0.1):
            if stopped.is_set():
                return None
        passed_over = partial(self.shots.pass_over, k)
        return FileSource(Path(str(source.source)), self._files_begin_s, stopped, passed_over)

    def _give(self, k: int, camera: Camera, image: Bytes, taken_s: float) -> None:
        """Take the k-th camera's picture: it is recorded as it is, and reduced to the camera's size for
        silhouettes."""
        shot = self.shots.put(k, reduce_picture(image, camera), taken_s)
        if shot is not None and self._recordings:
            self._recordings[k].add(shot, image, taken_s - self._files_begin_s)

    def begin(self) -> None:
        """Called when the coordinator's clock is known."""
        if not self._begun.is_set():
            self._files_begin_s = self._clock.here_s(self._clock.due_s(0))
            self._begun.set()

    @property
    def is_recording(self) -> bool:
        """Whether the pictures are recorded."""
        return bool(self._recordings)

    @property
    def has_ended(self) -> bool:
        """Whether no picture will ever follow."""
        return all(feed.has_ended for feed in self._feeds)

    def check(self) -> None:
        """Raise the user error of a feed or a recording, if any."""
        problems = [feed.problem for feed in self._feeds]
        problems += [recording.problem for recording in self._recordings]
        for problem in filter(None, problems):
            raise problem

    def end_before(self, end_shot: int) -> None:
        """Do not record this shot and later ones."""
        for recording in self._recordings:
            recording.end_before(end_shot)

    def stop(self, end_shot: int | None) -> None:
        """End all feeds and, before this shot, the recordings."""
        for feed in self._feeds:
            feed.stop()
        for feed in self._feeds:
            feed.join()
        if end_shot and any(recording.has_begun for recording in self._recordings):
            for recording in self._recordings:
                recording.finish(end_shot)
