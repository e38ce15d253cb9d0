"""What was learnt of a recorded take, in a folder for the next steps of a command."""

import os
import pickle  # noqa: TID251  (of a folder that only this user can write)
import shutil
import zlib
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from services.mocap.atomic import write_file
from services.mocap.camera.camera import Camera
from services.mocap.errors import UserError
from services.segmentation.joint import JointMatte
from services.segmentation.mattes import GroupMatte

_MOST_OF_DISK = 0.25
"""Share of the free space that it may take: eight cameras need up to 100 MB in 320x240, 340 MB in 640x480."""


def learnt_once(folder: Path, cameras: Sequence[Camera], learn: Callable[[], GroupMatte]) -> GroupMatte:
    """The matte of some cameras in a folder, which is always of one take and segmenter; without one it is
    learnt, and a JointMatte is put there if there is room.

    A folder that others can write into is not used: a pickle can run anything.
    """
    names = "\n".join(camera.name for camera in cameras)
    path = folder / f"learnt-{zlib.crc32(names.encode()):08x}.pickle"
    if path.exists() and _is_private(folder):
        matte: GroupMatte = pickle.loads(path.read_bytes())  # noqa: S301
        return matte
    matte = learn()
    if isinstance(matte, JointMatte) and _is_private(folder):
        with suppress(OSError, UserError):  # then it is learnt again
            content = pickle.dumps(matte)
            if len(content) < _MOST_OF_DISK * shutil.disk_usage(folder).free:
                write_file(path, content)
    return matte


def _is_private(folder: Path) -> bool:
    """Whether a folder is there and this user's alone."""
    try:
        found = folder.stat()
    except OSError:
        return False
    return found.st_uid == os.getuid() and not found.st_mode & 0o022
