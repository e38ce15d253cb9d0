"""What a recorder has taken in, on disk: a journal of messages, from which another one goes on."""

import logging
from pathlib import Path
from typing import Self, TypeVar

import numpy as np
from pydantic import ValidationError

from proto.messages import Blob, Message, Pose, TakeInfo, arrays_of
from services.mocap.take.journal import JOURNAL, Journal, Record

log = logging.getLogger(__name__)

M = TypeVar("M", bound=Message)


class Store:
    """Keeps a take's description, its content and its poses; these on disk only, since they are many."""

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self._poses: dict[int, int] = {}
        self._described: list[TakeInfo | Blob] = []
        try:
            self._read()
        except (KeyError, TypeError, ValidationError):
            log.warning("%s: was written by another version: its frames are dropped", journal.path)
            self.forget()
        if journal.torn_bytes:
            log.warning("%s: cut off %d bytes of a torn record", journal.path, journal.torn_bytes)

    @classmethod
    def in_folder(cls, folder: Path) -> Self:
        """What the journal in a folder holds, or a new one; raises UserError or TakeError."""
        return cls(Journal(folder / JOURNAL))

    def _read(self) -> None:
        """Take in what another recorder has left."""
        for offset, record in self._journal.records():
            if record.kind == Pose.type:
                self._poses[_message(Pose, record).frame] = offset
            elif record.kind == TakeInfo.type:
                self._described.append(_message(TakeInfo, record))
            else:
                self._described.append(_message(Blob, record))

    @property
    def described(self) -> list[TakeInfo | Blob]:
        """The take's description and content, in the order in which they came."""
        return self._described

    @property
    def frames(self) -> list[int]:
        """The frames whose poses are here, in the order in which they came."""
        return list(self._poses)

    @property
    def last_frame(self) -> int:
        """The latest frame whose pose is here; 0 where there is none."""
        return max(self._poses, default=0)

    def __contains__(self, frame: int) -> bool:
        return frame in self._poses

    def pose(self, frame: int) -> Pose:
        """The pose of a frame that is here."""
        return _message(Pose, self._journal.at(self._poses[frame]))

    def keep(self, message: TakeInfo | Blob | Pose) -> None:
        """Take in a message; on disk for certain after `sync`."""
        offset = self._journal.append(_record(message))
        if isinstance(message, Pose):
            self._poses[message.frame] = offset
        else:
            self._described.append(message)

    def sync(self) -> None:
        """Return when all that is kept would outlast a loss of power."""
        self._journal.sync()

    def forget(self) -> None:
        """Throw away everything."""
        self._journal.clear()
        self._poses, self._described = {}, []

    def close(self, *, remove: bool) -> None:
        """Let go of the journal, or remove it because the results are complete."""
        self._journal.close(remove=remove)


def _record(message: Message) -> Record:
    arrays = arrays_of(type(message))
    fields = message.model_dump(exclude=set(arrays))
    return Record(message.type, fields, {name: getattr(message, name) for name in arrays})


def _message(kind: type[M], record: Record) -> M:
    arrays = {name: np.array(array) for name, array in record.arrays.items()}
    return kind.model_validate(record.fields | arrays)
