"""Raw trimaps of a recorded take in a folder, for the steps of a command that need them again."""

import logging
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from services.mocap.atomic import write_file
from services.mocap.camera.camera import Camera
from services.mocap.errors import UserError
from services.mocap.types import Trimap

log = logging.getLogger(__name__)

_FAST = 1
"""zlib's level; a PNG takes ten times as long to read."""
_SUFFIX = ".trimaps"


class KeptTrimaps:
    """The trimaps of some cameras, with lens distortion, one file a frame.

    Processes may share the folder for the same take, segmenter and cameras.
    """

    def __init__(self, folder: Path, cameras: Sequence[Camera]) -> None:
        """cameras: always the same ones, in this order."""
        self._folder, self._has_room = folder, True
        self._shapes_px = [camera.shape_px for camera in cameras]

    def keep(self, frame: int, trimaps: Sequence[Trimap]) -> None:
        """Write the trimaps (h, w) of a frame, one per camera; the file appears as a whole.

        From the first one on that cannot be written none is: they are then made again.
        """
        if not self._has_room:
            return
        content = b"".join(trimap.tobytes() for trimap in trimaps)
        try:
            write_file(self._path(frame), zlib.compress(content, _FAST))
        except (OSError, UserError) as problem:
            self._has_room = False
            log.info("silhouettes are not kept from frame %d on: %s", frame, problem)

    def read(self, frame: int) -> list[Trimap] | None:
        """The trimaps (h, w) of a frame, one per camera; None if they were not kept."""
        try:
            content = zlib.decompress(self._path(frame).read_bytes())
        except OSError:
            return None
        ends = np.cumsum([height * width for height, width in self._shapes_px])
        flat = np.split(np.frombuffer(content, np.uint8).copy(), ends[:-1])
        return [trimap.reshape(shape) for trimap, shape in zip(flat, self._shapes_px, strict=True)]

    def has_all(self, n_frames: int) -> bool:
        """Whether all frames of a take were kept."""
        return all(self._path(frame).exists() for frame in range(n_frames))

    def _path(self, frame: int) -> Path:
        return self._folder / f"{frame:06d}{_SUFFIX}"
