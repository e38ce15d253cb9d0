"""What a joint matte learns: of a recorded take before the first frame, of live pictures as they come."""

import logging
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice

import numpy as np

from services.mocap.camera.camera import Camera
from services.mocap.take.folder import Take
from services.mocap.types import Bytes, Mask
from services.segmentation.background import keyframes
from services.segmentation.joint import JointMatte
from services.segmentation.silhouettes import pictures_of

_MOMENTS = 12
"""Moments to learn from, if a take has so many frames."""
_MOST_RUNS = 4
_MOST_DECODED = 48
"""Frames decoded per camera, in total."""
_FLOOR_MOMENTS = 4
_SHAKES_PX = 0.5
"""Shifts of pictures against the plate that are said."""
_LIVE_EVERY = 5
"""At first, one of so many live shots is learnt from."""
_LIVE_CONCLUSIONS = 6
"""Number of learnt shots between two conclusions."""
_SLOWER_AFTER, _SLOWER = 60, 10
"""Once so many shots have been learnt from, shots are learnt from ten times less often."""

log = logging.getLogger(__name__)


def learn_from_take(matte: JointMatte, take: Take, cameras: Sequence[Camera]) -> None:
    """Learn from moments at the start of a take and from later keyframes: every process learns the same."""
    floor_moments = list(islice(_moments(take, cameras), 0, None, _MOMENTS // _FLOOR_MOMENTS))
    matte.allow_for_errors(floor_moments)
    matte.settle_floor(floor_moments)
    matte.learn_all(lambda: _moments(take, cameras))
    _tell_moved(f"{take.folder}: ", [camera.name for camera in cameras], matte.moved)
    _tell_shaking(take, cameras, [matte.shifts_px(images) for images in floor_moments])


def _tell_shaking(take: Take, cameras: Sequence[Camera], shifts_px: Sequence[Sequence[float]]) -> None:
    """Warn of cameras whose pictures are usually off the plate, by shifts (M, C) at some moments."""
    usual_px = np.median(shifts_px, axis=0) if shifts_px else np.zeros(len(cameras))
    shaking = [
        f"{camera.name} by {px:.1f} px"
        for camera, px in zip(cameras, usual_px, strict=True)
        if px > _SHAKES_PX
    ]
    if shaking:
        log.warning(
            "%s: cameras shake, or stabilise their pictures (%s): the pictures are moved back to "
            "where the empty stage was seen; use firm tripods and switch stabilisation off",
            take.folder, ", ".join(shaking),
        )  # fmt: skip


def _tell_moved(where: str, cameras: Sequence[str], moved: Sequence[Mask]) -> None:
    """Warn of objects (H, W) in the pictures of some cameras, if there are any."""
    places = []
    for camera, mask in zip(cameras, moved, strict=True):
        if mask.any():
            row, column = np.median(np.nonzero(mask), axis=1)
            places.append(
                f"{camera} near column {column:.0f}, row {row:.0f}, {mask.mean():.1%} of the picture"
            )
    if places:
        log.warning(
            "%ssomething is not as in the clean plates and does not move (%s): its pixels count for nothing; "
            "record the empty stage again", where, "; ".join(places),
        )  # fmt: skip


def _moments(take: Take, cameras: Sequence[Camera]) -> Iterator[dict[int, Bytes]]:
    """Pictures of all cameras at some moments, chosen so that few frames have to be decoded."""
    begins = sorted({0, *keyframes(take, cameras[0])[1]})
    begins = begins[:: -(-len(begins) // _MOST_RUNS)]
    longest, each = _MOST_DECODED // len(begins), -(-_MOMENTS // len(begins))
    for begin, following in zip(begins, [*begins[1:], take.settings.frames], strict=True):
        length = min(longest, following - begin)
        apart = max(length // each, 1)
        yield from islice(pictures_of(take, cameras, begin, begin + length), 0, None, apart)


class LiveLearner:
    """Teaches a matte by some of the live pictures that it is given, and warns once of a moved object in a
    camera's pictures."""

    def __init__(self, matte: JointMatte, cameras: Sequence[str]) -> None:
        """cameras: their names."""
        self._matte, self._cameras = matte, cameras
        self._shots = self._learnt = 0
        self._told = set[int]()

    def see(self, images_bgr: Mapping[int, Bytes]) -> None:
        """Learn from a shot's pictures (H, W, 3) by camera, if it is time."""
        self._shots += 1
        every = _LIVE_EVERY * (_SLOWER if self._learnt > _SLOWER_AFTER else 1)
        if self._shots % every:
            return
        self._learnt += 1
        self._matte.learn(images_bgr)
        if self._learnt % _LIVE_CONCLUSIONS == 0 or self._learnt == 1:
            self._matte.allow_for_errors([images_bgr])
            self._matte.conclude()
            moved = [mask & (c not in self._told) for c, mask in enumerate(self._matte.moved)]
            self._told.update(c for c, mask in enumerate(moved) if mask.any())
            _tell_moved("", self._cameras, moved)
