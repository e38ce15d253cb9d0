"""Writes cameras as OpenCap does."""

import pickle  # noqa: TID251  (only written)
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from services.mocap.camera.camera import Camera

_R_BOARD = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])
"""From the upright board's world, whose y axis points down, to one in which z points up."""


def write_opencap(folder: Path, cameras: Sequence[Camera], protocol: int = 4) -> None:
    """Cam<n>/cameraIntrinsicsExtrinsics.pickle: millimetres, size as height and width, an upright board."""
    for one in cameras:
        fields = {
            "distortion": np.append(one.distortion, 0.0)[None],
            "intrinsicMat": one.K,
            "imageSize": np.array([[float(one.height_px)], [float(one.width_px)]]),
            "rotation": np.asfortranarray(one.R_camera_world @ _R_BOARD),
            "translation": 1000 * one.t_camera_world_m[:, None],
            "rotation_EulerAngles": np.zeros((3, 1)),
        }
        path = folder / one.name / "cameraIntrinsicsExtrinsics.pickle"
        path.parent.mkdir(parents=True)
        path.write_bytes(pickle.dumps(fields, protocol))
