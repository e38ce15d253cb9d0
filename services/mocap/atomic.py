"""Files and folders that appear completely or not at all: written under a temporary name, then renamed."""

import errno
import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from services.mocap.errors import UserError

_OF_WRITING = {errno.ENOSPC, errno.EDQUOT, errno.EROFS}


def _sibling(target: Path) -> Path:
    """A free name beside the target, hidden, with the same suffix (encoders choose the format by it)."""
    target = target.absolute()  # "." has no name
    return target.with_name(f".{target.stem}.{secrets.token_hex(4)}.part{target.suffix}")


def make_folder(folder: Path) -> None:
    """Create a folder if it is missing; raises UserError if it cannot be created or written to."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise UserError(
            f"{folder}: cannot be created ({problem.strerror}): choose a writable folder"
        ) from None
    if not os.access(folder, os.W_OK | os.X_OK):
        raise UserError(f"{folder}: cannot be written to: choose a writable folder")


@contextmanager
def disk_errors_of(target: Path) -> Iterator[None]:
    """Turn errors of a disk that is full, or fails, into UserError; target: what is written.

    A disk that fails need not be the target's: reading something else in the block raises the same error.
    """
    try:
        yield
    except OSError as problem:
        # An error of copying several files has no number, but a list of what was said of each.
        copies = problem.args[0] if isinstance(problem, shutil.Error) else None
        remedy = "free some disk space, or choose another folder"
        if isinstance(copies, list):
            what, reason = f"{copies[0][0]}: cannot be copied to {target}", copies[0][2]
        elif problem.errno == errno.EIO:
            what, reason = f"{target}: cannot be completed, as a disk that is read or written fails", problem
            remedy = "check the disks, or choose another folder"
        elif problem.errno in _OF_WRITING:
            what, reason = f"{target}: cannot be written", problem.strerror
        else:
            raise
        raise UserError(f"{what} ({reason}): {remedy}") from None


@contextmanager
def atomic_file(target: Path) -> Iterator[Path]:
    """Write to the path it yields; `target` is replaced by that file when the block ends well.

    After an exception nothing is left, and an older `target` is unchanged. The folder is created if missing.
    """
    make_folder(target.parent)
    part = _sibling(target)
    try:
        with disk_errors_of(target):
            yield part
            part.replace(target)
    finally:
        part.unlink(missing_ok=True)


def write_file(target: Path, content: str | bytes) -> None:
    """Write a text, in UTF-8, or bytes as atomic_file does."""
    with atomic_file(target) as part:
        part.write_bytes(content.encode() if isinstance(content, str) else content)


@contextmanager
def atomic_folder(target: Path) -> Iterator[Path]:
    """Fill the empty folder it yields; it becomes `target` when the block ends well.

    After an exception nothing is left. Raises UserError if `target` exists and is not an empty folder: a
    user's folder is never replaced.
    """
    if target.exists() and not (target.is_dir() and not any(target.iterdir())):
        raise UserError(f"{target}: already exists: remove it or choose another name")
    make_folder(target.parent)
    part = _sibling(target)
    try:
        with disk_errors_of(target):
            part.mkdir()
            yield part
            part.replace(target)  # an empty folder may be replaced, a filled one raises
    finally:
        shutil.rmtree(part, ignore_errors=True)
