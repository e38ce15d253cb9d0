"""Takes made harder: half of the cameras, and silhouettes as a bad segmentation makes them."""

import shutil
from collections.abc import Callable, Iterator, Sequence
from enum import StrEnum
from pathlib import Path

import cv2
import numpy as np

from bench.command import xormocap
from services.mocap.body.actor import Actor
from services.mocap.camera.camera import Camera
from services.mocap.energy.bitplanes import trimap_of
from services.mocap.take import layout
from services.mocap.take.actor_file import write_actor
from services.mocap.take.folder import Take
from services.mocap.take.layout import REFERENCE_JOINTS_CSV, silhouette_folder, silhouette_path
from services.mocap.take.pictures import read_trimaps
from services.mocap.take.writer import take_writer, write_picture
from services.mocap.types import ACTOR, UNSURE, Mask, Trimap

EATEN = 0.05
"""Share of the contour's pixels that is bitten away, with what lies around it."""
SPECKS = 0.01
"""Share of the picture's pixels that is turned round, in specks of one to three pixels across."""
_BITE_PER_HEIGHT = 0.015
"""A bite's radius over the figure's height in the picture: some 3 cm."""
_SMALLEST_BITE_PX = 2
_LARGEST_SPECK_PX = 3


class Degradation(StrEnum):
    """What is done to a take."""

    EVERY_OTHER = "every other camera"
    """Of eight around the stage, two pairs that face each other and so see much the same outlines."""
    FIRST_HALF = "the first half of the cameras"
    """Of a ring, those of one side."""
    NOISE = "5 % of the boundary eaten, 1 % specks"


def _cameras_left(cameras: Sequence[Camera], degradation: Degradation) -> list[Camera]:
    if degradation is Degradation.EVERY_OTHER:
        return list(cameras[::2])
    if degradation is Degradation.FIRST_HALF:
        return list(cameras[: (len(cameras) + 1) // 2])
    return list(cameras)


Trimaps = Callable[[Camera], Iterator[Trimap]]
"""A camera's raw trimaps, frame by frame from the take's first on."""


def trimaps_of(take: Take, folder: Path) -> Trimaps:
    """The silhouettes that a take is tracked by; folder: where those of videos are put."""
    if take.source == "silhouettes":
        return lambda camera: take.trimaps(camera)
    xormocap("segment", take.folder, "--out", folder)
    frames = take.settings.frames
    return lambda camera: read_trimaps(silhouette_folder(folder, camera.name), 0, frames, camera=camera)


def write_harder(
    folder: Path, take: Take, trimaps: Trimaps, actor: Actor, degradation: Degradation, seed: int = 0
) -> None:
    """Write a degraded copy of a take, with its actor and what is known of its truth."""
    cameras = _cameras_left(take.cameras, degradation)
    settings = take.settings.model_copy(update={"unsure": [UNSURE, UNSURE]})
    with take_writer(folder, settings, cameras) as part:
        for c, camera in enumerate(cameras):
            for frame, trimap in enumerate(trimaps(camera)):
                rng = np.random.default_rng((seed, c, frame))
                harder = _spoilt(trimap, rng) if degradation is Degradation.NOISE else trimap
                write_picture(silhouette_path(silhouette_folder(part, camera.name), frame), harder)
        write_actor(part / layout.ACTOR, actor, "the take that this one was made of")
        _copy_truth(take.folder, part)


def _spoilt(trimap: Trimap, rng: np.random.Generator) -> Trimap:
    """A trimap (H, W) whose actor is bitten and who has specks about; unsure pixels stay so."""
    actor = with_specks(bitten(trimap == ACTOR, rng), rng)
    spoilt: Trimap = np.where(trimap == UNSURE, trimap, trimap_of(actor))
    return spoilt


def _copy_truth(source: Path, target: Path) -> None:
    if (source / REFERENCE_JOINTS_CSV).exists():
        (target / REFERENCE_JOINTS_CSV).parent.mkdir(exist_ok=True)
        shutil.copy(source / REFERENCE_JOINTS_CSV, target / REFERENCE_JOINTS_CSV)


def bitten(mask: Mask, rng: np.random.Generator, share: float = EATEN) -> Mask:
    """A silhouette (H, W) without discs about points of its contour, which hold a share of the contour."""
    eroded = cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=1) > 0
    contour = mask & ~eroded
    points = np.argwhere(contour)
    if not len(points):
        return mask.copy()
    height_px = np.ptp(points[:, 0]) + 1
    radius_px = max(_SMALLEST_BITE_PX, round(_BITE_PER_HEIGHT * height_px))
    bites = np.zeros(mask.shape, np.uint8)
    for y, x in rng.permutation(points):
        if np.count_nonzero(contour & (bites > 0)) >= share * len(points):
            break
        cv2.circle(bites, (int(x), int(y)), radius_px, 1, cv2.FILLED)
    left: Mask = mask & (bites == 0)
    return left


def with_specks(mask: Mask, rng: np.random.Generator, share: float = SPECKS) -> Mask:
    """A silhouette (H, W) with a share of its pixels turned round, in squares of one to three pixels."""
    specks: Mask = np.zeros(mask.shape, bool)
    height_px, width_px = mask.shape
    while np.count_nonzero(specks) < share * specks.size:
        size_px = int(rng.integers(1, _LARGEST_SPECK_PX + 1))
        y, x = int(rng.integers(height_px)), int(rng.integers(width_px))
        specks[y : y + size_px, x : x + size_px] = True
    spoilt: Mask = mask ^ specks
    return spoilt
