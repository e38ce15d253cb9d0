"""The silhouettes of a take, camera by camera, for the commands that compare cameras."""

from itertools import islice

import numpy as np
from rich.console import Console
from rich.progress import Progress

from services.mocap.calibration.epipolar_tangents import Outline, outline_of
from services.mocap.camera.camera import Camera
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import in_common_size
from services.mocap.take.folder import Take
from services.mocap.types import Trimap
from services.segmentation.cleanup import SegmentationSettings
from services.segmentation.segmenters import make_segmenter


def outlines_of(
    take: Take, frames: range, every: int, errors: Console
) -> tuple[tuple[Camera, ...], list[list[Outline | None]], Trimap]:
    """The cameras without lens distortion, their outlines in some frames, and the trimaps of one frame.

    every: of how many frames one is taken. The trimaps (C, H, W) are those of the frame in the middle.
    """
    cameras = tuple(camera.undistorted() for camera in take.cameras)
    height_px, width_px = Rig.of(cameras).shape_px
    outlines: list[list[Outline | None]] = []
    middle: Trimap = np.zeros((len(cameras), height_px, width_px), np.uint8)
    chosen = range(0, len(frames), every)
    with Progress(console=errors) as bar:
        task = bar.add_task("looking at silhouettes", total=len(cameras))
        for c, camera in enumerate(take.cameras):
            alone = make_segmenter(
                take, [camera], SegmentationSettings()
            )  # others must not help what is to be compared
            trimaps = alone.trimaps(frames.start, frames.stop)
            of_camera: list[Outline | None] = []
            for n, (trimap,) in enumerate(islice(trimaps, 0, len(frames), every)):
                of_camera.append(outline_of(trimap, cameras[c]))
                if n == len(chosen) // 2:
                    middle[c] = in_common_size(trimap, width_px, height_px)
            outlines.append(of_camera)
            bar.advance(task)
    return cameras, outlines, middle
