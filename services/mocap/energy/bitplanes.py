"""Bit-plane buffers: the silhouettes of up to eight cameras in the bits of one byte image.

Camera c stands in bit c % 8 of plane c // 8, so that any number of cameras makes a (P, H, W) buffer.
"""

import numpy as np

from services.mocap.types import Bytes, Ints, Mask

CAMERAS_PER_PLANE = 8
_BITS: Ints = (np.arange(256)[:, None] >> np.arange(CAMERAS_PER_PLANE) & 1).astype(np.int32)
"""(256, 8) the bits of every byte."""


def n_planes(n_cameras: int) -> int:
    """How many bit-plane buffers hold that many cameras."""
    return -(-n_cameras // CAMERAS_PER_PLANE)


def pack(masks: Mask) -> Bytes:
    """Pack masks (C, H, W) into planes (P, H, W)."""
    planes: Bytes = np.zeros((n_planes(len(masks)), *masks.shape[1:]), np.uint8)
    for c, mask in enumerate(masks):
        planes[c // CAMERAS_PER_PLANE] |= mask.astype(np.uint8) << c % CAMERAS_PER_PLANE
    return planes


def unpack(planes: Bytes, n_cameras: int) -> Mask:
    """Unpack planes (P, H, W) into masks (C, H, W)."""
    return np.array([camera_bit(planes, c) for c in range(n_cameras)], bool)


def camera_bit(planes: Bytes, camera: int) -> Mask:
    """The mask (H, W) of one camera in planes (P, H, W)."""
    bit: Bytes = planes[camera // CAMERAS_PER_PLANE] >> (camera % CAMERAS_PER_PLANE) & 1
    return bit.astype(bool)


def count_bits(planes: Bytes) -> int:
    """The number of set bits."""
    return int(np.bitwise_count(planes).sum())


def count_by_camera(planes: Bytes, n_cameras: int) -> Ints:
    """The number of set pixels (C,) of each camera in planes (P, H, W)."""
    counts = [np.bincount(plane[plane != 0], minlength=len(_BITS)) @ _BITS for plane in planes]
    return np.concatenate(counts)[:n_cameras].astype(np.int32)
