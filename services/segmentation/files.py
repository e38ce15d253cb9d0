"""Silhouettes of a whole take as PNG files: what `xormocap segment` writes."""

from collections.abc import Callable
from pathlib import Path

from services.mocap.atomic import atomic_folder
from services.mocap.errors import UserError
from services.mocap.take import layout
from services.mocap.take.folder import Take
from services.mocap.take.writer import write_picture
from services.segmentation.cleanup import SegmentationSettings
from services.segmentation.source import CleanPlateSegmenter


def write_silhouettes(take: Take, out: Path, advance: Callable[[], None]) -> None:
    """Write silhouettes/<camera>/000000.png … of a take with videos into out, all or nothing.

    They are those of the raw pictures, lens distortion included, as a take folder holds them. advance is
    called after each picture. Raises UserError where the take has silhouettes already, or out is not free.
    """
    if take.source == "silhouettes":
        raise UserError(f"{take.folder}: has silhouettes already: expected videos and clean plates")
    settings = SegmentationSettings()
    with atomic_folder(out) as part:
        for camera in take.cameras:
            segmenter = CleanPlateSegmenter(take, camera, settings)
            folder = part / layout.SILHOUETTES / camera.name
            for frame, mask in enumerate(segmenter.raw_silhouettes(0, take.settings.frames)):
                write_picture(layout.silhouette_path(folder, frame), mask)
                advance()
