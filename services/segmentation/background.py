"""What there is to learn a camera's background from: its clean plate, or pictures spread over its video."""

import logging
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import cached_property
from itertools import islice

import cv2
import numpy as np

from services.mocap.camera.camera import Camera
from services.mocap.sampling import evenly
from services.mocap.take.folder import Take
from services.mocap.take.video_index import VideoIndex, index_video
from services.mocap.types import Bytes
from services.segmentation.plate import LIGHT_UNCERTAINTY, Plate
from services.segmentation.plate_shift import plate_shift_px, shifted
from services.segmentation.steadying import Anchors
from services.segmentation.take_plate import LOOKS, SAMPLES, TakePlate, find_ghost, plate_of_samples

log = logging.getLogger(__name__)

_UNSURE = 0.1
"""Share of the part where anything moves; with more in doubt the plate is likely to contain the actor."""
_SHAKES_PX, _SHAKES_WITHIN = 0.5, 10
"""A camera shakes if its shift differs by more pixels within so many frames."""
_LOOK_WIDTH_PX = 160
_MOST_DECODED = 48
"""Frames that quick looks decode, in total."""


class CameraBackground:
    """One camera's background: the sources for learning it, and its plate, which is learnt once."""

    def __init__(self, take: Take, camera: Camera) -> None:
        self.take, self.camera = take, camera
        self._looks: list[Bytes] = []
        """Small copies of the recorded clean plate, after learning it."""
        self._plate: tuple[Plate, tuple[float, float]] | None = None
        """As learnt, and by how much the recorded one was moved (right, down), in pixels."""

    @property
    def is_recorded(self) -> bool:
        """Whether the take has a clean plate of this camera."""
        return self.take.has_background(self.camera)

    @cached_property
    def made(self) -> TakePlate:
        """What the take itself tells of the empty scene."""
        return plate_of_samples(spread_pictures(self.take, self.camera, SAMPLES))

    def pictures(self) -> Iterable[Bytes]:
        """Pictures (H, W, 3) of the empty scene: the clean plate, or an estimate from the take."""
        if not self.is_recorded:
            return self.made.frames
        self._looks.clear()
        return keeping_looks(self.take.background(self.camera), self._looks, LOOKS)

    def mean_picture(self) -> Bytes | None:
        """The recorded clean plate as one picture (H, W, 3); None without one."""
        if not self.is_recorded:
            return None
        total, count = np.zeros(1), 0
        for picture in self.take.background(self.camera):
            total, count = total + picture, count + 1
        return np.asarray(np.rint(total / max(count, 1)).astype(np.uint8))

    def plate(self) -> Plate:
        """The camera's plate, moved to where its pictures are if the camera was touched since; what is wrong
        with it is logged every time."""
        if self._plate is None:
            first = self._first_picture()
            shift_px = self._shift_px(first)
            moved = shifted(self.pictures(), shift_px)
            self._plate = Plate.learn(moved, LIGHT_UNCERTAINTY, first), shift_px
        plate, shift_px = self._plate
        if shift_px != (0.0, 0.0):
            log.warning(
                "%s/background: clean plate of %s lies %.1f px beside the pictures and was moved: the camera "
                "was moved since, so record the empty stage again, and check the calibration "
                "(xormocap calibrate --check)",
                self.take.folder, self.camera.name, float(np.hypot(*shift_px)),
            )  # fmt: skip
        if plate.has_other_tone:
            log.warning(
                "%s/background: clean plate of %s has another contrast or exposure than the videos, to which "
                "it was adapted: record it with the same settings, as a video, and in the same light",
                self.take.folder, self.camera.name,
            )  # fmt: skip
        # An estimate may show the actor, whose outlines move.
        return plate if self.is_recorded else replace(plate, anchors=Anchors.none())

    def _first_picture(self) -> Bytes | None:
        """The take's first picture (H, W, 3), to compare a recorded clean plate with; None without them."""
        if not self.is_recorded or not self.take.has_video(self.camera):
            return None
        with self.take.video(self.camera, 0, 1) as video:
            return next(iter(video), None)

    def _shift_px(self, first: Bytes | None) -> tuple[float, float]:
        """The shift (right, down) that aligns a recorded clean plate with the take's first pictures.

        (0, 0) if it differs between them: cameras that shake are left to services.segmentation.steadying.
        """
        plate = next(iter(self.take.background(self.camera)), None) if first is not None else None
        if first is None or plate is None or first.shape != plate.shape:
            return 0.0, 0.0
        found = plate_shift_px(plate, first)
        if found == (0.0, 0.0):
            return found
        with self.take.video(self.camera, 1, min(_SHAKES_WITHIN, self.take.settings.frames)) as video:
            further = [plate_shift_px(plate, picture) for picture in islice(video, 2, None, 3)]
        is_steady = all(np.hypot(x - found[0], y - found[1]) < _SHAKES_PX for x, y in further)
        return found if is_steady else (0.0, 0.0)

    def check(self) -> None:
        """Warn if a recorded clean plate, already learnt, is not clean."""
        ghost = find_ghost(np.array(self._looks), quick_looks(self.take, self.camera, LOOKS))
        if ghost is None:
            return
        what = "something moves in it" if ghost.moves else "shows something that most frames do not"
        log.warning(
            "%s/background: clean plate of %s: %s (%.1f%% of the picture, about column %d, row %d), which "
            "spoils the silhouettes: record the empty stage with nobody in it",
            self.take.folder, self.camera.name, what, 100 * ghost.share,
            *ghost.centre_px(self.camera.width_px),
        )  # fmt: skip


def warn_of_guesses(take: Take, unsure_shares: dict[str, float]) -> None:
    """Warn of the reliability of plates estimated from the take, for the worst camera."""
    worst = max(unsure_shares, key=lambda name: unsure_shares[name])
    log.warning(
        "%s/background: is missing: the empty scene was estimated from the videos; in %s, the worst, "
        "%.1f%% of the part where anything moves shows it in fewer than half of %d frames%s: record the "
        "empty stage",
        take.folder, worst, 100 * unsure_shares[worst], min(SAMPLES, take.settings.frames),
        ", so that the actor hardly leaves the place and silhouettes will be wrong there"
        if unsure_shares[worst] > _UNSURE
        else " and cannot be trusted",
    )  # fmt: skip


def spread_pictures(take: Take, camera: Camera, most: int) -> Bytes:
    """Up to so many raw pictures (N, H, W, 3) of a camera, from the first frame to the last.

    They are keyframes, which are decoded alone, where there are enough.
    """
    index, keys = keyframes(take, camera)
    if len(keys) >= most:
        picker, ahead = take.picker(camera), take.settings.offset(camera.name)
        return np.array([picker.read(keys[i] + ahead) for i in evenly(len(keys), most).tolist()])
    wanted = set(evenly(take.settings.frames, most).tolist())
    with take.video(camera, 0, take.settings.frames, index) as video:
        return np.array([picture for frame, picture in enumerate(video) if frame in wanted])


def quick_looks(take: Take, camera: Camera, most: int) -> Bytes:
    """Small copies (N, h, w, 3), about so many, of a camera's raw pictures.

    As few frames as possible are decoded: keyframes, and frames soon after each if there are too few of them.
    """
    index, keys = keyframes(take, camera)
    begins = sorted({0, *keys})
    runs = [range(*ends) for ends in zip(begins, [*begins[1:], take.settings.frames], strict=True)]
    runs = [runs[i] for i in evenly(len(runs), most).tolist()]
    each, longest = -(-most // len(runs)), max(1, _MOST_DECODED // len(runs))
    pictures: list[Bytes] = []
    for run in runs:
        wanted = evenly(min(len(run), longest), each).tolist()
        with take.video(camera, run.start, run.start + wanted[-1] + 1, index) as video:
            pictures += [shrunk(picture) for n, picture in enumerate(video) if n in wanted]
    return np.array(pictures)


def keeping_looks(pictures: Iterable[Bytes], looks: list[Bytes], fewest: int) -> Iterator[Bytes]:
    """Pass pictures (H, W, 3) through, and put small copies of some, evenly spread, into `looks`.

    fewest: at least so many are kept, if so many go by; always fewer than twice as many.
    """
    every = 1  # grows, since nobody knows how many will come
    for n, picture in enumerate(pictures):
        if n % every == 0:
            looks.append(shrunk(picture))
            if len(looks) == 2 * fewest:
                looks[:], every = looks[::2], 2 * every
        yield picture


def shrunk(picture: Bytes) -> Bytes:
    """A picture (H, W, 3), reduced as far as people remain recognisable."""
    share = _LOOK_WIDTH_PX / picture.shape[1]
    if share >= 1:
        return picture
    return np.asarray(cv2.resize(picture, None, fx=share, fy=share, interpolation=cv2.INTER_AREA), np.uint8)


def keyframes(take: Take, camera: Camera) -> tuple[VideoIndex, list[int]]:
    """A camera's video, and the frames of the take that are decoded without any other."""
    index, first = index_video(take.videos[camera.name]), take.settings.offset(camera.name)
    return index, [key - first for key, _ in index.keyframes if 0 <= key - first < take.settings.frames]
