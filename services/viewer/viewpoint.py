"""Where the 3D view's camera stands to have everything in view, and how it follows the actor."""

import time

import numpy as np
import viser

from services.mocap.body.kinematics import joint_positions
from services.mocap.types import Floats
from services.viewer.show import Show, frusta_of
from services.viewer.solved_frame import SolvedFrame

FOV_RAD = 0.9
_BESIDE_RAD, _ABOVE_RAD = 0.6, 0.35
"""The viewpoint is beside the direction that the actor faces, and above."""
_MARGIN = 1.1
_REACH_M = 0.25
"""From a camera to the far end of its frustum; from a joint to the skin it is less."""
_WAYPOINTS = 17
_SETTLING_S, _OTHER_SHAPE = 3.0, 0.02


def viewpoint_of(
    points_m: Floats, reach_m: float, heading_rad: float, aspect: float
) -> tuple[Floats, Floats]:
    """The nearest viewpoint (3,) from a direction that has all points in view, and what it looks at (3,).

    points_m: (N, 3). reach_m: radius around each point that is in view too. heading_rad: from where it looks,
    about z. aspect: width over height of the view.
    """
    back = np.array([
        np.cos(heading_rad) * np.cos(_ABOVE_RAD), np.sin(heading_rad) * np.cos(_ABOVE_RAD), np.sin(_ABOVE_RAD)
    ])  # fmt: skip
    right = np.array([-np.sin(heading_rad), np.cos(heading_rad), 0.0])
    up = np.cross(back, right)
    middle_m = 0.5 * (points_m.min(axis=0) + points_m.max(axis=0))
    offsets_m = points_m - middle_m
    tan_up = np.tan(0.5 * FOV_RAD)
    half_m = np.maximum(
        (np.abs(offsets_m @ right) + reach_m) / (tan_up * aspect), (np.abs(offsets_m @ up) + reach_m) / tan_up
    )
    away_m = float((_MARGIN * half_m + offsets_m @ back).max())
    return middle_m + away_m * back, middle_m


class ViewpointControl:
    """Moves one browser's viewpoint."""

    def __init__(self, camera: viser.CameraHandle, show: Show) -> None:
        self._camera, self._show = camera, show
        self._cameras_m = np.array([frustum.position_m for frustum in frusta_of(show.rig)])
        self._followed_m: Floats | None = None
        self._framed: tuple[Floats, SolvedFrame, float, float] | None = None
        """What was last put into view: points (N, 3), a frame, the view's aspect, and when."""

    def frame_actor(self, solved: SolvedFrame) -> None:
        """The actor fills the view."""
        self._go(self._joints_m([solved.pose]), solved)

    def frame_all(self, solved: SolvedFrame) -> None:
        """The actor's whole way, as far as it is known, and all cameras are in view."""
        history = self._show.history
        start = history.frames.start
        some = np.linspace(start, history.newest or start, _WAYPOINTS).astype(int).tolist()
        known = [found.pose for found in map(history.solved, some) if found is not None]
        self._go(
            np.concatenate([self._joints_m([solved.pose, *known]), self._cameras_m.reshape(-1, 3)]), solved
        )

    def _joints_m(self, poses: list[Floats]) -> Floats:
        """(N * J, 3) joint centres of N poses (D,)."""
        return joint_positions(np.array(poses), self._show.body.offsets_m).reshape(-1, 3)

    def _go(self, points_m: Floats, solved: SolvedFrame) -> None:
        heading_rad = float(solved.pose[3]) + _BESIDE_RAD
        aspect = float(self._camera.aspect)
        eye_m, look_at_m = viewpoint_of(points_m, _REACH_M, heading_rad, aspect)
        self._camera.position, self._camera.look_at = eye_m, look_at_m
        self._camera.fov = FOV_RAD
        self._framed = points_m, solved, aspect, time.monotonic()

    def refit(self) -> None:
        """Frame the same once more if the view's shape has changed soon afterwards, as while a page is laid
        out."""
        if self._framed is None:
            return
        points_m, solved, aspect, at_s = self._framed
        if time.monotonic() - at_s > _SETTLING_S:
            self._framed = None
        elif abs(float(self._camera.aspect) / aspect - 1) > _OTHER_SHAPE:
            self._go(points_m, solved)

    def follow(self, solved: SolvedFrame, wanted: bool) -> None:
        """Move with the actor over the floor, while that is wanted."""
        at_m = solved.pose[:3] * (1.0, 1.0, 0.0)
        if wanted and self._followed_m is not None and not np.allclose(at_m, self._followed_m):
            self._camera.position = self._camera.position + (at_m - self._followed_m)
        self._followed_m = at_m
