"""What there is to learn a camera's background from, and warnings about it."""

import logging
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from services.mocap.camera.camera import Camera
from services.mocap.take.folder import Take
from services.mocap.types import Bytes
from services.segmentation.cleanup import SegmentationSettings
from services.segmentation.ghosts import LOOKS, find_ghost
from services.segmentation.plate import Plate
from services.segmentation.plate_shift import plate_shift_px, shifted
from services.segmentation.samples import KeptLooks, quick_looks, spread_pictures
from services.segmentation.take_plate import SAMPLES, TakePlate, plate_of_samples
from services.segmentation.view import LIGHT_UNCERTAINTY

log = logging.getLogger(__name__)

_UNSURE = 0.1
"""Of the part where anything moves; with more in doubt the actor is likely to be part of the plate."""


@dataclass(frozen=True, eq=False)
class Scene:
    """What there is to learn one camera's background from."""

    take: Take
    camera: Camera
    settings: SegmentationSettings
    looks: KeptLooks = field(default_factory=lambda: KeptLooks(LOOKS))
    """At the recorded clean plate, once it was learnt."""

    @property
    def is_recorded(self) -> bool:
        """Whether the take has a clean plate of this camera."""
        return self.take.has_background(self.camera)

    @cached_property
    def unsure_share(self) -> float:
        """Of the part in which anything moves, what a plate made of the take does not tell for sure."""
        return self._made.unsure_share

    def plate(self) -> Iterable[Bytes]:
        """Pictures (H, W, 3) of the empty scene: the clean plate, or what the take itself tells of it."""
        return self.looks.of(self.take.background(self.camera)) if self.is_recorded else self._made.frames

    def plate_picture(self) -> Bytes | None:
        """The recorded clean plate as one picture (H, W, 3); None without one."""
        if not self.is_recorded:
            return None
        total, count = np.zeros(1), 0
        for picture in self.take.background(self.camera):
            total, count = total + picture, count + 1
        mean: Bytes = np.rint(total / max(count, 1)).astype(np.uint8)
        return mean

    @property
    def shift_px(self) -> tuple[float, float]:
        """How far to the right and down a recorded clean plate has to move to lie on the take's first
        picture."""
        if not self.is_recorded or not self.take.has_video(self.camera):
            return 0.0, 0.0
        with self.take.video(self.camera, 0, 1) as video:
            first = next(iter(video), None)
        plate = next(iter(self.take.background(self.camera)), None)
        if first is None or plate is None or first.shape != plate.shape:
            return 0.0, 0.0
        return plate_shift_px(plate, first)

    @cached_property
    def _made(self) -> TakePlate:
        return plate_of_samples(spread_pictures(self.take, self.camera, SAMPLES))


def learn_plate(scene: Scene) -> Plate:
    """A camera's plate, moved to where its pictures are if the camera was touched since."""
    shift_px = scene.shift_px
    if shift_px != (0.0, 0.0):
        log.warning(
            "%s/background: clean plate of %s lies %.1f px beside the pictures and was moved: the camera was "
            "touched since, so record the empty stage again, and check the calibration "
            "(xormocap calibrate --check)",
            scene.take.folder, scene.camera.name, float(np.hypot(*shift_px)),
        )  # fmt: skip
    return Plate.learn(shifted(scene.plate(), shift_px), scene.settings, LIGHT_UNCERTAINTY)


def check_plate(scene: Scene) -> None:
    """Warn of a recorded clean plate, already learnt, that is not clean."""
    take, camera = scene.take, scene.camera
    ghost = find_ghost(scene.looks.pictures, quick_looks(take, camera, LOOKS))
    if ghost is None:
        return
    what = "something moves in it" if ghost.moves else "shows something that is in no frame of the take"
    log.warning(
        "%s/background: clean plate of %s: %s (%.1f%% of the picture, about column %d, row %d), which spoils "
        "the silhouettes: record the empty stage with nobody in it",
        take.folder, camera.name, what, 100 * ghost.share, *ghost.centre_px(camera.width_px),
    )  # fmt: skip


def warn_of_guesses(take: Take, unsure_shares: dict[str, float]) -> None:
    """Say how far plates made of the take can be trusted, by the worst of the cameras."""
    worst = max(unsure_shares, key=lambda name: unsure_shares[name])
    log.warning(
        "%s/background: is missing: the empty scene was taken from the videos themselves; in %s, the worst, "
        "%.1f%% of the part where anything moves shows it in fewer than half of %d frames%s: record the "
        "empty stage",
        take.folder, worst, 100 * unsure_shares[worst], min(SAMPLES, take.settings.frames),
        ", so that the actor hardly leaves the place and silhouettes will be wrong there"
        if unsure_shares[worst] > _UNSURE
        else " and cannot be trusted",
    )  # fmt: skip
