"""A journal: records in a file, each there whole or not at all, for whoever has to go on after a death.

A file begins with a line that names the format. Then come records: the payload's length and its CRC-32 (two
little-endian 32-bit numbers), and the payload, a msgpack map of kind, fields and arrays. What follows the
last whole record is torn: the write that a death has cut short.
"""

import fcntl
import os
import struct
import zlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import msgpack
import numpy as np
from numpy.typing import NDArray

from services.mocap.errors import TakeError, UserError
from services.mocap.take.marks import PARTS, Marks
from services.mocap.take.tables import PoseTable

JOURNAL = "poses.journal"
"""Its name in the folder of results that are not complete."""
POSE = "pose"
"""The kind of record that holds a solved frame."""
_HEADER = b"xormocap journal 1\n"
FIRST = len(_HEADER)
"""The offset of the first record."""
_PREFIX = struct.Struct("<II")
_LONGEST_BYTES = 2**27


@dataclass(frozen=True, eq=False)
class Record:
    """One entry."""

    kind: str
    fields: dict[str, Any]
    """Numbers, texts, lists and maps of these."""
    arrays: dict[str, NDArray[Any]] = field(default_factory=dict)

    def packed(self) -> bytes:
        """The payload."""
        arrays = {
            name: [array.dtype.newbyteorder("<").str, array.shape, np.ascontiguousarray(array).tobytes()]
            for name, array in self.arrays.items()
        }
        packed: bytes = msgpack.packb({"kind": self.kind, "fields": self.fields, "arrays": arrays})
        return packed

    @classmethod
    def unpacked(cls, payload: bytes) -> Self:
        """What `packed` made."""
        content = msgpack.unpackb(payload)
        arrays = {
            name: np.frombuffer(data, dtype).reshape(shape)
            for name, (dtype, shape, data) in content["arrays"].items()
        }
        return cls(content["kind"], content["fields"], arrays)


class Journal:
    """A journal that is written to, by one process at a time; it may be read meanwhile."""

    def __init__(self, path: Path) -> None:
        """Open a journal, or begin one; what is torn is cut off.

        Raises UserError where another process writes it or it cannot be written, TakeError where it is none.
        """
        self.path = path
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as problem:
            raise UserError(
                f"{path}: cannot be written ({problem.strerror}): choose another folder"
            ) from None
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(self._file)
            raise UserError(f"{path}: another recorder writes it: choose another folder for --out") from None
        self.torn_bytes = 0
        """How much was cut off."""
        self._offsets, self._end = self._take_stock()
        self._is_synced = True

    def _take_stock(self) -> tuple[list[int], int]:
        """Where the records are that are whole, and where they end."""
        size = os.fstat(self._file).st_size
        offsets = [offset for offset, _ in payloads(self._file, self.path)]
        end = _end_of(self._file, offsets)
        self.torn_bytes = size - end if size > len(_HEADER) else 0
        if size < len(_HEADER):
            os.pwrite(self._file, _HEADER, 0)
        os.ftruncate(self._file, end)
        os.fsync(self._file)
        return offsets, end

    def records(self) -> Iterator[tuple[int, Record]]:
        """All records that are there, each with its offset."""
        for offset in self._offsets:
            yield offset, self.at(offset)

    def at(self, offset: int) -> Record:
        """The record at an offset that `append` or `records` has told."""
        payload = payload_at(self._file, offset)
        if payload is None:
            raise OSError(f"{self.path}: changed under the hands of its writer")
        return Record.unpacked(payload)

    def append(self, record: Record) -> int:
        """Write a record behind all others; returns its offset. On disk for certain only after `sync`."""
        payload, offset = record.packed(), self._end
        content = _PREFIX.pack(len(payload), zlib.crc32(payload)) + payload
        try:
            written = os.pwrite(self._file, content, offset)
            if written < len(content):
                raise OSError(0, "the disk is full")
        except OSError as problem:
            raise UserError(f"{self.path}: cannot be written ({problem.strerror}): make room there") from None
        self._offsets.append(offset)
        self._end, self._is_synced = offset + len(content), False
        return offset

    def sync(self) -> None:
        """Return when all that was written would outlast a loss of power."""
        if not self._is_synced:
            os.fsync(self._file)
            self._is_synced = True

    def clear(self) -> None:
        """Begin anew, without a record."""
        self._offsets, self._end = [], len(_HEADER)
        os.ftruncate(self._file, self._end)
        os.fsync(self._file)

    def close(self, *, remove: bool = False) -> None:
        """Close the file, or remove it, as one without a record always is; with its folder, if empty."""
        if remove or not self._offsets:
            self.path.unlink(missing_ok=True)
            with suppress(OSError):
                self.path.parent.rmdir()
        os.close(self._file)


def read_records(path: Path) -> Iterator[Record]:
    """The records of a journal that may still be written to, up to the first that is not whole.

    Raises TakeError where there is none.
    """
    try:
        file = os.open(path, os.O_RDONLY)
    except OSError as problem:
        raise TakeError(f"{path}: cannot be read ({problem.strerror}): expected a journal") from None
    try:
        for _, payload in payloads(file, path):
            yield Record.unpacked(payload)
    finally:
        os.close(file)


def read_poses(path: Path) -> PoseTable:
    """The frames that a journal holds, in their order; raises TakeError where it has none."""
    by_frame = {record.fields["frame"]: record for record in read_records(path) if record.kind == POSE}
    if not by_frame:
        raise TakeError(f"{path}: holds no frame yet")
    records = [by_frame[frame] for frame in sorted(by_frame)]
    confidence = [[record.fields["confidence"].get(part, np.nan) for part in PARTS] for record in records]
    distrusted = [[part in record.fields["distrusted"] for part in PARTS] for record in records]
    return PoseTable(
        frames=np.array(sorted(by_frame), np.int32),
        times_s=np.array([record.fields["time_s"] for record in records]),
        poses=np.array([record.arrays["pose"] for record in records]),
        energies_px=np.array([record.fields["energy_px"] for record in records]),
        marks=Marks(np.array(confidence, np.float64), np.array(distrusted, bool)),
        extra={"prior": np.array([record.fields["prior"] for record in records])},
    )


def payloads(file: int, path: Path, offset: int = FIRST) -> Iterator[tuple[int, bytes]]:
    """Offsets and payloads of the whole records of an open file, from an offset on.

    Raises TakeError where the file is no journal.
    """
    head = os.pread(file, len(_HEADER), 0)
    if not _HEADER.startswith(head):
        raise TakeError(f"{path}: is not a journal of this version: remove it")
    while (payload := payload_at(file, offset)) is not None:
        yield offset, payload
        offset = behind(offset, payload)


def behind(offset: int, payload: bytes) -> int:
    """Where the record ends that has a payload and begins at an offset."""
    return offset + _PREFIX.size + len(payload)


def payload_at(file: int, offset: int) -> bytes | None:
    """The payload of the record at an offset; None where none is whole."""
    prefix = os.pread(file, _PREFIX.size, offset)
    if len(prefix) < _PREFIX.size:
        return None
    length, crc = _PREFIX.unpack(prefix)
    if length > _LONGEST_BYTES:
        return None
    payload = os.pread(file, length, offset + _PREFIX.size)
    return payload if len(payload) == length and zlib.crc32(payload) == crc else None


def _end_of(file: int, offsets: list[int]) -> int:
    """Where the last of the records ends."""
    if not offsets:
        return len(_HEADER)
    length, _ = _PREFIX.unpack(os.pread(file, _PREFIX.size, offsets[-1]))
    return int(offsets[-1] + _PREFIX.size + length)
