"""Compiles in advance: `python -m services.segmentation.warm_up` fills the cache of all processes."""

import numpy as np

from services.mocap.camera.camera import Camera
from services.mocap.types import Bytes, Floats
from services.segmentation.joint import JointMatte
from services.segmentation.plate import LIGHT_UNCERTAINTY, Plate

_SIZE_PX = 96
_AWAY_M = 3.0


def warm_up() -> None:
    """Load or compile everything that segmentation needs, so that no picture waits for it."""
    cameras = [_camera(turn) for turn in (0.0, 2.0, 4.0)]
    empty: Bytes = np.random.default_rng(0).integers(90, 110, (4, _SIZE_PX, _SIZE_PX, 3)).astype(np.uint8)
    plates = [Plate.learn(empty, LIGHT_UNCERTAINTY) for _ in cameras]
    matte = JointMatte(cameras, plates)
    # The light has moved over the stage, so that bands are looked for.
    light = np.linspace(0.95, 1.05, _SIZE_PX)[:, None]
    somebody = np.rint(empty[0] * light).astype(np.uint8)
    somebody[20:80, 40:60] //= 2
    moment = dict.fromkeys(range(len(cameras)), somebody)
    matte.settle_floor([moment])
    matte.learn(moment)
    matte.conclude()
    matte.trimaps(moment)


def _camera(turn: float) -> Camera:
    """One that looks at the middle of the place from some metres away, at a heading in radians."""
    sine, cosine = float(np.sin(turn)), float(np.cos(turn))
    R: Floats = np.array([[-sine, cosine, 0.0], [0.0, 0.0, -1.0], [-cosine, -sine, 0.0]])
    K: Floats = np.array([[90.0, 0.0, 47.5], [0.0, 90.0, 47.5], [0.0, 0.0, 1.0]])
    centre: Floats = np.array([_AWAY_M * cosine, _AWAY_M * sine, 1.0])
    return Camera(f"cam{turn:.0f}", _SIZE_PX, _SIZE_PX, K, np.zeros(4), R, -R @ centre)


if __name__ == "__main__":
    warm_up()
