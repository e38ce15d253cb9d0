"""Keeps the silhouettes of all frames of a take, compressed, in a temporary file."""

import tempfile
import zlib
from contextlib import suppress

import numpy as np

from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.errors import UserError

_FAST = 1
"""zlib's level: silhouettes shrink to a fiftieth with any."""


class SilhouetteSpool:
    """Silhouettes by frame; frames are added in order and read in any order."""

    def __init__(self) -> None:
        self._file = tempfile.TemporaryFile(prefix="xormocap-silhouettes-")  # noqa: SIM115  (closed by close)
        self._ends = [0]
        self._shape: tuple[int, ...] = ()

    def append(self, seen: TriPlanes) -> TriPlanes:
        """Add the next frame's silhouettes (P, H, W), and return them; raises UserError where there is no
        room."""
        planes = np.stack([seen.silhouettes, seen.unsure, *([] if seen.classes is None else seen.classes)])
        self._shape = planes.shape
        try:
            self._file.seek(self._ends[-1])
            self._ends.append(self._ends[-1] + self._file.write(zlib.compress(planes.tobytes(), _FAST)))
            self._file.flush()
        except OSError as error:
            raise UserError(
                f"{tempfile.gettempdir()}: silhouettes cannot be kept there ({error.strerror}): make room, "
                "or set TMPDIR to another folder"
            ) from error
        return seen

    def __len__(self) -> int:
        return len(self._ends) - 1

    def __getitem__(self, frame: int) -> TriPlanes:
        """The silhouettes (P, H, W) of a frame, from 0."""
        self._file.seek(self._ends[frame])
        content = zlib.decompress(self._file.read(self._ends[frame + 1] - self._ends[frame]))
        silhouettes, unsure, *classes = np.frombuffer(content, np.uint8).reshape(-1, *self._shape[1:]).copy()
        return TriPlanes(silhouettes, unsure, np.array(classes) if classes else None)

    def close(self) -> None:
        """Delete everything."""
        with suppress(OSError):  # what did not fit is written once more
            self._file.close()
