"""Serves live cameras: sends silhouettes of shots and reports to the coordinator."""

import logging
import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import zmq

from proto.keys import ClientKeys
from proto.link import Line
from proto.messages import LivePace, LiveSilhouettes, LiveSources, Message, TakeEnd
from proto.streams import ASK_PACE_AGAIN_S, FROM_LIVE_CAMERAS
from services.health import beat
from services.listener import hear
from services.logs import about
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.take.fit_record import read_learnt
from services.mocap.take.layout import BACKGROUND
from services.mocap.take.live import LiveTake
from services.process import StopRequest, clock_name
from services.segmentation.joint import JointMatte
from services.segmentation.learning import LiveLearner
from services.segmentation.live.empty_stage import has_empty_stage, see_empty_stage
from services.segmentation.live.group import Group
from services.segmentation.live.shots import CoordinatorClock, Shot
from services.segmentation.live.sources import check_file
from services.segmentation.metrics import FRAMES, SECONDS
from services.segmentation.segmenters import live_matte
from services.segmentation.silhouettes import LearntCameras, packed
from services.segmentation.warm_up import warm_up

_SHOT_WAIT_S = 0.05
"""How long to wait for a shot before messages are read."""
_CATCH_UP_S = 2.0
"""How long to wait for the last pictures of a recording."""

log = logging.getLogger(__name__)


class Silhouetter:
    """Makes the silhouettes of a group's shots."""

    def __init__(
        self, take: LiveTake, cameras: Sequence[int], segmenter: str, fitted: Path | None = None
    ) -> None:
        """fitted: see serve_live. Raises UserError if the segmenter does not support live input."""
        chosen = [take.cameras[c] for c in cameras]
        self._height_px, self._width_px = Rig.of(take.cameras).shape_px
        self._matte = live_matte(take, chosen, segmenter)
        self._learner = None
        if isinstance(self._matte, JointMatte):
            self._learner = LiveLearner(self._matte, [camera.name for camera in chosen])
        self._colours = [take.colours.get(camera.name) for camera in chosen]
        occluded, colour_tables = ({}, {}) if fitted is None else read_learnt(fitted, chosen)
        self._learnt = LearntCameras(chosen, occluded, colour_tables)
        warm_up()

    def planes(self, shot: Shot) -> tuple[list[int], TriPlanes]:
        """The cameras of the group with a picture of a shot, and their planes (P, H, W)."""
        images = {}
        for k, taken in shot.taken.items():
            colour = self._colours[k]  # what makes pictures those that all cameras are to have
            images[k] = taken.image if colour is None else colour.apply(taken.image)
        if self._learner is not None:
            self._learner.see(images)
        moment = self._learnt.moment(self._matte.trimaps(images), images)
        return sorted(images), packed(moment.trimaps, self._width_px, self._height_px, moment.classes)


class Talk:
    """The three connections to the coordinator, and its clock."""

    def __init__(
        self, take: LiveTake, cameras: Sequence[int], endpoint: str, keys: ClientKeys | None
    ) -> None:
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._take, self._cameras = take.settings.name, list(cameras)
        self._tasks = Line(self._context, endpoint, "tasks", keys)
        self._poses = Line(self._context, endpoint, "poses", keys)
        self._silhouettes = Line(self._context, endpoint, "silhouettes", keys)
        self.clock = CoordinatorClock(clock_name())
        self._asked_s = 0.0
        self.unsent = 0
        """Number of shots that could not be sent."""
        self.end: TakeEnd | None = None
        """The coordinator's message that no pose will follow."""

    def hear(self) -> None:
        """Handle the coordinator's messages."""
        for line in (self._tasks, self._poses):
            hear(line, self._take_in)
        for line in (self._tasks, self._poses, self._silhouettes):
            line.tick()

    def _take_in(self, message: Message) -> None:
        if isinstance(message, LivePace) and message.take == self._take:
            self.clock.hear(message, time.monotonic())
        elif isinstance(message, TakeEnd) and message.take == self._take:
            self.end = message

    def tell(self, group: Group) -> None:
        """Report the state of the cameras when it is due."""
        now_s = time.monotonic()
        if now_s - self._asked_s < (FROM_LIVE_CAMERAS.every_s if self.clock.run else ASK_PACE_AGAIN_S):
            return
        self._asked_s = now_s
        shots, clock = group.shots, self.clock
        latest_s = [clock.there_s(at_s) for at_s in shots.latest_s if at_s is not None]
        word = LiveSources(
            take=self._take,
            asked_s=time.monotonic(),
            cameras=self._cameras,
            latest_s=latest_s if clock.is_known else [],
            missed=list(shots.missed),
            dropped=list(shots.dropped),
            unsent=self.unsent,
            absent=[self._cameras[k] for k in shots.absent()],
            ended=group.has_ended and not shots.n_waiting,
        )
        self._tasks.send(word)

    def send(self, shot: Shot, silhouetter: Silhouetter) -> None:
        """Segment a shot, and send it if the queue has room."""
        about(frame=shot.number)
        with SECONDS.time():
            there, planes = silhouetter.planes(shot)
        message = LiveSilhouettes(
            take=self._take,
            run=self.clock.run,
            shot=shot.number,
            cameras=[self._cameras[k] for k in there],
            times_s=[shot.taken[k].time_s for k in there],
            planes=planes.silhouettes,
            unsure=planes.sent_unsure,
            classes=planes.sent_classes,
        )
        if self._silhouettes.send(message):
            FRAMES.inc()
        else:
            self.unsent += 1

    def end_shot(self) -> int | None:
        """One past the last shot of a recording; None where there was none."""
        if self.end is not None and self.end.end_shot:
            return self.end.end_shot
        if not self.clock.run:
            return None
        return max(int(self.clock.shot_at(self.clock.there_s(time.monotonic()))), 1)

    def close(self) -> None:
        """Close the connections after sending what is queued."""
        for line in (self._silhouettes, self._poses, self._tasks):
            line.close()
        self._context.term()


def serve_live(
    take: LiveTake,
    cameras: Sequence[int],
    endpoint: str,
    stop: StopRequest,
    keys: ClientKeys | None,
    segmenter: str,
    record: Path | None,
    fitted: Path | None,
    stage: Path | None = None,
) -> None:
    """Send silhouettes of live cameras until the coordinator announces the end or a stop is requested.

    record: the folder in which to record the pictures as a take, with the clean plates from the start.
    fitted: a folder written by xormocap fit with these cameras; what its occluded pictures show is unsure,
    and it knows the actor's colour classes. stage: a folder for the pictures of the empty stage, if there are
    none; those that an earlier process of this run left there are used. Raises UserError if a source does not
    match its configuration.
    """
    for c in cameras:
        check_file(take.sources[c], take.calibrated[c])
    with ExitStack() as closing:
        if take.background_folder is None:
            kept = stage or record
            if kept is None:
                made = tempfile.TemporaryDirectory(prefix="xormocap-stage-")
                kept = Path(closing.enter_context(made))
            if stage is None or not has_empty_stage(take, cameras, stage):
                see_empty_stage(take, cameras, kept, stop)
            if stop:
                return
            take = replace(take, background_folder=kept / BACKGROUND)
        silhouetter = Silhouetter(take, cameras, segmenter, fitted)
        talk = Talk(take, cameras, endpoint, keys)
        closing.callback(talk.close)
        group = Group(take, cameras, talk.clock, record)
        names = ", ".join(take.cameras[c].name for c in cameras)
        log.info("ready: live %s%s", names, f", with the fit in {fitted}" if fitted else "")
        try:
            _serve(talk, group, silhouetter, stop)
        finally:
            group.stop(talk.end_shot())
        group.check()  # of recordings that failed at their end


def _serve(talk: Talk, group: Group, silhouetter: Silhouetter, stop: StopRequest) -> None:
    end_s = float("inf")
    while not stop and time.monotonic() < end_s:
        beat()
        talk.hear()
        if talk.clock.run:
            group.begin()
        group.check()
        talk.tell(group)
        if talk.end is not None:
            group.end_before(talk.end.end_shot)
            if not group.is_recording or group.shots.has_come(talk.end.end_shot - 1):
                return
            end_s = min(end_s, time.monotonic() + _CATCH_UP_S)
        shot = group.shots.take(_SHOT_WAIT_S)
        if shot is not None and talk.end is None:
            talk.send(shot, silhouetter)
