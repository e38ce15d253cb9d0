"""Calibrations for other tools."""

from pathlib import Path

import cv2
import numpy as np
import tomli_w

from services.mocap.atomic import atomic_file, atomic_folder
from services.mocap.camera.calibration import Up, write_calibration
from services.mocap.camera.camera import R_ZUP_YUP, Camera


def write_pose2sim(path: Path, cameras: tuple[Camera, ...], up: Up) -> None:
    """One TOML file in the layout of xormocap, Pose2Sim and anipose; cameras in the internal z-up world."""
    write_calibration(path, cameras, up)
    metadata = tomli_w.dumps({"metadata": {"adjusted": False, "error": 0.0}})
    with atomic_file(path) as part:
        part.write_text(f"{path.read_text(encoding='utf-8')}\n{metadata}", encoding="utf-8")


def write_opencv(folder: Path, cameras: tuple[Camera, ...], up: Up) -> None:
    """A folder with a YAML file of OpenCV's FileStorage per camera; R and T transform from world to
    camera."""
    if up == "y":
        cameras = tuple(camera.with_world_turned(R_ZUP_YUP.T) for camera in cameras)
    with atomic_folder(folder) as part:
        for camera in cameras:
            storage = cv2.FileStorage(str(part / f"{camera.name}.yml"), cv2.FILE_STORAGE_WRITE)
            storage.write("image_width", camera.width_px)
            storage.write("image_height", camera.height_px)
            storage.write("camera_matrix", camera.K)
            storage.write("distortion_coefficients", np.asarray(camera.distortion)[None])
            storage.write("R", camera.R_camera_world)
            storage.write("T", camera.t_camera_world_m[:, None])
            storage.write("fisheye", int(camera.fisheye))
            storage.release()
