"""Classic chessboards by both of OpenCV's detectors."""

import cv2
import numpy as np

from board_stage import distorted_px, look, picture, ring, shown_to_neighbours
from services.mocap.calibration.board import Board
from services.mocap.calibration.detection import Detector
from services.mocap.types import Bytes

CHESS = Board(kind="chessboard", columns=5, rows=8, square_m=0.2)


def with_glare(shown: Bytes) -> Bytes:
    """The reflection of a lamp in the middle of the picture, in which black is nearly white."""
    height_px, width_px = shown.shape[:2]
    y, x = np.indices((height_px, width_px))
    away_px = np.hypot(x - width_px / 2, y - height_px / 2)
    lamp = 200 * np.exp(-0.5 * (away_px / (0.1 * width_px)) ** 2)
    return np.clip(shown + lamp[..., None], 0, 255).astype(np.uint8)


def test_the_older_detector_finds_chessboards_in_glare_where_the_newer_does_not() -> None:
    rng = np.random.default_rng(5)
    cameras = ring(2, 640, 480, rng, of=8)
    n_shown, n_newer, off_px = 0, 0, []
    for pose, _ in shown_to_neighbours(cameras, CHESS, 8, rng, closed=False).moments:
        whole = look(cameras[0], CHESS, pose, 0.0, rng)
        if whole is None or len(whole.corners) < CHESS.n_corners:
            continue
        shown = with_glare(picture(cameras[0], CHESS, pose, rng))
        flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_ACCURACY
        n_shown, n_newer = n_shown + 1, n_newer + cv2.findChessboardCornersSB(shown, (4, 7), flags=flags)[0]
        found = Detector(CHESS).find(shown)
        if found is not None:
            true_px = distorted_px(cameras[0], pose.apply(CHESS.corners_m))
            off_px.append(np.linalg.norm(found.points_px - true_px[found.corners], axis=1).max())
            assert len(found.corners) > 0.8 * CHESS.n_corners
    assert n_newer <= 1
    assert len(off_px) > n_shown / 2
    assert max(off_px) < 1.0
