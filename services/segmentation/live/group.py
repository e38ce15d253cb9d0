"""A group of live cameras: their feeds, the shots they make together, and what becomes of those."""

import threading
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.take.live import LiveTake
from services.mocap.types import Bytes
from services.segmentation.cleanup import SegmentationSettings
from services.segmentation.joint import JointSegmenter
from services.segmentation.learning import LiveLearner
from services.segmentation.live.clock import CoordinatorClock
from services.segmentation.live.feed import Feed
from services.segmentation.live.recording import CameraRecording
from services.segmentation.live.shots import Shot, Shots
from services.segmentation.live.sources import FileSource, Source, StreamSource
from services.segmentation.segmenters import live_matte
from services.segmentation.source import GroupUndistorter, packed
from services.segmentation.warm_up import warm_up


class Silhouetter:
    """Makes the silhouettes of a group's shots."""

    def __init__(self, take: LiveTake, cameras: Sequence[int], segmenter: str) -> None:
        """Raises UserError where the segmenter cannot work live."""
        chosen = [take.cameras[c] for c in cameras]
        self._height_px, self._width_px = Rig.of(take.cameras).shape_px
        self._matte = live_matte(take, chosen, SegmentationSettings(), segmenter)
        self._colours = [take.colours.get(camera.name) for camera in chosen]
        self._undistorter = GroupUndistorter(chosen)
        self._cameras = chosen
        self._learner = LiveLearner(self._matte) if isinstance(self._matte, JointSegmenter) else None
        warm_up()

    def planes(self, shot: Shot) -> tuple[list[int], TriPlanes]:
        """Which cameras of the group have a picture of a shot, and planes (P, H, W) of these."""
        images = {k: self._corrected(k, taken.image) for k, taken in shot.taken.items()}
        if self._learner is not None:
            self._learner.see(images)
        trimaps = self._undistorter.undistorted(self._matte.trimaps(images))
        return sorted(images), packed(trimaps, self._width_px, self._height_px)

    def _corrected(self, k: int, image: Bytes) -> Bytes:
        """A picture (h, w, 3) as the camera gave it, in the colours that all cameras are to have."""
        colour = self._colours[k]
        return image if colour is None else colour.apply(image)


class Group:
    """The feeds of some cameras, and shots once the coordinator's clock tells which is when."""

    def __init__(
        self, take: LiveTake, cameras: Sequence[int], clock: CoordinatorClock, record: Path | None
    ) -> None:
        """record: the folder of a take that is to be made of the pictures."""
        self._take, self._clock, live = take, clock, take.live
        self._begun = threading.Event()
        self._files_begin_s = 0.0
        self.shots = Shots(len(cameras), clock, live.reach_s, live.period_s, live.grace_s)
        self._recordings = [
            CameraRecording(record, take.cameras[c], live.fps) for c in cameras if record is not None
        ]
        self._feeds = [self._feed(k, c) for k, c in enumerate(cameras)]

    def _feed(self, k: int, c: int) -> Feed:
        return Feed(
            self._take.cameras[c],
            lambda stopped: self._open(k, c, stopped),
            lambda image, taken_s: self._give(k, image, taken_s),
        )

    def _open(self, k: int, c: int, stopped: threading.Event) -> Source | None:
        """A camera's source; files begin with shot 0, so that each of their pictures has its number."""
        source = self._take.sources[c]
        if not source.is_file:
            return StreamSource(source, self._take.cameras[c], self._take.live.fps)
        while not self._begun.wait(0.1):
            if stopped.is_set():
                return None
        passed_over = partial(self.shots.pass_over, k)
        return FileSource(Path(str(source.source)), self._files_begin_s, stopped, passed_over)

    def _give(self, k: int, image: Bytes, taken_s: float) -> None:
        shot = self.shots.put(k, image, taken_s)
        if shot is not None and self._recordings:
            self._recordings[k].add(shot, image, taken_s - self._files_begin_s)

    def begin(self) -> None:
        """The coordinator's clock tells from now on which shot is when."""
        if not self._begun.is_set():
            self._files_begin_s = self._clock.here_s(self._clock.due_s(0))
            self._begun.set()

    @property
    def is_recording(self) -> bool:
        """Whether a take is made of the pictures."""
        return bool(self._recordings)

    @property
    def has_ended(self) -> bool:
        """Whether no picture will ever follow."""
        return all(feed.has_ended for feed in self._feeds)

    def check(self) -> None:
        """Raise what a user has to mend."""
        for feed in self._feeds:
            if feed.problem is not None:
                raise feed.problem

    def end_before(self, end_shot: int) -> None:
        """Record no shot from this one on."""
        for recording in self._recordings:
            recording.end_before(end_shot)

    def stop(self, end_shot: int | None) -> None:
        """End all feeds and, before this shot, the recordings."""
        for feed in self._feeds:
            feed.stop()
        for feed in self._feeds:
            feed.join()
        if self._recordings and end_shot:
            for recording in self._recordings:
                recording.finish(end_shot)
