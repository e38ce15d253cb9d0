"""Silhouettes of a whole take as PNG files, and where they leave the actor open: `xormocap segment`."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from services.mocap.atomic import atomic_folder
from services.mocap.camera.undistort import resized_trimap
from services.mocap.errors import UserError
from services.mocap.export.fit_sheet import Seen, draw_unsure_sheet
from services.mocap.search.unsure_shares import REMEDY, UNTOLD, may_be_actor, without_rims
from services.mocap.side_by_side import side_by_side
from services.mocap.take import layout
from services.mocap.take.folder import Take
from services.mocap.take.writer import write_picture
from services.mocap.types import ACTOR, BACKGROUND, UNSURE, Bytes, Ints, Trimap
from services.segmentation.segmenters import AUTO, READY, chosen_segmenter, make_segmenter

log = logging.getLogger(__name__)

UNSURE_SHEET = "unsure.png"
"""File next to the silhouettes that shows where the actor cannot be told from the background."""
_THIRDS = ("upper", "middle", "lower")
_UNTOLD_SHARE = 0.4
"""Share of what may be the actor in a third; both shanks and feet are that much of the lower one."""
_MANY_FRAMES = 0.25
"""Share of the frames that show somebody; a walk past a dark door takes fewer."""


def write_silhouettes(take: Take, out: Path, advance: Callable[[], None], segmenter: str = AUTO) -> None:
    """Write silhouettes/<camera>/000000.png … of a take with videos into out, all or nothing.

    They belong to the raw pictures, with lens distortion and in the calibration's size, as in a take folder:
    0 is background, 128 unsure, 255 actor. Where much of the actor is unsure a warning says so, and
    unsure.png shows it. advance is called after each picture. Raises UserError if the segmenter is the
    take's own silhouettes, or out already exists.
    """
    if chosen_segmenter(take, segmenter) == READY:
        raise UserError(f"{take.folder}: has silhouettes already: expected videos, or --segmenter")
    thirds = [UnsureThirds() for _ in take.cameras]

    def write(part: Path, frame: int, view: tuple[int, Trimap]) -> None:
        c, trimap = view
        calibrated = take.calibrated[c]
        folder = part / layout.SILHOUETTES / calibrated.name
        write_picture(layout.silhouette_path(folder, frame), resized_trimap(trimap, calibrated))
        thirds[c].add(frame, trimap)

    with atomic_folder(out) as part:
        made = make_segmenter(take, take.cameras, segmenter)
        for frame, moment in enumerate(made.source.raw_moments(0, take.settings.frames)):
            for _ in side_by_side(partial(write, part, frame), enumerate(moment.trimaps)):
                advance()
        sentence = thirds_in_words(take.camera_names, thirds)
        if sentence:
            write_picture(part / UNSURE_SHEET, _unsure_sheet(take, thirds))
            log.warning("%s; %s shows where", sentence, out / UNSURE_SHEET)


@dataclass(eq=False)
class UnsureThirds:
    """What one camera's silhouettes leave open in the upper, middle and lower third, frame by frame."""

    frames: int = 0
    """Number of frames that show a person."""
    untold: Ints = field(default_factory=lambda: np.zeros(3, np.int32))
    """(3,) number of these frames in which most of the upper, middle and lower third is unsure."""
    worst_frame: int = 0
    worst_trimap: Trimap | None = None
    """(H, W) of that frame; None where there is none."""
    _worst_px: int = 0

    def add(self, frame: int, trimap: Trimap) -> None:
        """Add the trimap (H, W) of a frame."""
        actor = may_be_actor(trimap == ACTOR, trimap != BACKGROUND)
        if not actor.any():
            return
        self.frames += 1
        rows = np.flatnonzero(actor.any(axis=1))
        thirds = np.linspace(rows[0], rows[-1] + 1, 4).round().astype(np.int64)[:3]
        blobs = actor & without_rims(trimap == UNSURE)
        unsure_px, actor_px = (np.add.reduceat(mask.sum(axis=1), thirds) for mask in (blobs, actor))
        is_untold = unsure_px > _UNTOLD_SHARE * actor_px
        self.untold += is_untold
        untold_px = int(unsure_px[is_untold].sum())
        if untold_px > self._worst_px:
            self._worst_px, self.worst_frame, self.worst_trimap = untold_px, frame, trimap.copy()

    @property
    def named(self) -> list[str]:
        """The thirds that are unsure in many frames."""
        many = max(_MANY_FRAMES * self.frames, 0.5)
        return [third for third, untold in zip(_THIRDS, self.untold, strict=True) if untold > many]


def thirds_in_words(names: Sequence[str], thirds: Sequence[UnsureThirds]) -> str:
    """The warning for the user, with the cameras' names; "" if nothing is unsure."""
    parts = []
    for third in _THIRDS:
        where = [name for name, of_camera in zip(names, thirds, strict=True) if third in of_camera.named]
        if where:
            parts.append(f"the {third} third of the actor in {', '.join(where)}")
    return f"silhouettes: {'; '.join(parts)} {UNTOLD}: {REMEDY}" if parts else ""


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
