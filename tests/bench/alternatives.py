"""What someone would take who wants silhouettes without xormocap: pyrender off screen, and OpenCV.

Each is used in a way that gives the right picture (a test compares it with ours) at no needless cost; there
may be quicker ones.
"""

import os
from collections.abc import Iterator
from functools import cache
from typing import Any, Protocol

import cv2
import numpy as np

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import segment_transforms
from services.mocap.camera.camera import Camera
from services.mocap.energy.backend import Energy, Problem
from services.mocap.energy.bitplanes import unpack
from services.mocap.errors import UserError
from services.mocap.types import Bytes, Floats, Ints, Mask


class Silhouettes(Protocol):
    """Something that draws a posed body."""

    def masks(self, T_world_segment: Floats) -> Iterator[Mask]:
        """The silhouettes (H, W), camera by camera, of segments placed by (S, 4, 4)."""
        ...


class PyrenderSilhouettes:
    """One mesh node a segment, one off-screen rendering a camera.

    As segmentation: without lights and materials, faster than as depth, and without the smoothed edges that
    pyrender gives to depth.
    """

    def __init__(self, body: Body, cameras: tuple[Camera, ...]) -> None:
        """Raises UserError where pyrender or EGL is missing. The cameras have one size."""
        self._pyrender = _import_pyrender()
        import trimesh

        self._scene = self._pyrender.Scene()
        self._segments = [
            self._scene.add(self._pyrender.Mesh.from_trimesh(trimesh.Trimesh(v, f, process=False)))
            for v, f in zip(body.vertices_m, body.faces, strict=True)
        ]
        self._white = dict.fromkeys(self._segments, (255, 255, 255))
        self._cameras = [self._add(camera) for camera in cameras]
        self._size_px = cameras[0].width_px, cameras[0].height_px
        self._renderer = _pyrender_renderer()

    def masks(self, T_world_segment: Floats) -> Iterator[Mask]:
        """See Silhouettes.masks."""
        self._renderer.viewport_width, self._renderer.viewport_height = self._size_px
        for node, T in zip(self._segments, T_world_segment, strict=True):
            self._scene.set_pose(node, T)
        for camera in self._cameras:
            self._scene.main_camera_node = camera
            colour, _ = self._renderer.render(self._scene, self._pyrender.RenderFlags.SEG, self._white)
            yield colour[..., 0] > 0

    def _add(self, camera: Camera) -> Any:
        """A node for a camera: pyrender's look along -z with y up, and count pixels from their corners."""
        K, T_camera_world = camera.K, np.eye(4)
        T_camera_world[:3, :3], T_camera_world[:3, 3] = camera.R_camera_world, camera.t_camera_world_m
        lens = self._pyrender.IntrinsicsCamera(
            K[0, 0], K[1, 1], K[0, 2] + 0.5, K[1, 2] + 0.5, znear=0.05, zfar=50.0
        )
        return self._scene.add(lens, pose=np.linalg.inv(T_camera_world) @ np.diag([1.0, -1.0, -1.0, 1.0]))


def _import_pyrender() -> Any:
    os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
    vars(np).setdefault("infty", np.inf)  # pyrender 0.1.45 still asks for the name that numpy 2 dropped
    try:
        import pyrender
    except Exception as error:  # PyOpenGL fails in many ways where EGL is missing
        raise UserError(f"pyrender: cannot be imported: {error}") from None
    return pyrender


@cache
def _pyrender_renderer() -> Any:
    """One for the whole process, never deleted: pyrender would close EGL's display with it, under the feet of
    every other context. It forgets the meshes of one scene when it is given the next."""
    try:
        return _import_pyrender().OffscreenRenderer(32, 32)
    except UserError:
        raise
    except Exception as error:  # PyOpenGL raises what EGL reports, and bare classes
        raise UserError(f"pyrender: no off-screen rendering here: {error}") from None


class OpenCvSilhouettes:
    """Vertices projected by numpy, front faces filled one by one.

    OpenCV fills whatever a triangle touches, half a pixel too much all around. So it draws six times as
    large, and a pixel is set where the four about its centre are: what they cut off is what OpenCV added.
    """

    _SCALE = 6

    def __init__(self, body: Body, cameras: tuple[Camera, ...]) -> None:
        self._body, self._cameras = body, cameras

    def masks(self, T_world_segment: Floats) -> Iterator[Mask]:
        """See Silhouettes.masks."""
        for camera in self._cameras:
            drawn = np.zeros((self._SCALE * camera.height_px, self._SCALE * camera.width_px), np.uint8)
            for triangle in self._front_faces(T_world_segment, camera):
                cv2.fillConvexPoly(drawn, triangle, 1)
            yield self._all_about_centres(drawn)

    def _front_faces(self, T_world_segment: Floats, camera: Camera) -> Ints:
        """(F, 3, 2) whole pixels of the enlarged picture."""
        corners = []
        for T, vertices_m, faces in zip(
            T_world_segment, self._body.vertices_m, self._body.faces, strict=True
        ):
            u_px = camera.project_px(vertices_m @ T[:3, :3].T + T[:3, 3])
            corners.append(np.rint((u_px + 0.5) * self._SCALE - 0.5).astype(np.int32)[faces])
        a, b, c = np.moveaxis(np.concatenate(corners), 1, 0)
        ab, ac = b - a, c - a
        front = ab[:, 0] * ac[:, 1] < ab[:, 1] * ac[:, 0]
        return np.stack([a[front], b[front], c[front]], axis=1)

    def _all_about_centres(self, drawn: Bytes) -> Mask:
        before, behind = self._SCALE // 2 - 1, self._SCALE // 2
        rows = drawn[before :: self._SCALE] & drawn[behind :: self._SCALE]
        both: Mask = (rows[:, before :: self._SCALE] & rows[:, behind :: self._SCALE]).astype(bool)
        return both


def energy_by(silhouettes: Silhouettes, body: Body, problem: Problem) -> Energy:
    """A problem's energy by an alternative, one pose at a time: all segments in whole pictures."""
    inputs = unpack(problem.picture.silhouettes, len(problem.picture.region.origin_px))

    def evaluate(values: Floats) -> Floats:
        return np.array(
            [
                sum(
                    np.count_nonzero(given != drawn)
                    for given, drawn in zip(inputs, silhouettes.masks(T), strict=True)
                )
                for T in segment_transforms(problem.poses(values), body.offsets_m)
            ],
            np.float64,
        )

    return evaluate
