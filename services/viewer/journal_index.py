"""Reads poses of a journal that another process is still writing, in any order."""

import os
import threading
from pathlib import Path

import msgpack

from proto.messages import Pose
from services.mocap.take.journal import FIRST, record_at, records

_HEAD_BYTES = 8
"""The first record's length and check sum, by which one journal is told from the next in its place."""


class JournalIndex:
    """Finds the poses of one run; remembers where they are, reads them when asked. For any thread."""

    def __init__(self, path: Path, run: str, frames: range) -> None:
        """path: need not exist yet. frames: the range of possible frames."""
        self.path, self._run, self._frames = path, run, frames
        self._lock = threading.Lock()
        self._offsets: dict[int, int] = {}
        self._end = FIRST
        self._begun: tuple[int, int, bytes] | None = None

    def pose(self, frame: int) -> list[bytes] | None:
        """The record of a frame; None while the journal has none.

        Raises OSError if it cannot be read or does not exist, TakeError if it is not a journal.
        """
        if frame not in self._frames:
            return None
        with self._lock:
            file = os.open(self.path, os.O_RDONLY)
            try:
                return self._found(file, frame)
            finally:
                os.close(file)

    def _found(self, file: int, frame: int) -> list[bytes] | None:
        status = os.fstat(file)
        begun = status.st_dev, status.st_ino, os.pread(file, _HEAD_BYTES, FIRST)
        if begun != self._begun:  # the file was replaced or started again
            self._begun, self._offsets, self._end = begun, {}, FIRST
        if frame not in self._offsets:
            for offset, frames, end in records(file, self.path, self._end):
                self._end = end
                header = msgpack.unpackb(frames[0]) if frames else {}
                is_ours = header.get("type") == Pose.type and header["run"] == self._run
                if is_ours and header["frame"] in self._frames:
                    self._offsets[header["frame"]] = offset
        found = record_at(file, self._offsets[frame]) if frame in self._offsets else None
        return None if found is None else found[0]
