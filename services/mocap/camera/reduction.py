"""Reduces pictures and silhouettes to the size of a camera that was reduced (Camera.reduced)."""

import cv2
import numpy as np

from services.mocap.camera.camera import Camera
from services.mocap.camera.undistort import trimap_by_masks
from services.mocap.types import Bytes, Mask, Trimap


def reduce_picture(picture: Bytes, camera: Camera) -> Bytes:
    """A picture (H, W, 3) in the camera's size, by the mean over areas; itself if it has that size."""
    return picture if _has_size(picture, camera) else _resized(picture, camera, cv2.INTER_AREA)


def reduce_trimap(trimap: Trimap, camera: Camera) -> Trimap:
    """A trimap (H, W) in the camera's size; itself if it has that size.

    A pixel is the actor if half of its area is, and certain if that holds whatever the unsure pixels are.
    """
    return _resized_trimap(trimap, camera, cv2.INTER_AREA)


def enlarge_trimap(trimap: Trimap, camera: Camera) -> Trimap:
    """A reduced trimap (h, w) in the size of the camera's pictures, its outlines interpolated; itself if it
    has that size."""
    return _resized_trimap(trimap, camera, cv2.INTER_LINEAR)


def _resized_trimap(trimap: Trimap, camera: Camera, interpolation: int) -> Trimap:
    if _has_size(trimap, camera):
        return trimap

    def resized(mask: Mask) -> Mask:
        return np.asarray(_resized(mask.view(np.uint8) * np.uint8(255), camera, interpolation) > 127)

    return trimap_by_masks(trimap, resized)


def _resized(picture: Bytes, camera: Camera, interpolation: int) -> Bytes:
    return np.asarray(cv2.resize(picture, camera.size_px, interpolation=interpolation), np.uint8)


def _has_size(picture: Bytes, camera: Camera) -> bool:
    return picture.shape[:2] == camera.shape_px
