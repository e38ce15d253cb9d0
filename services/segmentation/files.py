"""Silhouettes of a whole take as PNG files: what `xormocap segment` writes."""

from collections.abc import Callable
from pathlib import Path

from services.mocap.atomic import atomic_folder
from services.mocap.errors import UserError
from services.mocap.take import layout
from services.mocap.take.folder import Take
from services.mocap.take.writer import write_picture
from services.segmentation.cleanup import SegmentationSettings
from services.segmentation.segmenters import AUTO, READY, chosen_segmenter, make_segmenter


def write_silhouettes(take: Take, out: Path, advance: Callable[[], None], segmenter: str = AUTO) -> None:
    """Write silhouettes/<camera>/000000.png … of a take with videos into out, all or nothing.

    They are those of the raw pictures, lens distortion included, as a take folder holds them: 0 is
    background, 128 unsure, 255 actor. advance is called after each picture. segmenter: what makes them.
    Raises UserError where that is silhouettes which the take has already, or out is not free.
    """
    if chosen_segmenter(take, segmenter) == READY:
        raise UserError(f"{take.folder}: has silhouettes already: expected videos, or --segmenter")
    settings = SegmentationSettings()
    with atomic_folder(out) as part:
        made = make_segmenter(take, take.cameras, settings, segmenter)
        for frame, trimaps in enumerate(made.raw_trimaps(0, take.settings.frames)):
            for camera, trimap in zip(take.cameras, trimaps, strict=True):
                folder = part / layout.SILHOUETTES / camera.name
                write_picture(layout.silhouette_path(folder, frame), trimap)
                advance()
