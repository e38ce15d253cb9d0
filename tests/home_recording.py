"""What somebody records who follows the pages: a board moved about before two cameras, an empty room, a walk.

Squares of the board are SQUARE_M wide: pictures are small, so the board is large, and what is calibrated with
the pages' board is a model of the room.
"""

import shutil
from pathlib import Path

import numpy as np

from board_stage import shown_to_neighbours, write_clips
from services.mocap.calibration.board import Board
from services.mocap.camera.camera import Camera
from services.mocap.synth.take import write_synthetic_take
from services.mocap.take.folder import open_take

SQUARE_M = 0.4
_MOMENTS, _FRAMES = 14, 45


def record(folder: Path) -> tuple[Camera, ...]:
    """Write clips/, empty/ and walk-*.mp4 into a folder; returns the cameras that recorded them."""
    take = folder / "made"
    write_synthetic_take(take, motion="walk", n_cameras=4, n_frames=_FRAMES)
    cameras = open_take(take).cameras[:2]
    (folder / "empty").mkdir()
    for camera in cameras:
        (take / f"background/{camera.name}.mp4").rename(folder / f"empty/{camera.name}.mp4")
        (take / f"videos/{camera.name}.mp4").rename(folder / f"walk-{camera.name}.mp4")
    shutil.rmtree(take)
    board = Board(columns=5, rows=7, square_m=SQUARE_M, dictionary="4x4_50")
    rng = np.random.default_rng(4)
    scene = shown_to_neighbours(list(cameras), board, _MOMENTS, rng, closed=False)
    write_clips(folder / "clips", scene, rng)
    return cameras
