"""Records live pictures as videos of a take, in which frame n is shot n of every camera."""

import logging
import queue
import threading
from pathlib import Path

import numpy as np

from services.mocap.camera.camera import Camera
from services.mocap.errors import UserError
from services.mocap.take.csv_columns import write_columns
from services.mocap.take.layout import video_path
from services.mocap.take.writer import VideoWriter, video_writer
from services.mocap.types import Bytes

_WAITING = 120
"""Most pictures that wait to be written, some seconds; more are dropped."""
_CRF = 16
"""Video quality, high enough to be tracked as well as the live pictures."""
_LATE_S = 2.0
"""A first picture later than this is told."""

log = logging.getLogger(__name__)


def stamps_path(folder: Path, camera: str) -> Path:
    """The file with the times of a camera's pictures: empty for a shot that repeats the previous one."""
    return folder / "stamps" / f"{camera}.csv"


class CameraRecording:
    """Writes one camera's pictures in its own thread; a missing shot repeats the previous picture."""

    def __init__(self, folder: Path, camera: Camera, fps: float) -> None:
        self._folder, self._camera, self._fps = folder, camera, fps
        self._waiting: queue.Queue[tuple[int, Bytes | None, float]] = queue.Queue(_WAITING)
        self._times_s: list[float | None] = []
        self.has_begun = False
        """Whether there was a picture."""
        self._last: Bytes = np.zeros((*camera.shape_px, 3), np.uint8)
        self._end_shot: int | None = None
        self.lost = 0
        """Number of pictures that could not be written in time."""
        self.problem: UserError | None = None
        """Why nothing more is recorded."""
        self._has_end = False
        self._thread = threading.Thread(target=self._run, name=f"recording-{camera.name}", daemon=True)
        self._thread.start()

    def add(self, shot: int, image: Bytes, time_s: float) -> None:
        """Add the picture of a shot later than all before; time_s since shot 0."""
        if self._end_shot is not None and shot >= self._end_shot:
            return
        try:
            self._waiting.put_nowait((shot, image, time_s))
            self.has_begun = True
        except queue.Full:
            self.lost += 1

    def end_before(self, end_shot: int) -> None:
        """Ignore this shot and later ones."""
        self._end_shot = end_shot

    def finish(self, end_shot: int) -> None:
        """Finish: no more pictures follow; the video is filled up to this shot."""
        self._waiting.put((end_shot, None, 0.0))
        self._thread.join()
        if self.lost:
            log.warning("%s: %d pictures could not be written in time", self._camera.name, self.lost)

    def _run(self) -> None:
        try:
            self._write_all()
        except UserError as error:
            self._give_up(error)
        except Exception as error:  # whatever it is, nobody may wait for room in the queue
            log.exception("%s cannot be recorded", self._camera.name)
            what = f"{type(error).__name__}: {error}"
            self._give_up(UserError(f"{self._folder}: cannot record there: {what}"))

    def _give_up(self, problem: UserError) -> None:
        """Note why, and drop what comes until the end, so that nobody waits for room in the queue."""
        self.problem = problem
        while not self._has_end:
            self._next()

    def _next(self) -> tuple[int, Bytes | None, float]:
        came = self._waiting.get()
        self._has_end = came[1] is None
        return came

    def _write_all(self) -> None:
        path = video_path(self._folder, self._camera.name)
        path.parent.mkdir(parents=True, exist_ok=True)
        came = self._next()  # first: a run that fails before its first picture leaves no file
        size_px = self._camera.size_px
        # A quarter of the encoder's usual time, for a larger file.
        with video_writer(path, *size_px, self._fps, _CRF, {"preset": "superfast", "threads": "1"}) as writer:
            while True:
                shot, image, time_s = came
                if image is not None and not self._times_s:
                    self._last = image  # shots before the first picture repeat it
                    if shot > _LATE_S * self._fps:
                        said = "%s: its first picture came after %.0f s; until then its recording repeats it"
                        log.warning(said, self._camera.name, shot / self._fps)
                while len(self._times_s) < shot:
                    self._write(writer, self._last, None)
                if image is None:
                    break
                self._write(writer, image, time_s)
                came = self._next()
        path = stamps_path(self._folder, self._camera.name)
        path.parent.mkdir(parents=True, exist_ok=True)
        times = ["" if time_s is None else f"{time_s:.6f}" for time_s in self._times_s]
        write_columns(path, {"frame": [str(n) for n in range(len(times))], "time_s": times})

    def _write(self, writer: VideoWriter, image: Bytes, time_s: float | None) -> None:
        writer.write(image)
        self._times_s.append(time_s)
        self._last = image
