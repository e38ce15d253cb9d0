"""The silhouettes of a take, frame by frame, wherever they come from."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from services.mocap.camera.camera import Camera
from services.mocap.camera.undistort import Undistorter
from services.mocap.energy.bitplanes import TriPlanes, in_common_size, pack_classes, pack_trimaps
from services.mocap.side_by_side import side_by_side
from services.mocap.take.folder import Take
from services.mocap.types import ACTOR, UNSURE, Bytes, Mask, Trimap
from services.segmentation.cleanup import box_of
from services.segmentation.colour_classes import classes_of
from services.segmentation.kept_trimaps import KeptTrimaps
from services.segmentation.mattes import GroupMatte


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


class SilhouetteSource(Protocol):
    """Where the silhouettes of some cameras of a take come from."""

    def raw_moments(self, start: int, stop: int, *, with_pictures: bool = True) -> Iterator[Moment]:
        """Of frames from start up to and without stop, with lens distortion and without colour classes.

        with_pictures: whether they are needed; moments may have them nevertheless.
        """
        ...

    def moved(self) -> dict[str, Mask]:
        """By camera the pixels (h, w), without lens distortion, where an object was added or removed since
        the clean plates were recorded."""
        ...

    def blind(self) -> dict[str, Mask]:
        """By camera the pixels (h, w), without lens distortion, where something seems to hide the actor;
        where cameras are few, or wrongly calibrated, often nothing does."""
        ...


class VideoSilhouettes:
    """What a matte makes of the cameras' videos, except for frames whose trimaps are kept; those that it
    makes are kept, too. See SilhouetteSource."""

    def __init__(
        self,
        take: Take,
        cameras: Sequence[Camera],
        matte: Callable[[], GroupMatte],
        kept: KeptTrimaps | None = None,
    ) -> None:
        """matte: returns the same one whenever it is called."""
        self._take, self._cameras, self._matte, self._kept = take, cameras, matte, kept

    def raw_moments(self, start: int, stop: int, *, with_pictures: bool = True) -> Iterator[Moment]:
        """See SilhouetteSource."""
        pictures: Iterator[dict[int, Bytes]] | None = None
        for frame in range(start, stop):
            trimaps = None if self._kept is None else self._kept.read(frame)
            if pictures is None and (with_pictures or trimaps is None):
                pictures = self._pictures(frame, stop)
            images = None if pictures is None else next(pictures)
            if trimaps is None:
                found = self._matte().trimaps(images or {})
                trimaps = [found[c] for c in range(len(self._cameras))]
                if self._kept is not None:
                    self._kept.keep(frame, trimaps)
            yield Moment(trimaps, images)

    def moved(self) -> dict[str, Mask]:
        """See SilhouetteSource."""
        return self._undistorted(self._matte().moved)

    def blind(self) -> dict[str, Mask]:
        """See SilhouetteSource."""
        return self._undistorted(self._matte().blind)

    @cached_property
    def _single_pictures(self) -> "SinglePictures":
        return SinglePictures(self._take, self._cameras)

    def _pictures(self, start: int, stop: int) -> Iterator[dict[int, Bytes]]:
        if stop == start + 1:
            return iter([self._single_pictures.read(start)])
        return pictures_of(self._take, self._cameras, start, stop)

    def _undistorted(self, masks: list[Mask]) -> dict[str, Mask]:
        pairs = zip(self._cameras, masks, strict=True)
        undistorted = {camera.name: Undistorter(camera).mask(mask) for camera, mask in pairs}
        return {name: mask for name, mask in undistorted.items() if mask.any()}


class OwnSilhouettes:
    """The silhouettes that are in a take. See SilhouetteSource."""

    def __init__(self, take: Take, cameras: Sequence[Camera]) -> None:
        self._take, self._cameras = take, cameras

    def raw_moments(self, start: int, stop: int, *, with_pictures: bool = True) -> Iterator[Moment]:
        """See SilhouetteSource; there are no pictures."""
        del with_pictures
        of_cameras = [self._take.trimaps(camera, start, stop) for camera in self._cameras]
        for trimaps in zip(*of_cameras, strict=True):
            yield Moment(list(trimaps))

    def moved(self) -> dict[str, Mask]:
        """Nothing is known."""
        return {}

    blind = moved


class Segmenter:
    """The silhouettes of some cameras of a take. A frame is the same wherever reading starts."""

    def __init__(
        self,
        cameras: Sequence[Camera],
        source: SilhouetteSource,
        occluded: Mapping[str, Mask] | None = None,
        colour_tables: Mapping[str, Bytes] | None = None,
    ) -> None:
        """occluded: by camera the pixels (h, w), without lens distortion, in which something hides the actor.
        colour_tables: by camera what the colour classes look like there (colour_classes)."""
        self._cameras, self.source = cameras, source
        self._learnt = LearntCameras(cameras, occluded or {}, colour_tables or {})

    def knowing(
        self, occluded: Mapping[str, Mask], colour_tables: Mapping[str, Bytes] | None = None
    ) -> "Segmenter":
        """A segmenter with the same silhouettes, in which occluded pixels (see __init__) are unsure, and with
        colour classes."""
        return Segmenter(self._cameras, self.source, occluded, colour_tables)

    def moments(self, start: int, stop: int, *, with_pictures: bool = True) -> Iterator[Moment]:
        """Undistorted trimaps and classes, and the raw pictures, of frames start up to but not including
        stop. with_pictures: see SilhouetteSource.raw_moments."""
        with_pictures = with_pictures or self._learnt.has_colours
        for raw in self.source.raw_moments(start, stop, with_pictures=with_pictures):
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
