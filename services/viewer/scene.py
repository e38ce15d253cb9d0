"""The 3D scene of one browser: body, cameras, floor, trails."""

from collections.abc import Sequence

import numpy as np
import viser

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import SEGMENT_JOINTS, joint_positions
from services.mocap.body.skeleton import DOFS, JOINT_INDEX, SEGMENT_JOINT, SEGMENT_NAMES, SEGMENT_PARENTS
from services.mocap.export.tiles import CENTRE_BGR, LEFT_BGR, RIGHT_BGR
from services.mocap.search.error_by_part import SEGMENT_PARTS
from services.mocap.take.marks import doubtful_parts
from services.mocap.types import Bytes, Floats, Mask
from services.viewer.show import Show, frusta_of, placed_segments
from services.viewer.solved_frame import SolvedFrame

DISTRUSTED_RGB = (214, 69, 69)
_DOUBTFUL_OPACITY = 0.4
_FRUSTUM_M = 0.2
_FLOOR_M = 8.0
TRAILS = ("left_wrist", "right_wrist", "left_ankle", "right_ankle")
_TURNING = [s for s, joint in enumerate(SEGMENT_JOINT.values()) if any(dof.joint == joint for dof in DOFS)]
"""Segments whose joint has parameters."""
_SKY_RGB, _GROUND_RGB = (255, 255, 255), (150, 150, 160)
_NO_LINE = np.zeros((1, 2, 3), np.float32)


def rgb_of(name: str) -> tuple[int, int, int]:
    """The colour of a joint or segment, by its side, as in the pictures."""
    bgr = LEFT_BGR if name.startswith("left_") else RIGHT_BGR if name.startswith("right_") else CENTRE_BGR
    return bgr[2], bgr[1], bgr[0]


class Scene3D:
    """A show's scene in one browser; every method sends only what has changed."""

    def __init__(self, scene: viser.SceneApi, show: Show) -> None:
        self._show = show
        # Light from above instead of an environment map, which would take most of the drawing time without a
        # GPU.
        scene.configure_environment_map(hdri=None)
        scene.add_light_hemisphere("/sky", sky_color=_SKY_RGB, ground_color=_GROUND_RGB, intensity=1.2)
        scene.add_grid(
            "/floor", _FLOOR_M, _FLOOR_M, cell_size=0.5, section_size=1.0, cell_color=(215, 220, 226),
            section_color=(170, 178, 187), plane_color=(244, 246, 248), plane_opacity=1.0,
        )  # fmt: skip
        scene.add_frame("/axes", axes_length=0.4, axes_radius=0.008, show_axes=True)
        self._segments = self._add_body(scene, show.body)
        self._red: Mask = np.zeros(len(SEGMENT_NAMES), bool)
        self._frusta = [
            scene.add_camera_frustum(
                f"/cameras/{name}", lens.fov_rad, lens.aspect, scale=_FRUSTUM_M, thickness=0.008,
                color=(60, 72, 88), wxyz=lens.wxyz, position=lens.position_m, cast_shadow=False,
            )
            for name, lens in zip(
                show.camera_names, frusta_of(show.rig), strict=True
            )
        ]  # fmt: skip
        self._trails = [
            scene.add_line_segments(f"/trails/{name}", _NO_LINE, rgb_of(name), thickness=0.012, visible=False)
            for name in TRAILS
        ]

    @staticmethod
    def _add_body(scene: viser.SceneApi, body: Body) -> "list[viser.MeshHandle]":
        """The segments, each attached to its parent, so that little data is sent per pose."""
        offsets_m, paths = body.offsets_m[SEGMENT_JOINTS], dict[str | None, str]({None: "/body"})
        segments = []
        for s, name in enumerate(SEGMENT_NAMES):
            paths[name] = f"{paths[SEGMENT_PARENTS[name]]}/{name}"
            segments.append(
                scene.add_mesh_simple(
                    paths[name], *body.shown[s], color=rgb_of(name),
                    position=offsets_m[s], visible=s > 0,
                )
            )  # fmt: skip
        return segments

    def place(self, solved: SolvedFrame) -> None:
        """Show a frame's pose; doubtful parts are red, and transparent, so that colour is not needed."""
        (wxyz, root_m), pelvis = placed_segments(self._show.body, solved.pose), self._segments[0]
        for s in _TURNING:
            self._segments[s].wxyz = wxyz[s]
        pelvis.position = root_m
        if not pelvis.visible:  # and with it all others
            pelvis.visible = True
        red = doubtful_parts(solved.distrusted)[SEGMENT_PARTS]
        for s in np.flatnonzero(red != self._red).tolist():
            self._segments[s].color = DISTRUSTED_RGB if red[s] else rgb_of(SEGMENT_NAMES[s])
            self._segments[s].opacity = _DOUBTFUL_OPACITY if red[s] else None
        self._red = red

    def show_picture(self, camera: int, picture_rgb: Bytes) -> None:
        """Show a picture (h, w, 3) in a camera's frustum."""
        self._frusta[camera].image = picture_rgb

    def show_cameras(self, visible: bool) -> None:
        """Show or hide all frusta."""
        for frustum in self._frusta:
            if frustum.visible != visible:
                frustum.visible = visible

    def trail(self, poses: Sequence[Floats]) -> None:
        """Draw where wrists and ankles went in poses, in order; fewer than two: no trails."""
        if len(poses) < 2:
            for line in self._trails:
                if line.visible:
                    line.visible = False
            return
        joints_m = joint_positions(np.array(poses), self._show.body.offsets_m)
        for name, line in zip(TRAILS, self._trails, strict=True):
            way_m = joints_m[:, JOINT_INDEX[name]]
            line.points = np.stack([way_m[:-1], way_m[1:]], axis=1).astype(np.float32)
            line.visible = True
