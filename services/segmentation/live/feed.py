"""A camera's feed: a thread that reads its source, and opens it again for as long as it is gone."""

import logging
import threading
from collections.abc import Callable

from services.mocap.camera.camera import Camera
from services.mocap.errors import UserError
from services.mocap.types import Bytes
from services.segmentation.live.sources import Source, SourceLostError, check_size_of

_AGAIN_S = 0.25
"""Between two tries to open a source that is gone."""

log = logging.getLogger(__name__)


class Feed:
    """Gives a camera's pictures to whoever wants them, from a thread of its own.

    begin: waits until the source may be opened, and opens it; raises SourceLostError. give: called in the
    feed's thread with each picture (H, W, 3) and the moment it was taken, by this machine's monotonic clock.
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
        while not self._stopped.is_set() and not self.has_ended:
            try:
                self._read_all()
            except SourceLostError as problem:
                self._note_loss(str(problem))
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
                self._note_return()
                self._give(picture.image, picture.taken_s)
        finally:
            source.close()

    def _note_loss(self, why: str) -> None:
        if not self._is_lost:
            self._is_lost = True
            log.warning("%s is gone, and looked for until it is back: %s", self._camera.name, why)

    def _note_return(self) -> None:
        if self._is_lost:
            self._is_lost = False
            log.info("%s is back", self._camera.name)

    def stop(self) -> None:
        """Ask it to end; it does so after the picture that it is waiting for."""
        self._stopped.set()

    def join(self) -> None:
        """Wait for its end, a moment: a source that hangs does not hold up the others."""
        self._thread.join(2.0)
