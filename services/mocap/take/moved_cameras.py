"""A take with cameras that stand elsewhere than its calibration says."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from services.mocap.camera.calibration import read_calibration
from services.mocap.camera.camera import Camera
from services.mocap.take.fit_record import FIT_FOLDER, read_record, was_seen_by
from services.mocap.take.folder import Take
from services.mocap.take.layout import CALIBRATION
from services.mocap.take.live import LiveTake


def moved_take(take: Take, cameras: Sequence[Camera]) -> Take:
    """The take with the extrinsics of these cameras; others stay."""
    found = {camera.name: camera for camera in cameras}

    def moved(camera: Camera) -> Camera:
        there = found.get(camera.name, camera)
        return replace(camera, R_camera_world=there.R_camera_world, t_camera_world_m=there.t_camera_world_m)

    return replace(take, calibrated=tuple(map(moved, take.calibrated)))


def take_of_fit(take: Take, fitted: Path | None = None) -> Take:
    """A recorded take with the cameras where a fit found them, if it moved some of this very calibration.

    fitted: the folder of the fit; the take's own by default. Raises TakeError if its files cannot be used.
    """
    folder = fitted or take.folder / FIT_FOLDER
    if isinstance(take, LiveTake) or not (folder / CALIBRATION).exists():
        return take
    record = read_record(folder)
    if record is None or not was_seen_by(record, take.calibrated):
        return take
    return moved_take(take, read_calibration(folder / CALIBRATION, take.settings.up))
