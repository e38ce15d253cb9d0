"""A camera with lens distortion, and the same camera with every kind of lens."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from services.mocap.camera.camera import Camera

CAMERA = Camera(
    name="cam01",
    width_px=320,
    height_px=240,
    K=np.array([[260.0, 0.0, 163.0], [0.0, 262.0, 117.0], [0.0, 0.0, 1.0]]),
    distortion=np.array([-0.28, 0.09, 0.001, -0.002]),
    R_camera_world=Rotation.from_rotvec([0.1, -0.2, 0.05]).as_matrix(),
    t_camera_world_m=np.array([0.1, -0.2, 3.0]),
)
LENSES = {
    "four": CAMERA,
    "five": replace(CAMERA, distortion=np.array([-0.28, 0.09, 0.001, -0.002, 0.01])),
    "rational": replace(CAMERA, distortion=np.array([0.1, -0.05, 0.001, -0.002, 0.01, 0.35, 0.02, 0.01])),
    "fisheye": replace(CAMERA, distortion=np.array([0.05, -0.02, 0.01, -0.003]), fisheye=True),
}
