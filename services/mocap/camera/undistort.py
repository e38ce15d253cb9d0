"""Converts raw pictures and silhouettes to those of the camera's pinhole, and to the camera's size."""

from collections.abc import Callable

import cv2
import numpy as np

from services.mocap.camera.camera import Camera
from services.mocap.types import ACTOR, BACKGROUND, UNSURE, Bytes, Floats, Ints, Mask, Trimap

SOLVED_UNTIL = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-9)
"""OpenCV's default of five rounds leaves tens of pixels at the corners of a wide lens."""
_NO_FRACTIONS = np.zeros((0, 0), np.uint16)
"""The second map of cv2.remap where the first one has whole pixels."""


class Undistorter:
    """Undoes one camera's lens distortion; the results belong to `camera.undistorted()`.

    Outside the raw picture's border, pictures are black and silhouettes empty.
    A pinhole camera's pictures are returned as they are, uncopied.
    """

    def __init__(self, camera: Camera) -> None:
        self._shape = camera.shape_px
        self._name = camera.name
        self._maps: tuple[np.ndarray, np.ndarray] | None = None
        if camera.fisheye or np.any(camera.distortion):
            # fixed-point maps: three times as fast, and exact to 1/32 pixel
            self._maps = undistortion_maps(camera, cv2.CV_16SC2)
            # which rows of a raw picture each new row takes from, first and last; likewise columns
            whole_px = self._maps[0].astype(np.int32)
            fractions = self._maps[1][..., None] >> np.array([0, 5], np.uint16) & 31  # in 1/32 pixel, x and y
            self._nearest_px = (whole_px + (fractions >= 16)).astype(np.int16)
            self._rows_of = whole_px[..., 1].min(axis=1), whole_px[..., 1].max(axis=1) + 1
            self._columns_of = whole_px[..., 0].min(axis=0), whole_px[..., 0].max(axis=0) + 1

    def image(self, bgr: Bytes) -> Bytes:
        """(H, W, 3) picture, linearly interpolated; raises ValueError when it has not the camera's size."""
        self._check(bgr)
        if self._maps is None:
            return bgr
        return np.asarray(cv2.remap(bgr, *self._maps, cv2.INTER_LINEAR), np.uint8)

    def numbers(self, picture: Bytes) -> Bytes:
        """(H, W) picture of numbers, each that of the nearest raw pixel; raises as image does."""
        self._check(picture)
        if self._maps is None:
            return picture
        return np.asarray(cv2.remap(picture, self._nearest_px, _NO_FRACTIONS, cv2.INTER_NEAREST), np.uint8)

    def mask(self, silhouette: Mask) -> Mask:
        """(H, W) silhouette; its outline is interpolated, then cut at one half. Raises as image does."""
        self._check(silhouette)
        if self._maps is None:
            return silhouette
        undistorted: Mask = np.zeros(self._shape, np.bool_)
        left, top, across, down = cv2.boundingRect(silhouette.view(np.uint8))
        rows, columns = _taking(self._rows_of, top, down), _taking(self._columns_of, left, across)
        if across and rows.stop and columns.stop:
            whole, fraction = (part[rows, columns] for part in self._maps)
            weight = cv2.remap(silhouette.astype(np.uint8) * 255, whole, fraction, cv2.INTER_LINEAR)
            undistorted[rows, columns] = weight > 127
        return undistorted

    def trimap(self, trimap: Trimap) -> Trimap:
        """(H, W) trimap; a pixel is certain if `mask` gives the same result whatever the unsure pixels are.

        Raises as image does.
        """
        self._check(trimap)
        if self._maps is None:
            return trimap
        return trimap_by_masks(trimap, self.mask)

    def _check(self, picture: Bytes | Mask) -> None:
        if picture.shape[:2] != self._shape:
            raise ValueError(
                f"{self._name}: expected a picture of (height, width) {self._shape}, got {picture.shape[:2]}"
            )


def trimap_by_masks(trimap: Trimap, change: Callable[[Mask], Mask]) -> Trimap:
    """What a change of masks makes of a trimap (H, W): unsure where it depends on what unsure pixels are."""
    actor = change(trimap == ACTOR)
    changed: Trimap = np.where(actor, np.uint8(ACTOR), np.uint8(BACKGROUND))
    if (trimap == UNSURE).any():
        changed[change(trimap != BACKGROUND) & ~actor] = UNSURE
    return changed


def reduce_picture(picture: Bytes, camera: Camera) -> Bytes:
    """A picture (H, W, 3) in the camera's size, by the mean over areas; itself if it has that size."""
    return picture if picture.shape[:2] == camera.shape_px else _resized(picture, camera, cv2.INTER_AREA)


def resized_trimap(trimap: Trimap, camera: Camera) -> Trimap:
    """A trimap (H, W) in the camera's size; itself if it has that size.

    A larger one is reduced: a pixel is the actor if half of its area is, and certain if that holds whatever
    the unsure pixels are. A smaller one is enlarged: its outlines are interpolated.
    """
    if trimap.shape == camera.shape_px:
        return trimap
    by = cv2.INTER_AREA if trimap.size > camera.width_px * camera.height_px else cv2.INTER_LINEAR

    def resized(mask: Mask) -> Mask:
        return np.asarray(_resized(mask.view(np.uint8) * np.uint8(255), camera, by) > 127)

    return trimap_by_masks(trimap, resized)


def undistortion_maps(camera: Camera, kind: int) -> tuple[np.ndarray, np.ndarray]:
    """Where each undistorted pixel lies in the raw picture: OpenCV's two maps of a kind, such as CV_32FC1."""
    make = cv2.fisheye.initUndistortRectifyMap if camera.fisheye else cv2.initUndistortRectifyMap
    return make(camera.K, camera.distortion, np.eye(3), camera.K, camera.size_px, kind)


def undistorted_px(camera: Camera, raw_px: Floats, K: Floats | None = None) -> Floats:
    """(N, 2) raw pixels to those of a pinhole (3, 3), by default the camera's."""
    onto = camera.K if K is None else K
    if camera.fisheye:
        pixels = cv2.fisheye.undistortPoints(raw_px[:, None], camera.K, camera.distortion, P=onto)
    else:
        pixels = cv2.undistortPoints(
            raw_px[:, None], camera.K, camera.distortion, P=onto, criteria=SOLVED_UNTIL
        )
    return np.asarray(pixels, np.float64).reshape(-1, 2)


def _resized(picture: Bytes, camera: Camera, interpolation: int) -> Bytes:
    return np.asarray(cv2.resize(picture, camera.size_px, interpolation=interpolation), np.uint8)


def _taking(of: tuple[Ints, Ints], begin: int, size: int) -> slice:
    """The rows or columns that take from some of a raw picture; slice(0, 0) where none does."""
    first, last = of
    taking = np.flatnonzero((first < begin + size) & (last >= begin))
    return slice(int(taking[0]), int(taking[-1]) + 1) if taking.size else slice(0, 0)
