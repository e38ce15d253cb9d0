"""The overlay of a take: its pictures, or its silhouettes where there are none, and the model over them."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

import numpy as np

from services.mocap.body.actor import Body
from services.mocap.camera.camera import Camera
from services.mocap.camera.rig import Rig
from services.mocap.camera.undistort import Undistorter
from services.mocap.export.model_painter import ModelPainter
from services.mocap.export.overlay import OverlayWriter
from services.mocap.take.folder import Take
from services.mocap.take.tables import PoseTable
from services.mocap.types import Bytes, Trimap


class _Hurried(Exception):  # noqa: N818  (a request, not an error)
    """Drawing was cut short."""


def write_overlay(path: Path, take: Take, body: Body, table: PoseTable, hurry: Callable[[], bool]) -> None:
    """Draw poses of consecutive frames; a camera without a video shows its silhouettes.

    hurry: asked at every frame; when it says so nothing is written.
    """
    with suppress(_Hurried):
        _draw(path, take, body, table, hurry)


def _draw(path: Path, take: Take, body: Body, table: PoseTable, hurry: Callable[[], bool]) -> None:
    start, stop = int(table.frames[0]), int(table.frames[-1]) + 1
    painter = ModelPainter(body, Rig.of(take.cameras))
    with ExitStack() as stack:
        images = [_images(take, camera, start, stop, stack) for camera in take.cameras]
        trimaps = [_trimaps(take, camera, start, stop) for camera in take.cameras]
        writer = stack.enter_context(OverlayWriter(path, take.cameras, take.settings.fps))
        for n, frame in enumerate(table.frames.tolist()):
            if hurry():
                raise _Hurried
            writer.add(
                frame,
                float(table.times_s[n]),
                [next(pictures) for pictures in images],
                painter.segment_masks(table.poses[n]),
                float(table.energies_px[n]),
                trimaps=[next(of_camera) for of_camera in trimaps],
            )


def _images(take: Take, camera: Camera, start: int, stop: int, stack: ExitStack) -> Iterator[Bytes | None]:
    if not take.has_video(camera):
        return iter([None] * (stop - start))
    undistorter = Undistorter(camera)
    return (undistorter.image(image) for image in stack.enter_context(take.video(camera, start, stop)))


def _trimaps(take: Take, camera: Camera, start: int, stop: int) -> Iterator[Trimap]:
    """Only for cameras without a video; the others' are not looked at."""
    if take.has_video(camera):
        return iter([np.zeros((camera.height_px, camera.width_px), np.uint8)] * (stop - start))
    return map(Undistorter(camera).trimap, take.trimaps(camera, start, stop))
