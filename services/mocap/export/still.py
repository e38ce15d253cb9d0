"""One frame as a picture: a camera's view with the model over it."""

from contextlib import ExitStack

import numpy as np

from services.mocap.camera.rig import Rig
from services.mocap.errors import UserError, nearest
from services.mocap.export.model_painter import ModelPainter
from services.mocap.export.overlay import pictures_of
from services.mocap.export.tiles import draw_tile, grid_for
from services.mocap.result.result import Result
from services.mocap.take.folder import Take
from services.mocap.types import Bytes


def draw_frame(result: Result, take: Take, camera: str, frame: int, *, width_px: int | None = None) -> Bytes:
    """A camera's picture of a frame with the motion's model over it, (H, W, 3) in BGR order.

    camera: its name; frame: its number in the take; width_px: of the drawn picture, the camera's by default.
    Raises UserError where the take has no such camera, or the result no such frame.
    """
    by_name = {one.name: one for one in take.cameras}
    if camera not in by_name:
        raise UserError(f"{camera}: unknown camera: {nearest(camera, by_name)}")
    rows = np.flatnonzero(result.frames == frame)
    if not rows.size:
        raise UserError(f"frame {frame}: expected one from {result.frames[0]} to {result.frames[-1]}")
    seen = by_name[camera]
    with ExitStack() as stack:
        picture = next(pictures_of(take, seen, frame, frame + 1, stack))
    mask = ModelPainter(result.motion.body, Rig.of((seen,))).segment_masks(result.poses[rows[0]])[0]
    return draw_tile(picture, mask, grid_for([seen], width_px or seen.width_px))
