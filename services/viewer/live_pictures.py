"""What the cameras of a live take saw: pictures of its folder, silhouettes that the coordinator had."""

import threading
import zlib
from collections import OrderedDict
from collections.abc import Callable

import numpy as np

from proto.messages import Silhouettes
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes, fit_together, unpack_trimaps
from services.mocap.types import Bytes, Trimap
from services.viewer.pictures import TakePictures

_KEPT_FRAMES = 512
"""Frames whose silhouettes are kept, packed, for going back to them; a few kilobytes each."""
_PATIENCE_S = 0.3
"""How long a page waits for silhouettes; the coordinator answers between two steps of its own."""


class LivePictures:
    """See Pictures. Silhouettes are there for frames that somebody looked at while they were new."""

    def __init__(self, rig: Rig, folder: TakePictures | None, ask: Callable[[int], None]) -> None:
        """folder: the take's, where this host has it. ask: asks the coordinator for a frame's silhouettes."""
        self._rig, self._folder, self._ask = rig, folder, ask
        self._packed: OrderedDict[int, dict[int, bytes]] = OrderedDict()
        self._asked: OrderedDict[int, None] = OrderedDict()
        self._came = threading.Condition()

    def picture(self, camera: int, frame: int) -> Bytes | None:
        """See Pictures.picture."""
        return None if self._folder is None else self._folder.picture(camera, frame)

    def trimap(self, camera: int, frame: int) -> Trimap | None:
        """See Pictures.trimap."""
        trimap = None if self._folder is None else self._folder.trimap(camera, frame)
        if trimap is not None:
            return trimap
        with self._came:
            if frame not in self._asked and frame not in self._packed:
                self._asked[frame] = None
                while len(self._asked) > _KEPT_FRAMES:
                    self._asked.popitem(last=False)
                self._ask(frame)
                self._came.wait_for(lambda: self._is_whole(frame), _PATIENCE_S)
            packed = self._packed.get(frame, {}).get(camera)
        width, height = self._rig.sizes_px[camera].tolist()
        if packed is None:
            return None
        return np.frombuffer(zlib.decompress(packed), np.uint8).reshape(height, width)

    def _is_whole(self, frame: int) -> bool:
        return len(self._packed.get(frame, {})) == self._rig.n_cameras

    def add(self, message: Silhouettes) -> None:
        """Take in silhouettes of some cameras; those that do not fit the rig are left out."""
        cameras = message.cameras
        fits = fit_together(message.planes, message.unsure, len(cameras), self._rig.shape_px)
        if max(cameras) >= self._rig.n_cameras or not fits:
            return
        planes = TriPlanes.of_sent(message.planes, message.unsure)
        with self._came:
            if message.frame not in self._asked:
                return
            frame = self._packed.setdefault(message.frame, {})
            for camera, trimap in zip(cameras, unpack_trimaps(planes, len(cameras)), strict=True):
                width, height = self._rig.sizes_px[camera].tolist()
                frame[camera] = zlib.compress(trimap[:height, :width].tobytes(), 1)
            while len(self._packed) > _KEPT_FRAMES:
                self._packed.popitem(last=False)
            self._came.notify_all()
