"""Bit-plane buffers: the silhouettes of up to eight cameras in the bits of one byte image.

Camera c stands in bit c % 8 of plane c // 8, so that any number of cameras makes a (P, H, W) buffer.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from services.mocap.types import ACTOR, BACKGROUND, UNSURE, Bytes, Ints, Mask, Trimap

_Pixel = TypeVar("_Pixel", np.bool_, np.uint8)
CAMERAS_PER_PLANE = 8
FULL_SHARE = 0.75
"""Share of a picture; a silhouette that covers more cannot be an actor's."""
_SAMPLED_PX = 8
"""Distance of the pixels that tell how much of a picture is white."""
CLASS_BITS = 3
"""Buffers that hold a colour class, a number from 0 to 7, of every pixel."""
_BITS: Ints = (np.arange(256)[:, None] >> np.arange(CAMERAS_PER_PLANE) & 1).astype(np.int32)
"""(256, 8) the bits of every byte."""


def n_planes(n_cameras: int) -> int:
    """How many bit-plane buffers hold that many cameras."""
    return -(-n_cameras // CAMERAS_PER_PLANE)


def pack(masks: Mask | Sequence[Mask]) -> Bytes:
    """Pack masks (C, H, W) into planes (P, H, W)."""
    planes: Bytes = np.zeros((n_planes(len(masks)), *masks[0].shape), np.uint8)
    for c, mask in enumerate(masks):
        # Bytes are multiplied by vector instructions, but shifted one by one.
        planes[c // CAMERAS_PER_PLANE] |= mask * np.uint8(1 << c % CAMERAS_PER_PLANE)
    return planes


def unpack(planes: Bytes, n_cameras: int) -> Mask:
    """Unpack planes (P, H, W) into masks (C, H, W)."""
    return np.array([camera_bit(planes, c) for c in range(n_cameras)], bool)


def pack_classes(classes: Bytes) -> Bytes:
    """Pack colour classes (C, H, W) into planes (CLASS_BITS, P, H, W), the lowest bit first."""
    return np.array([pack((classes >> bit & 1).astype(bool)) for bit in range(CLASS_BITS)])


def unpack_classes(planes: Bytes, n_cameras: int) -> Bytes:
    """Unpack planes (CLASS_BITS, P, H, W) into colour classes (C, H, W)."""
    classes: Bytes = np.zeros((n_cameras, *planes.shape[2:]), np.uint8)
    for bit, of_bit in enumerate(planes):
        for c in range(n_cameras):
            classes[c] |= camera_bit(of_bit, c) * np.uint8(1 << bit)
    return classes


@dataclass(frozen=True, eq=False)
class TriPlanes:
    """Trimaps of any number of cameras, packed into two buffers (P, H, W) that have no bit in common.

    Of several frames they are (F, P, H, W), and an index chooses some of these.
    """

    silhouettes: Bytes
    """What is surely actor."""
    unsure: Bytes
    """Unsure pixels."""
    classes: Bytes | None = None
    """(CLASS_BITS, P, H, W) colour classes of actor pixels, of a single frame; None where none are known."""

    @classmethod
    def sure(cls, silhouettes: Bytes) -> "TriPlanes":
        """Silhouettes (P, H, W) without an unsure pixel."""
        return cls(silhouettes, np.zeros_like(silhouettes))

    @classmethod
    def of_frames(cls, frames: Sequence["TriPlanes"]) -> "TriPlanes":
        """Those of several frames in one."""
        return cls(np.array([one.silhouettes for one in frames]), np.array([one.unsure for one in frames]))

    @classmethod
    def of_sent(cls, planes: Bytes, unsure: Bytes, classes: Bytes) -> "TriPlanes":
        """What a message holds: planes (P, H, W), and as many of unsure pixels, which win, or none; classes
        (CLASS_BITS, P, H, W) or (0, P, H, W)."""
        sure = cls(planes & ~unsure, unsure) if len(unsure) else cls.sure(planes)
        return replace(sure, classes=classes) if len(classes) else sure

    def __len__(self) -> int:
        return len(self.silhouettes)

    def __getitem__(self, frames: int | Ints) -> "TriPlanes":
        return TriPlanes(self.silhouettes[frames], self.unsure[frames])

    def doubting_failed(self, sizes_px: Ints) -> "TriPlanes":
        """The same frame (P, H, W), in which a camera that shows nobody, or is white nearly all over, is all
        unsure if two others show somebody: the actor is out of its sight, or its silhouettes failed.

        sizes_px: (C, 2) width and height of each camera's pictures.
        """
        shown = np.bitwise_or.reduce(self.silhouettes, axis=(1, 2))
        has_failed = np.array([not camera_bit(shown, c) for c in range(len(sizes_px))])
        sampled = self.silhouettes[:, ::_SAMPLED_PX, ::_SAMPLED_PX]
        for c, (width_px, height_px) in enumerate(sizes_px):
            white_px = _SAMPLED_PX**2 * np.count_nonzero(camera_bit(sampled, c))
            has_failed[c] |= white_px > FULL_SHARE * width_px * height_px
        if not has_failed.any() or len(sizes_px) - has_failed.sum() < 2:
            return self
        shape_px = self.silhouettes.shape[1:]
        doubted = pack(np.broadcast_to(has_failed[:, None, None], (len(sizes_px), *shape_px)))
        return self.doubting(doubted)

    def doubting(self, doubted: Bytes) -> "TriPlanes":
        """The same frame (P, H, W), in which further pixels (P, H, W) are unsure."""
        classes = None if self.classes is None else self.classes & ~doubted
        return TriPlanes(self.silhouettes & ~doubted, self.unsure | doubted, classes)

    @property
    def possible(self) -> Bytes:
        """What may be actor."""
        return self.silhouettes | self.unsure

    @property
    def sent_unsure(self) -> Bytes:
        """Unsure pixels as a message holds them: (P, H, W), or (0, H, W) where there is none."""
        return self.unsure if self.unsure.any() else self.unsure[:0]

    @property
    def sent_classes(self) -> Bytes:
        """Colour classes as a message holds them: (CLASS_BITS, P, H, W), or (0, P, H, W) where there are
        none."""
        return self.silhouettes[None][:0] if self.classes is None else self.classes


def pack_trimaps(trimaps: Sequence[Trimap] | Trimap) -> TriPlanes:
    """Pack trimaps (C, H, W)."""
    return TriPlanes(pack([one == ACTOR for one in trimaps]), pack([one == UNSURE for one in trimaps]))


def unpack_trimaps(planes: TriPlanes, n_cameras: int) -> Trimap:
    """Unpack planes (P, H, W) into trimaps (C, H, W)."""
    unsure = np.where(unpack(planes.unsure, n_cameras), UNSURE, BACKGROUND)
    return np.where(unpack(planes.silhouettes, n_cameras), ACTOR, unsure).astype(np.uint8)


def joined(sources: Sequence[tuple[TriPlanes, int]]) -> TriPlanes:
    """Planes of cameras that stand in different ones: in which, and at which place there, for each camera."""
    silhouettes = pack([camera_bit(planes.silhouettes, place) for planes, place in sources])
    unsure = np.zeros_like(silhouettes)
    if any(planes.unsure.any() for planes in {id(planes): planes for planes, _ in sources}.values()):
        unsure = pack([camera_bit(planes.unsure, place) for planes, place in sources])
    if all(planes.classes is None for planes, _ in sources):
        return TriPlanes(silhouettes, unsure)
    nothing = np.zeros(silhouettes.shape[1:], bool)
    classes = [
        pack([nothing if p.classes is None else camera_bit(p.classes[k], at) for p, at in sources])
        for k in range(CLASS_BITS)
    ]
    return TriPlanes(silhouettes, unsure, np.array(classes))


def fit_together(
    planes: Bytes, unsure: Bytes, classes: Bytes, n_cameras: int, shape_px: tuple[int, int]
) -> bool:
    """Whether the planes of a message, its unsure ones and those of classes match this number of cameras."""
    expected = (n_planes(n_cameras), *shape_px)
    fits = planes.shape == expected and unsure.shape in (expected, (0, *shape_px))
    return fits and classes.shape in ((0, *expected), (CLASS_BITS, *expected))


def trimap_of(silhouette: Mask) -> Trimap:
    """The trimap (H, W) of a silhouette (H, W) without an unsure pixel."""
    return np.multiply(silhouette.view(np.uint8), ACTOR, dtype=np.uint8)


def camera_bit(planes: Bytes, camera: int) -> Mask:
    """The mask (H, W) of one camera in planes (P, H, W)."""
    is_set: Mask = planes[camera // CAMERAS_PER_PLANE] & np.uint8(1 << camera % CAMERAS_PER_PLANE) != 0
    return is_set


def count_bits(planes: Bytes) -> int:
    """The number of set bits."""
    return int(np.bitwise_count(planes).sum())


def count_by_camera(planes: Bytes, n_cameras: int) -> Ints:
    """The number of set pixels (C,) of each camera in planes (P, H, W)."""
    counts = [np.bincount(plane[plane != 0], minlength=len(_BITS)) @ _BITS for plane in planes]
    return np.concatenate(counts)[:n_cameras].astype(np.int32)


def in_common_size(picture: NDArray[_Pixel], width_px: int, height_px: int) -> NDArray[_Pixel]:
    """A mask or trimap (h, w) in the upper left of an empty one, for cameras of different sizes."""
    if picture.shape == (height_px, width_px):
        return picture
    padded = np.zeros((height_px, width_px), picture.dtype)
    padded[: picture.shape[0], : picture.shape[1]] = picture
    return padded
