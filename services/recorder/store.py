"""A recorder's messages on disk: a journal from which another recorder can continue."""

import logging
from pathlib import Path
from typing import cast

from proto.framing import MalformedMessage, decode, encode
from proto.messages import Blob, Message, Pose, TakeInfo
from services.mocap.take.journal import JOURNAL, Journal

log = logging.getLogger(__name__)


class Store:
    """Stores a take's description, its content and its poses; the many poses only on disk."""

    def __init__(self, folder: Path) -> None:
        """Take in what the journal in a folder holds, or begin one; raises UserError or TakeError."""
        self._journal = journal = Journal(folder / JOURNAL)
        self._poses: dict[int, int] = {}
        self._settled: dict[int, int] = {}
        self.described: list[TakeInfo | Blob] = []
        """The take's description and content, in order of arrival."""
        try:
            for offset, frames in journal.records():
                self._note(decode(frames), offset)
        except MalformedMessage:
            log.warning("%s: was written by another version: its frames are dropped", journal.path)
            self.forget()
        if journal.torn_bytes:
            log.warning("%s: cut off %d bytes of a torn record", journal.path, journal.torn_bytes)

    def _note(self, message: Message, offset: int) -> None:
        if isinstance(message, Pose):
            (self._settled if message.settled else self._poses)[message.frame] = offset
        elif isinstance(message, TakeInfo | Blob):
            self.described.append(message)

    @property
    def frames(self) -> list[int]:
        """The frames with a pose, in order of arrival."""
        return list(self._poses)

    @property
    def last_frame(self) -> int:
        """The latest frame with a pose; 0 if there is none."""
        return max(self._poses, default=0)

    def __contains__(self, frame: int) -> bool:
        return frame in self._poses

    def holds(self, pose: Pose) -> bool:
        """Whether a pose of the same frame and kind is here."""
        return pose.frame in (self._settled if pose.settled else self._poses)

    def has_settled(self, frame: int) -> bool:
        """Whether the settled pose of a frame is here."""
        return frame in self._settled

    def pose(self, frame: int) -> Pose:
        """The first pose of a frame that is here."""
        return cast(Pose, decode(self._journal.at(self._poses[frame])))

    def settled(self, frame: int) -> Pose:
        """The settled pose of a frame that has one here."""
        return cast(Pose, decode(self._journal.at(self._settled[frame])))

    def keep(self, message: TakeInfo | Blob | Pose) -> None:
        """Store a message; it is safely on disk after `sync`."""
        self._note(message, self._journal.append(encode(message)))

    def sync(self) -> None:
        """Return when everything stored would survive a loss of power."""
        self._journal.sync()

    def forget(self) -> None:
        """Delete everything."""
        self._journal.clear()
        self._poses, self._settled, self.described = {}, {}, []

    def close(self, *, remove: bool) -> None:
        """Close the journal, or remove it because the results are complete."""
        self._journal.close(remove=remove)
