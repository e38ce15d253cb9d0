"""The outlines of a take's silhouettes, each camera's made without the help of the others."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import islice

import numpy as np

from services.mocap.calibration.epipolar_tangents import Outline, Outlines, outline_of
from services.mocap.camera.camera import Camera
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import in_common_size
from services.mocap.side_by_side import N_CORES
from services.mocap.take.folder import Take
from services.mocap.types import Trimap
from services.segmentation.segmenters import make_segmenter
from services.segmentation.silhouettes import Segmenter


def outlines_of(
    take: Take,
    frames: range,
    progress: Callable[[float], None],
    segmenter_of: Callable[[Camera], Segmenter] | None = None,
) -> tuple[tuple[Camera, ...], Outlines, Trimap]:
    """The cameras without lens distortion, their outlines in some frames, and trimaps (C, H, W) of the middle
    frame.

    progress: called with 0 to 1. segmenter_of: makes the segmenter of one camera alone; by default the usual
    one.
    """
    cameras = tuple(camera.undistorted() for camera in take.cameras)
    height_px, width_px = Rig.of(cameras).shape_px
    of_middle: Trimap = np.zeros((len(cameras), height_px, width_px), np.uint8)

    def of_camera(c: int) -> list[Outline | None]:
        found: list[Outline | None] = []
        camera = take.cameras[c]
        alone = make_segmenter(take, [camera]) if segmenter_of is None else segmenter_of(camera)
        trimaps = islice(alone.trimaps(frames.start, frames.stop), 0, None, frames.step)
        for n, (trimap,) in enumerate(trimaps):
            found.append(outline_of(trimap, cameras[c]))
            if n == len(frames) // 2:
                of_middle[c] = in_common_size(trimap, width_px, height_px)
        return found

    outlines: Outlines = []
    with ThreadPoolExecutor(N_CORES) as pool:  # one of its own: segmenters work side by side as well
        for found in pool.map(of_camera, range(len(cameras))):
            outlines.append(found)
            progress(len(outlines) / len(cameras))
    return cameras, outlines, of_middle
