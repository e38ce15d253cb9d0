"""A recorder's messages on disk: a journal from which another recorder can continue."""

import logging
from pathlib import Path
from typing import cast

from proto.framing import MalformedMessage, decode, encode
from proto.messages import Blob, Message, Pose, TakeInfo
from services.mocap.take.journal import JOURNAL, Journal

log = logging.getLogger(__name__)


class StoredPoses:
    """Poses by frame; only their places in the journal are held in memory."""

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self._offsets: dict[int, int] = {}
        self._end: int | None = None

    def __contains__(self, frame: int) -> bool:
        return frame in self._offsets

    def __getitem__(self, frame: int) -> Pose:
        return cast(Pose, decode(self._journal.at(self._offsets[frame])))

    def note(self, frame: int, offset: int) -> None:
        """Add a frame whose pose is in the journal at this offset."""
        self._offsets[frame] = offset

    def drop_from(self, frame: int) -> None:
        """Drop this frame's pose and those of later ones; they stay in the journal."""
        self._offsets = {number: offset for number, offset in self._offsets.items() if number < frame}
        self._end = None if self._end is None else min(self._end, frame)

    @property
    def frames(self) -> list[int]:
        """The frames with a pose, in order of arrival."""
        return list(self._offsets)

    def begin(self, first_frame: int) -> None:
        """The take's first frame is known."""
        self._end = first_frame

    @property
    def end(self) -> int:
        """One past the last frame up to which all are here; 0 while the first frame is not known."""
        while self._end is not None and self._end in self._offsets:
            self._end += 1
        return self._end or 0

    def gap_before(self, end: int) -> tuple[int, int] | None:
        """The first range of frames before `end` that are missing."""
        first = self.end
        return (first, next((f for f in range(first, end) if f in self), end)) if first < end else None


class Store:
    """Stores a take's description, its content and its poses; the many poses only on disk."""

    def __init__(self, folder: Path) -> None:
        """Take in what the journal in a folder holds, or begin one; raises UserError or TakeError."""
        self._journal = journal = Journal(folder / JOURNAL)
        self._empty()
        try:
            for offset, frames in journal.records():
                self._note(decode(frames), offset)
        except MalformedMessage:
            log.warning("%s: was written by another version: its frames are dropped", journal.path)
            self.forget()
        if journal.torn_bytes:
            log.warning("%s: cut off %d bytes of a torn record", journal.path, journal.torn_bytes)

    def _empty(self) -> None:
        self.first, self.settled = StoredPoses(self._journal), StoredPoses(self._journal)
        """Poses as first tracked, and those solved again with the frames after them."""
        self.described: list[TakeInfo | Blob] = []
        """The take's description and content, in order of arrival."""

    def _note(self, message: Message, offset: int) -> None:
        if isinstance(message, Pose):
            (self.settled if message.settled else self.first).note(message.frame, offset)
        elif isinstance(message, TakeInfo | Blob):
            self.described.append(message)
            if isinstance(message, TakeInfo) and message.is_live and message.continued_at:
                for poses in (self.first, self.settled):
                    poses.drop_from(message.continued_at)

    def keep(self, message: TakeInfo | Blob | Pose) -> None:
        """Store a message; it is safely on disk after `sync`.

        The description of a live take that is continued drops the poses from there on: those are of other
        moments.
        """
        self._note(message, self._journal.append(encode(message)))

    def sync(self) -> None:
        """Return when everything stored would survive a loss of power."""
        self._journal.sync()

    def forget(self) -> None:
        """Delete everything."""
        self._journal.clear()
        self._empty()

    def close(self, *, remove: bool) -> None:
        """Close the journal, or remove it because the results are complete."""
        self._journal.close(remove=remove)
