"""What every way to make silhouettes has in common: of one picture, of a moment, of a take frame by frame."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Protocol

import cv2
import numpy as np

from services.mocap.camera.camera import Camera
from services.mocap.camera.undistort import Undistorter
from services.mocap.energy.bitplanes import TriPlanes, in_common_size, pack_classes, pack_trimaps
from services.mocap.side_by_side import side_by_side
from services.mocap.take.folder import Take
from services.mocap.types import ACTOR, BACKGROUND, UNSURE, Bytes, Mask, Trimap
from services.segmentation.cleanup import box_of
from services.segmentation.colour_classes import classes_of
from services.segmentation.kept_trimaps import KeptTrimaps
from services.segmentation.lenses import Lenses
from services.segmentation.voxels import MISS, MORE_MISS, VoxelGrid

_LEAST_OTHERS = 3
"""One of the other cameras may miss an object, and two must agree on its position."""
_SUPPORTED = 0.25
"""Share of a blob's area that the others must leave room for; the actor's parts have most of theirs."""


class Matte(Protocol):
    """Segments one camera's pictures, each independently."""

    def trimap(self, image_bgr: Bytes, /) -> Trimap:
        """The actor in a raw picture (H, W, 3) BGR uint8: a trimap (H, W)."""
        ...


class GroupMatte(Protocol):
    """Segments the pictures that several cameras took at one moment."""

    def trimaps(self, images_bgr: Mapping[int, Bytes], /) -> dict[int, Trimap]:
        """The actor in raw pictures (H, W, 3) by the camera's place: trimaps (H, W). Cameras may be
        missing."""
        ...

    @property
    def moved(self) -> list[Mask]:
        """Per camera (H, W): where an object was added or removed since the plate was recorded, if this looks
        for some."""
        ...

    @property
    def blind(self) -> list[Mask]:
        """Per camera (H, W): where something seems to hide the actor, whom nearly all others see along these
        rays, if this looks for that."""
        ...


class SeparateMattes:
    """A matte for each camera, none of which knows of the others; blobs that only one camera sees go."""

    def __init__(self, cameras: Sequence[Camera], mattes: Sequence[Matte]) -> None:
        self._mattes = list(mattes)
        has_enough = len(cameras) > _LEAST_OTHERS
        self._voxels = VoxelGrid.of(cameras, Lenses.of(cameras), 0.0) if has_enough else None
        self.moved: list[Mask] = [np.zeros(camera.shape_px, np.bool_) for camera in cameras]
        self.blind = self.moved

    def trimaps(self, images_bgr: Mapping[int, Bytes], /) -> dict[int, Trimap]:
        """See GroupMatte.trimaps: without blobs that no other camera supports.

        Blobs consist of certain actor pixels; other cameras' unsure pixels leave room, and are not changed. A
        picture with at most one blob is not changed, nor one in which no blob is supported, because the
        calibration may be wrong.
        """
        trimaps = {c: self._mattes[c].trimap(image) for c, image in images_bgr.items()}
        blobs = {
            c: cv2.connectedComponents((trimap == ACTOR).view(np.uint8)) for c, trimap in trimaps.items()
        }
        if self._voxels is None or len(trimaps) <= _LEAST_OTHERS or all(n <= 2 for n, _ in blobs.values()):
            return trimaps
        width, height = self._voxels.lenses.sizes_px.max(axis=0)
        misses = np.full((len(self._mattes), height, width), MISS, np.uint8)
        for c, trimap in trimaps.items():
            misses[c, : trimap.shape[0], : trimap.shape[1]] = np.where(trimap == BACKGROUND, MISS, 0)
        there = np.array(sorted(trimaps), np.int32)
        for c, classes in zip(map(int, there), self._voxels.classes(misses, there), strict=True):
            n, labels = blobs[c]
            areas_px = np.bincount(labels.ravel(), minlength=n)
            supported = np.bincount(labels[classes != MORE_MISS], minlength=n) >= _SUPPORTED * areas_px
            if n > 2 and supported[1:].any():
                trimaps[c][(labels > 0) & ~supported[labels]] = BACKGROUND
        return trimaps


@dataclass(frozen=True, eq=False)
class Moment:
    """What some cameras show at one moment."""

    trimaps: list[Trimap]
    """(h, w) of each camera."""
    images_bgr: Mapping[int, Bytes] | None = None
    """The raw pictures (h, w, 3) that they were made of, by camera's place; None for ready silhouettes."""
    classes: list[Bytes] | None = None
    """(h, w) of each camera, the colour class of every actor pixel, 0 for none; None if none are known."""


class LearntCameras:
    """Some cameras, with what a fit learnt of them: where something hides the actor, and the actor's
    colours."""

    def __init__(
        self, cameras: Sequence[Camera], occluded: Mapping[str, Mask], colour_tables: Mapping[str, Bytes]
    ) -> None:
        """occluded, by camera's name: pixels (h, w), without lens distortion, in which something hides the
        actor. colour_tables, by name: what the colour classes look like there (COLOUR_BINS)."""
        self._undistorters = [Undistorter(camera) for camera in cameras]
        self._occluded = [occluded.get(camera.name) for camera in cameras]
        self._colour_tables = [colour_tables.get(camera.name) for camera in cameras]
        self.has_colours = bool(colour_tables)

    def moment(self, raw: Mapping[int, Trimap], images_bgr: Mapping[int, Bytes] | None) -> Moment:
        """What the cameras of these positions show, of raw trimaps (h, w), without lens distortion; with
        classes where colours are known and there are raw pictures (h, w, 3)."""
        trimaps = [self._trimap(c, raw[c]) for c in sorted(raw)]
        classes = None
        if self.has_colours and images_bgr is not None:
            pairs = zip(sorted(raw), trimaps, strict=True)
            classes = [self._classes(c, images_bgr[c], raw[c], trimap) for c, trimap in pairs]
        return Moment(trimaps, images_bgr, classes)

    def _trimap(self, c: int, raw: Trimap) -> Trimap:
        trimap, occluded = self._undistorters[c].trimap(raw), self._occluded[c]
        return trimap if occluded is None else np.where(occluded, np.uint8(UNSURE), trimap)

    def _classes(self, c: int, image_bgr: Bytes, raw: Trimap, trimap: Trimap) -> Bytes:
        """(h, w) the colour class of every actor pixel of an undistorted trimap, 0 for none."""
        table, classes, box = self._colour_tables[c], np.zeros_like(trimap), box_of(raw == ACTOR, 0)
        if table is not None and box is not None:
            of_raw = np.zeros_like(raw)
            of_raw[box] = classes_of(image_bgr[box], table)
            is_actor = trimap == ACTOR
            classes[is_actor] = self._undistorters[c].numbers(of_raw)[is_actor]
        return classes


class RawMoments(Protocol):
    """Reads moments of a take."""

    def __call__(self, start: int, stop: int, *, with_pictures: bool = True) -> Iterator[Moment]:
        """Of frames from start up to and without stop. with_pictures: whether they are needed; moments may
        have them nevertheless."""
        ...


class Segmenter:
    """The silhouettes of some cameras of a take. A frame is the same wherever reading starts."""

    def __init__(
        self,
        cameras: Sequence[Camera],
        raw_moments: RawMoments,
        occluded: Mapping[str, Mask] | None = None,
        colour_tables: Mapping[str, Bytes] | None = None,
        moved: Callable[[], Mapping[str, Mask]] = dict,
        blind: Callable[[], Mapping[str, Mask]] = dict,
    ) -> None:
        """occluded: by camera the pixels (h, w), without lens distortion, in which something hides the actor.
        colour_tables: by camera what the colour classes look like there (colour_classes). moved, blind: see
        there."""
        self.raw_moments = raw_moments
        """Of frames from start up to and without stop, with lens distortion and without colour classes."""
        self._cameras = cameras
        self._learnt = LearntCameras(cameras, occluded or {}, colour_tables or {})
        self.moved = moved
        """Returns by camera the pixels (h, w), without lens distortion, where an object was added or removed
        since the clean plates were recorded."""
        self.blind = blind
        """Returns by camera the pixels (h, w), without lens distortion, where something seems to hide the
        actor; where cameras are few, or wrongly calibrated, often nothing does."""

    @classmethod
    def of_videos(
        cls,
        take: Take,
        cameras: Sequence[Camera],
        matte: Callable[[], GroupMatte],
        kept: KeptTrimaps | None = None,
    ) -> "Segmenter":
        """What a matte makes of the cameras' videos, except for frames whose trimaps are kept; those that it
        makes are kept, too.

        matte: returns the same one whenever it is called.
        """

        single = cache(partial(SinglePictures, take, cameras))

        def pictures_from(start: int, stop: int) -> Iterator[dict[int, Bytes]]:
            if stop == start + 1:
                return iter([single().read(start)])
            return pictures_of(take, cameras, start, stop)

        def raw_moments(start: int, stop: int, *, with_pictures: bool = True) -> Iterator[Moment]:
            pictures: Iterator[dict[int, Bytes]] | None = None
            for frame in range(start, stop):
                trimaps = None if kept is None else kept.read(frame)
                if pictures is None and (with_pictures or trimaps is None):
                    pictures = pictures_from(frame, stop)
                images = None if pictures is None else next(pictures)
                if trimaps is None:
                    found = matte().trimaps(images or {})
                    trimaps = [found[c] for c in range(len(cameras))]
                    if kept is not None:
                        kept.keep(frame, trimaps)
                yield Moment(trimaps, images)

        def by_name(masks: list[Mask]) -> dict[str, Mask]:
            undistorted = {c.name: Undistorter(c).mask(m) for c, m in zip(cameras, masks, strict=True)}
            return {name: mask for name, mask in undistorted.items() if mask.any()}

        return cls(
            cameras,
            raw_moments,
            moved=lambda: by_name(matte().moved),
            blind=lambda: by_name(matte().blind),
        )

    @classmethod
    def of_silhouettes(cls, take: Take, cameras: Sequence[Camera]) -> "Segmenter":
        """The take's own silhouettes."""

        def raw_moments(start: int, stop: int, *, with_pictures: bool = True) -> Iterator[Moment]:
            del with_pictures  # there are none
            for trimaps in zip(*(take.trimaps(camera, start, stop) for camera in cameras), strict=True):
                yield Moment(list(trimaps))

        return cls(cameras, raw_moments)

    def knowing(
        self, occluded: Mapping[str, Mask], colour_tables: Mapping[str, Bytes] | None = None
    ) -> "Segmenter":
        """A segmenter with the same silhouettes, in which occluded pixels (see __init__) are unsure, and with
        colour classes."""
        return Segmenter(self._cameras, self.raw_moments, occluded, colour_tables, self.moved, self.blind)

    def moments(self, start: int, stop: int, *, with_pictures: bool = True) -> Iterator[Moment]:
        """Undistorted trimaps and classes, and the raw pictures, of frames start up to but not including
        stop. with_pictures: see RawMoments."""
        for raw in self.raw_moments(start, stop, with_pictures=with_pictures or self._learnt.has_colours):
            yield self._learnt.moment(dict(enumerate(raw.trimaps)), raw.images_bgr)

    def trimaps(self, start: int, stop: int) -> Iterator[list[Trimap]]:
        """Undistorted trimaps (h, w), one per camera, of frames start up to but not including stop."""
        return (moment.trimaps for moment in self.moments(start, stop, with_pictures=False))


class SinglePictures:
    """Reads what some cameras of a take show in single frames; keeps the videos open."""

    def __init__(self, take: Take, cameras: Sequence[Camera]) -> None:
        self._pickers = [(take.picker(camera), take.settings.offset(camera.name)) for camera in cameras]

    def read(self, frame: int) -> dict[int, Bytes]:
        """Raw pictures (H, W, 3) by the cameras' position."""
        return dict(enumerate(side_by_side(lambda of: of[0].read(frame + of[1]), self._pickers)))


def pictures_of(take: Take, cameras: Sequence[Camera], start: int, stop: int) -> Iterator[dict[int, Bytes]]:
    """Raw pictures (H, W, 3) of some cameras by their position, frame by frame, from start up to but not
    including stop."""
    with ExitStack() as closing:
        videos = [iter(closing.enter_context(take.video(camera, start, stop))) for camera in cameras]
        for _ in range(start, stop):
            yield dict(enumerate(side_by_side(next, videos)))


def packed(
    trimaps: Sequence[Trimap], width_px: int, height_px: int, classes: Sequence[Bytes] | None = None
) -> TriPlanes:
    """Planes (P, height_px, width_px) of trimaps and colour classes (h, w); smaller ones lie in the upper
    left."""
    planes = pack_trimaps([in_common_size(trimap, width_px, height_px) for trimap in trimaps])
    if classes is None:
        return planes
    whole = np.array([in_common_size(of_camera, width_px, height_px) for of_camera in classes])
    return replace(planes, classes=pack_classes(whole))
