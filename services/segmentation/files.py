"""Silhouettes of a whole take as PNG files: what `xormocap segment` writes."""

import logging
from collections.abc import Callable, Sequence
from pathlib import Path

from services.mocap.atomic import atomic_folder
from services.mocap.errors import UserError
from services.mocap.export.fit_sheet import Seen, draw_unsure_sheet
from services.mocap.take import layout
from services.mocap.take.folder import Take
from services.mocap.take.writer import write_picture
from services.mocap.types import Bytes
from services.segmentation.cleanup import SegmentationSettings
from services.segmentation.segmenters import AUTO, READY, chosen_segmenter, make_segmenter
from services.segmentation.unsure_thirds import UnsureThirds, thirds_in_words

log = logging.getLogger(__name__)

UNSURE_SHEET = "unsure.png"
"""Beside the silhouettes: where the actor cannot be told from the background, if anywhere."""


def write_silhouettes(take: Take, out: Path, advance: Callable[[], None], segmenter: str = AUTO) -> None:
    """Write silhouettes/<camera>/000000.png … of a take with videos into out, all or nothing.

    They are those of the raw pictures, lens distortion included, as a take folder holds them: 0 is
    background, 128 unsure, 255 actor. Where much of the actor is unsure a warning says so, and unsure.png
    shows it. advance is called after each picture. segmenter: what makes them.
    Raises UserError where that is silhouettes which the take has already, or out is not free.
    """
    if chosen_segmenter(take, segmenter) == READY:
        raise UserError(f"{take.folder}: has silhouettes already: expected videos, or --segmenter")
    settings, thirds = SegmentationSettings(), [UnsureThirds() for _ in take.cameras]
    with atomic_folder(out) as part:
        made = make_segmenter(take, take.cameras, settings, segmenter)
        for frame, trimaps in enumerate(made.raw_trimaps(0, take.settings.frames)):
            for camera, trimap, of_camera in zip(take.cameras, trimaps, thirds, strict=True):
                folder = part / layout.SILHOUETTES / camera.name
                write_picture(layout.silhouette_path(folder, frame), trimap)
                of_camera.add(frame, trimap)
                advance()
        sentence = thirds_in_words([camera.name for camera in take.cameras], thirds)
        if sentence:
            write_picture(part / UNSURE_SHEET, _unsure_sheet(take, thirds))
            log.warning("%s; %s shows where", sentence, out / UNSURE_SHEET)


def _unsure_sheet(take: Take, thirds: Sequence[UnsureThirds]) -> Bytes:
    """The worst frame (H, W, 3) of each camera that is named."""
    seen, titles = [], []
    for camera, of_camera in zip(take.cameras, thirds, strict=True):
        if of_camera.named and of_camera.worst_trimap is not None:
            frame = of_camera.worst_frame
            with take.video(camera, frame, frame + 1) as video:
                seen.append(Seen(camera, next(iter(video)), of_camera.worst_trimap))
            titles.append(f"{camera.name}  frame {frame}  unsure")
    return draw_unsure_sheet(seen, titles)
