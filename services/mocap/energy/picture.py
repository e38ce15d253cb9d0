"""What the energy compares with: the input silhouettes of one frame, whole, halved or cut to windows."""

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import (
    CAMERAS_PER_PLANE,
    TriPlanes,
    camera_bit,
    n_planes,
    pack,
    unpack_classes,
)
from services.mocap.types import Bytes, Floats, Ints, Mask


@dataclass(frozen=True, eq=False)
class Region:
    """Where in each camera's whole picture a buffer lies: a window's origin, and its scale."""

    origin_px: Ints
    """(C, 2) x and y of the first pixel, in pixels of the scaled picture."""
    width_px: int
    height_px: int
    scale: float = 1.0
    """Buffer pixels per picture pixel: 1, or 0.5 at half resolution."""

    @classmethod
    def whole(cls, rig: Rig) -> "Region":
        """All of every camera's picture."""
        height_px, width_px = rig.shape_px
        return cls(np.zeros((rig.n_cameras, 2), np.int32), width_px, height_px)

    def outside(self, rig: Rig) -> Bytes:
        """Planes (P, h, w) set where a camera has no picture; only for regions at full resolution."""
        x = self.origin_px[:, 0, None] + np.arange(self.width_px)
        y = self.origin_px[:, 1, None] + np.arange(self.height_px)
        width_px, height_px = rig.sizes_px[:, 0, None], rig.sizes_px[:, 1, None]
        beyond_x, beyond_y = (x < 0) | (x >= width_px), (y < 0) | (y >= height_px)
        return pack(beyond_x[:, None, :] | beyond_y[:, :, None])

    def projections(self, rig: Rig) -> Floats:
        """(C, 3, 4) projections of world metres to this region's pixels.

        Pixel centres lie at whole coordinates, so a picture that is scaled by s maps u to s (u + 0.5) - 0.5.
        """
        to_region = np.zeros((rig.n_cameras, 3, 3))
        to_region[:, 0, 0] = to_region[:, 1, 1] = self.scale
        to_region[:, :2, 2] = 0.5 * self.scale - 0.5 - self.origin_px
        to_region[:, 2, 2] = 1.0
        return to_region @ rig.P_px_world


@dataclass(frozen=True, eq=False)
class Picture:
    """Input silhouettes in a region, and which pixels do not count."""

    region: Region
    silhouettes: Bytes
    """(P, h, w) bit-planes of the input."""
    ignored: Bytes
    """(P, h, w) bit-planes of the pixels that count for nothing: outside the picture, unsure, or
    pre-rendered."""
    unsure: Bytes | None = None
    """(P, h, w) bit-planes of unsure pixels, where the input's contour is not known; None: there are none."""
    classes: Bytes | None = None
    """(CLASS_BITS, P, h, w) bit-planes of the input's colour classes; None where none are known."""

    @cached_property
    def class_of_pixels(self) -> Bytes:
        """(C, h, w) the input's colour classes, also of pixels that do not count: a body before the others
        hides their colours. Raises ValueError without classes."""
        if self.classes is None:
            raise ValueError("classes: the picture has none")
        return unpack_classes(self.classes, len(self.region.origin_px))

    @classmethod
    def whole(cls, rig: Rig, silhouettes: Bytes, unsure: Bytes | None = None) -> "Picture":
        """All of every camera's picture, from silhouettes (P, H, W) and unsure pixels, if there are any."""
        return cls.of_region(rig, Region.whole(rig), silhouettes, unsure)

    @classmethod
    def of_frame(cls, rig: Rig, seen: TriPlanes) -> "Picture":
        """All that is seen (P, H, W) in one frame, with its colour classes."""
        return replace(cls.whole(rig, seen.silhouettes, seen.unsure), classes=seen.classes)

    @classmethod
    def of_region(
        cls, rig: Rig, region: Region, silhouettes: Bytes, unsure: Bytes | None = None
    ) -> "Picture":
        """A region at full resolution with its silhouettes (P, h, w), and as many unsure planes or None.

        A pixel that is set in both is unsure. Raises ValueError for planes of another shape.
        """
        expected = (n_planes(rig.n_cameras), region.height_px, region.width_px)
        for name, planes in (("silhouettes", silhouettes), ("unsure", unsure)):
            if planes is not None and planes.shape != expected:
                raise ValueError(f"{name}: expected shape {expected}, got {planes.shape}")
        outside = region.outside(rig)
        if unsure is None or not unsure.any():
            return cls(region, silhouettes, outside)
        return cls(region, silhouettes & ~unsure, outside | unsure, unsure=unsure)

    def ignoring(self, planes: Bytes) -> "Picture":
        """The same picture in which the pixels set in planes (P, h, w) count for nothing as well."""
        return replace(self, ignored=self.ignored | planes)

    def without_cameras(self, left_out: Collection[int]) -> "Picture":
        """The same picture in which nothing counts of some cameras, by their place in the rig."""
        if not left_out:
            return self
        ignored = np.zeros((len(self.region.origin_px), *self.silhouettes.shape[1:]), bool)
        ignored[list(left_out)] = True
        return self.ignoring(pack(ignored))

    def halved(self) -> "Picture":
        """Half resolution: a pixel is set where at least two of its four are (the paper, section 4.2).

        Without colour classes.
        """
        n_cameras = len(self.region.origin_px)
        region = Region(
            self.region.origin_px // 2, self.region.width_px // 2, self.region.height_px // 2, 0.5
        )
        return Picture(
            region,
            _halve(self.silhouettes, n_cameras, at_least=2),
            _halve(self.ignored, n_cameras, at_least=1),
            unsure=None if self.unsure is None else _halve(self.unsure, n_cameras, at_least=1),
        )

    def window(self, origin_px: Ints, width_px: int, height_px: int) -> "Picture":
        """Cut a window out, one origin per camera (C, 2) in whole-picture pixels.

        What lies outside is ignored.
        """
        size, corners = (width_px, height_px), origin_px - self.region.origin_px
        silhouettes = _cut_planes(self.silhouettes, corners, size, False)
        ignored = _cut_planes(self.ignored, corners, size, True)
        unsure = None
        if self.unsure is not None:
            cut = _cut_planes(self.unsure, corners, size, False)
            unsure = cut if cut.any() else None
        classes = self.classes
        if classes is not None:
            classes = np.array([_cut_planes(of_bit, corners, size, False) for of_bit in classes])
        region = Region(origin_px, width_px, height_px, self.region.scale)
        return Picture(region, silhouettes, ignored, unsure, classes)

    @property
    def sent_unsure(self) -> Bytes:
        """Unsure pixels as a message holds them: (P, h, w), or (0, h, w) where there is none."""
        return self.silhouettes[:0] if self.unsure is None else self.unsure

    @property
    def sent_classes(self) -> Bytes:
        """Colour classes as a message holds them: (CLASS_BITS, P, h, w), or (0, P, h, w) for none."""
        return self.silhouettes[None][:0] if self.classes is None else self.classes

    def likely(self, covered: Bytes) -> Bytes:
        """(P, h, w) counted pixels that are set, and unsure ones that a model covers (P, h, w).

        Shares are told of these: of the sure ones alone, little could seem to be much.
        """
        sure: Bytes = self.silhouettes & ~self.ignored
        return sure if self.unsure is None else sure | self.unsure & covered


def _halve(planes: Bytes, n_cameras: int, at_least: int) -> Bytes:
    height, width = (planes.shape[1] // 2) * 2, (planes.shape[2] // 2) * 2
    masks = np.array([camera_bit(planes, c)[:height, :width] for c in range(n_cameras)], np.uint8)
    counts = masks[:, ::2, ::2] + masks[:, 1::2, ::2] + masks[:, ::2, 1::2] + masks[:, 1::2, 1::2]
    return pack(counts >= at_least)


def _cut_planes(planes: Bytes, corners: Ints, size: tuple[int, int], fill: bool) -> Bytes:
    """Cut size (width, height) out of planes (P, H, W), at one corner (x, y) per camera."""
    cut = np.zeros((n_planes(len(corners)), size[1], size[0]), np.uint8)
    for c, corner in enumerate(corners):
        plane, bit = divmod(c, CAMERAS_PER_PLANE)
        cut[plane] |= _cut(camera_bit(planes, c), corner, size, fill).astype(np.uint8) << bit
    return cut


def _cut(mask: Mask, corner: Ints, size: tuple[int, int], fill: bool) -> Mask:
    """Cut size (width, height) at corner (x, y) out of a mask, filled where it reaches over the edge."""
    (x, y), (width, height) = corner, size
    window: Mask = np.full((height, width), fill)
    x0, y0 = max(x, 0), max(y, 0)
    x1, y1 = min(x + width, mask.shape[1]), min(y + height, mask.shape[0])
    if x1 > x0 and y1 > y0:
        window[y0 - y : y1 - y, x0 - x : x1 - x] = mask[y0:y1, x0:x1]
    return window
