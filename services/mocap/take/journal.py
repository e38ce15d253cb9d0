"""A journal: records in a file, each written completely or not at all, from which a run can continue after a
crash.

A file begins with a line that names the format. Then come records: the payload's length and its CRC-32 (two
little-endian 32-bit numbers), and the payload, a msgpack array of byte strings: the frames of a message.
Bytes after the last complete record are a torn write, interrupted by a crash.

SQLite does not serve here: its WAL mode needs memory that writer and readers share, which network file
systems do not give, and results may be on one. A journal needs only appends and reads.
"""

import fcntl
import os
import struct
import zlib
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

import msgpack

from services.mocap.atomic import disk_errors_of
from services.mocap.errors import TakeError, UserError

JOURNAL = "poses.journal"
"""Its file name in the folder of incomplete results."""
_HEADER = b"xormocap journal 1\n"
FIRST = len(_HEADER)
"""The offset of the first record."""
_PREFIX = struct.Struct("<II")
_LONGEST_BYTES = 2**27


class Journal:
    """A journal that is written to, by one process at a time; it may be read meanwhile."""

    def __init__(self, path: Path) -> None:
        """Open a journal, or create one; a torn record is cut off.

        Raises UserError if another process writes it or it cannot be written, TakeError if it is not a
        journal.
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
            _lock(self._file, fcntl.LOCK_EX, path)
            size, self._end = os.fstat(self._file).st_size, FIRST
            for _, _, end in records(self._file, path):
                self._end = end
            if size < FIRST:
                os.pwrite(self._file, _HEADER, 0)
            os.ftruncate(self._file, self._end)
            os.fsync(self._file)
        except UserError:
            os.close(self._file)
            raise
        except OSError as problem:
            os.close(self._file)
            raise UserError(f"{path}: cannot be written ({problem.strerror}): free some disk space") from None
        self.torn_bytes = max(size - self._end, 0)
        """How much was cut off."""
        self._is_synced = True

    def records(self) -> Iterator[tuple[int, list[bytes]]]:
        """All records that are there, each with its offset."""
        for offset, frames, _ in records(self._file, self.path):
            yield offset, frames

    def at(self, offset: int) -> list[bytes]:
        """The record at an offset from `append` or `records`."""
        found = record_at(self._file, offset)
        if found is None:
            raise OSError(f"{self.path}: changed by another process")
        return found[0]

    def append(self, frames: Sequence[bytes | memoryview]) -> int:
        """Append a record; returns its offset. It is safely on disk only after `sync`."""
        payload, offset = msgpack.packb(frames), self._end
        content = _PREFIX.pack(len(payload), zlib.crc32(payload)) + payload
        try:
            written = os.pwrite(self._file, content, offset)
            if written < len(content):
                raise OSError(0, "the disk is full")
        except OSError as problem:
            raise UserError(
                f"{self.path}: cannot be written ({problem.strerror}): free some disk space"
            ) from None
        self._end, self._is_synced = offset + len(content), False
        return offset

    def sync(self) -> None:
        """Return when everything written would survive a loss of power."""
        if not self._is_synced:
            with disk_errors_of(self.path):
                os.fsync(self._file)
            self._is_synced = True

    def clear(self) -> None:
        """Remove all records."""
        self._end = FIRST
        with disk_errors_of(self.path):
            os.ftruncate(self._file, self._end)
            os.fsync(self._file)

    def close(self, *, remove: bool = False) -> None:
        """Close the file, or remove it (always if it has no record), with its folder if that is empty."""
        if remove or self._end == FIRST:
            self.path.unlink(missing_ok=True)
            with suppress(OSError):
                self.path.parent.rmdir()
        os.close(self._file)


def check_unused(path: Path) -> None:
    """Raise UserError if a process writes this journal, which need not exist, or if it cannot be read."""
    try:
        with path.open("rb") as file:
            _lock(file.fileno(), fcntl.LOCK_SH, path)
    except FileNotFoundError:
        return
    except OSError as problem:
        raise UserError(f"{path}: cannot be read ({problem.strerror}): choose another folder") from None


def _lock(file: int, kind: int, path: Path) -> None:
    """Lock an open file at once; kind: fcntl.LOCK_EX, which needs a file open for writing, or LOCK_SH."""
    try:
        fcntl.flock(file, kind | fcntl.LOCK_NB)
    except BlockingIOError:
        raise UserError(f"{path}: another recorder is writing it: choose another folder for --out") from None
    except OSError as problem:
        raise UserError(f"{path}: cannot be locked ({problem.strerror}): choose another folder") from None


def records(file: int, path: Path, offset: int = FIRST) -> Iterator[tuple[int, list[bytes], int]]:
    """The whole records of an open file from an offset on: where each begins, the record, where it ends.

    Raises TakeError where the file is no journal.
    """
    head = os.pread(file, len(_HEADER), 0)
    if not _HEADER.startswith(head):
        raise TakeError(f"{path}: is not a journal of this version: remove it")
    while (found := record_at(file, offset)) is not None:
        frames, end = found
        yield offset, frames, end
        offset = end


def record_at(file: int, offset: int) -> tuple[list[bytes], int] | None:
    """The record at an offset, and where it ends; None where none is whole.

    A record of an earlier version, which was no array, has no frames.
    """
    prefix = os.pread(file, _PREFIX.size, offset)
    if len(prefix) < _PREFIX.size:
        return None
    length, crc = _PREFIX.unpack(prefix)
    if length > _LONGEST_BYTES:
        return None
    payload = os.pread(file, length, offset + _PREFIX.size)
    if len(payload) != length or zlib.crc32(payload) != crc:
        return None
    frames = msgpack.unpackb(payload)
    return frames if isinstance(frames, list) else [], offset + _PREFIX.size + length
