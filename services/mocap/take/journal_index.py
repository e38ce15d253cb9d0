"""Poses of a journal that another process still writes to, in any order."""

import os
import threading
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from services.mocap.take.journal import FIRST, POSE, Record, behind, payload_at, payloads

_NOWHERE = -1
_HEAD_BYTES = 8
"""The first record's length and check sum, by which one journal is told from the next in its place."""


class JournalIndex:
    """Finds the poses of one run; remembers 8 bytes a frame, reads the rest when asked. For any thread."""

    def __init__(self, path: Path, run: str, frames: range) -> None:
        """path: need not be there yet. frames: those that may be asked for."""
        self.path, self._run, self._frames = path, run, frames
        self._lock = threading.Lock()
        self._forget()

    def _forget(self) -> None:
        self._offsets: NDArray[np.int64] | None = None
        self._end = FIRST
        self._begun: tuple[int, int, bytes] | None = None

    def pose(self, frame: int) -> Record | None:
        """The record of a frame; None as long as the journal has none.

        Raises OSError where it cannot be read or is not there, TakeError where it is no journal.
        """
        if frame not in self._frames:
            return None
        with self._lock:
            file = os.open(self.path, os.O_RDONLY)
            try:
                return self._found(file, frame)
            finally:
                os.close(file)

    def _found(self, file: int, frame: int) -> Record | None:
        status = os.fstat(file)
        begun = status.st_dev, status.st_ino, os.pread(file, _HEAD_BYTES, FIRST)
        if begun != self._begun or self._offsets is None:
            self._forget()  # it is another file by now, or was begun anew
            self._begun, self._offsets = begun, np.full(len(self._frames), _NOWHERE, np.int64)
        row = self._frames.index(frame)
        if self._offsets[row] == _NOWHERE:
            self._read_on(file, self._offsets)
        payload = None if self._offsets[row] == _NOWHERE else payload_at(file, int(self._offsets[row]))
        return None if payload is None else Record.unpacked(payload)

    def _read_on(self, file: int, offsets: NDArray[np.int64]) -> None:
        """Take stock of what was written since."""
        for offset, payload in payloads(file, self.path, self._end):
            record = Record.unpacked(payload)
            is_ours = record.kind == POSE and record.fields.get("run") == self._run
            if is_ours and record.fields["frame"] in self._frames:
                offsets[self._frames.index(record.fields["frame"])] = offset
            self._end = behind(offset, payload)
