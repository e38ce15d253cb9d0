"""Of live input the newest whole shot is solved; what is left out is counted; absent cameras have no say."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from proto.messages import LiveSilhouettes, LiveSources
from services.coordinator.live_frames import LiveFrames
from services.mocap.camera.camera import Camera
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import unpack
from services.mocap.take.live import LiveTake, open_live

_RUN, _FPS = "a" * 32, 10.0
Cameras = Callable[[int], list[Camera]]


class Clock:
    """Goes on when it is told to."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


class Stage:
    """Live frames of four cameras in two groups, with a clock of their own."""

    def __init__(self, take: LiveTake) -> None:
        self.clock, self.rig = Clock(), Rig.of(take.cameras)
        self.frames = LiveFrames(take, self.rig, self.clock)
        self.frames.begin(_RUN, 0)
        self.report([0, 1])
        self.report([2, 3])
        self.origin_s = self.due_s(0)

    def report(self, cameras: list[int], ended: bool = False, **counts: list[int]) -> None:
        told = {"missed": [0, 0], "dropped": [0, 0], **counts}
        self.pace = self.frames.answer(
            LiveSources(
                take="stage",
                asked_s=1.0,
                cameras=cameras,
                latest_s=[],
                absent=[],
                unsent=0,
                ended=ended,
                **told,
            )
        )

    def due_s(self, shot: int) -> float:
        assert self.pace is not None
        return self.pace.shot_s + (shot - self.pace.shot) * self.pace.period_s

    def send(self, shot: int, cameras: list[int], n_unsure: int = 1) -> None:
        """Camera c's silhouette of shot n is one pixel in row c and column n % 64; the next one is unsure."""
        planes, unsure = np.zeros((2, 1, *self.rig.shape_px), np.uint8)
        for k, c in enumerate(cameras):
            planes[0, c, shot % 64] |= 1 << k
            unsure[0, c, shot % 64 + 1] |= 1 << k
        times_s = [self.origin_s + shot / _FPS] * len(cameras)
        self.frames.add(
            LiveSilhouettes(
                take="stage",
                run=_RUN,
                shot=shot,
                cameras=cameras,
                times_s=times_s,
                planes=planes,
                unsure=unsure.repeat(n_unsure, axis=0),
            )
        )

    def send_all(self, shot: int) -> None:
        self.clock.now_s = self.origin_s + shot / _FPS + 0.02
        self.send(shot, [0, 1])
        self.send(shot, [2, 3])


@pytest.fixture
def take(small_take: Callable[..., Path]) -> LiveTake:
    folder = small_take("stage", n_cameras=4)
    tables = "".join(f'[cameras.cam0{c}]\nsource = "videos/cam0{c}.mp4"\n' for c in range(1, 5))
    settings = f'name = "stage"\nfps = {_FPS}\nup = "z"\ncalibration = "calibration.toml"\n'
    (folder / "live.toml").write_text(settings + 'background = "background"\n' + tables)
    return open_live(folder / "live.toml")


@pytest.fixture
def stage(take: LiveTake) -> Stage:
    return Stage(take)


def test_a_shot_comes_whole_with_its_time(stage: Stage) -> None:
    stage.clock.now_s = stage.origin_s + 3 / _FPS + 0.02
    stage.send(3, [2, 3])
    stage.send(3, [1, 0])
    frame = stage.frames.take_next()
    assert frame is not None
    assert (frame.shot, frame.absent) == (3, ())
    assert frame.time_s == pytest.approx(3 / _FPS, abs=0.01)
    assert np.argwhere(unpack(frame.seen.silhouettes, 4)).tolist() == [[c, c, 3] for c in range(4)]
    assert np.argwhere(unpack(frame.seen.unsure, 4)).tolist() == [[c, c, 4] for c in range(4)]
    stage.clock.now_s += 0.1
    assert stage.frames.note_latency(frame, is_settled=False) == pytest.approx(0.12, abs=0.01)
    assert stage.frames.figures()["latency_s"]["p95"] == pytest.approx(0.12, abs=0.01)


def test_the_newest_is_taken_and_the_others_are_counted(stage: Stage) -> None:
    for shot in range(5):
        stage.send_all(shot)
    frame = stage.frames.take_next()
    assert frame is not None
    assert frame.shot == 4
    assert stage.frames.take_next() is None
    stage.send(2, [0, 1])  # too late
    assert stage.frames.figures()["drops"] == {f"cam0{c}": [0, 0, 5 if c < 3 else 4] for c in range(1, 5)}


def test_a_camera_that_is_cut_is_waited_for_only_at_first(stage: Stage) -> None:
    stage.send_all(0)
    assert stage.frames.take_next() is not None
    stage.clock.now_s = stage.origin_s + 0.12
    stage.send(1, [0, 1])
    stage.send(1, [3])
    assert stage.frames.take_next() is None
    stage.clock.now_s += 0.11
    frame = stage.frames.take_next()
    assert frame is not None
    assert frame.absent == (2,)
    for shot in range(3, 8):
        stage.clock.now_s = stage.origin_s + shot / _FPS + 0.02
        stage.send(shot, [0, 1])
        stage.send(shot, [3])
    for shot in (3, 5, 7):  # at once by now, in strides
        frame = stage.frames.take_next()
        assert frame is not None
        assert (frame.shot, frame.absent) == (shot, (2,))
    assert stage.frames.figures()["absent"] == ["cam03"]
    stage.send_all(8)
    frame = stage.frames.take_next()
    assert frame is not None
    assert (frame.shot, frame.absent) == (8, ())
    assert stage.frames.figures()["absent"] == []


def test_too_few_cameras_are_none(stage: Stage) -> None:
    stage.clock.now_s = stage.origin_s + 0.02
    stage.send(0, [0, 1])
    stage.clock.now_s += 5
    assert stage.frames.take_next() is None


def test_after_the_actor_was_found_it_catches_up_in_strides(stage: Stage) -> None:
    stage.send_all(0)
    assert stage.frames.take_next() is not None
    for shot in range(1, 31):  # while the first pose is looked for
        stage.send_all(shot)
    stage.frames.catch_up()
    shots, now = [], 31
    while not shots or shots[-1] < now - 2:
        frame = stage.frames.take_next()
        assert frame is not None
        shots.append(frame.shot)
        stage.send_all(now)
        now += 1
    assert max(np.diff([0, *shots])) <= 2
    assert now < 70


def test_old_news_waits_for_what_follows(stage: Stage) -> None:
    stage.send_all(0)
    assert stage.frames.take_next() is not None
    stage.send_all(1)
    stage.clock.now_s += 3.0  # something took long, and shots waited in queues meanwhile
    assert stage.frames.take_next() is None
    stage.send_all(31)
    taken = [stage.frames.take_next() for _ in range(2)]
    assert [(frame.shot, frame.is_late) for frame in taken if frame is not None] == [(1, True), (31, False)]


def test_after_a_long_search_no_stride_is_long(stage: Stage) -> None:
    """However long the last frame took: 0.2 s at most, late frames are told, and the newest is reached."""
    stage.send_all(0)
    assert stage.frames.take_next() is not None
    for shot in range(1, 21):
        stage.send_all(shot)
    taken = []
    while not taken or taken[-1].is_late:
        stage.clock.now_s += 0.15
        frame = stage.frames.take_next()
        assert frame is not None
        taken.append(frame)
    shots = [frame.shot for frame in taken]
    assert shots[-1] == 20
    assert max(np.diff([0, *shots])) <= 2
    assert all(frame.is_late for frame in taken[:-1])


def test_old_news_that_nothing_follows_is_solved_after_all(stage: Stage) -> None:
    stage.send_all(0)
    assert stage.frames.take_next() is not None
    stage.send_all(1)
    stage.clock.now_s += 3.0
    stage.report([0, 1], ended=True)
    stage.report([2, 3], ended=True)
    assert stage.frames.take_next() is None
    stage.clock.now_s += 0.4  # the coordinator waits for messages in between
    frame = stage.frames.take_next()
    assert frame is not None
    assert frame.shot == 1
    assert stage.frames.has_ended


def test_foreign_messages_are_counted(stage: Stage) -> None:
    before = stage.frames.dropped
    planes = np.zeros((1, *stage.rig.shape_px), np.uint8)
    good = {"take": "stage", "run": _RUN, "shot": 1, "cameras": [0], "times_s": [1.0], "planes": planes}
    bad: list[dict[str, object]] = [
        {"take": "other"},
        {"run": "b" * 32},
        {"cameras": [4]},
        {"cameras": [0, 0], "times_s": [1.0, 1.0]},
        {"times_s": [1.0, 2.0]},
        {"planes": planes[:, 1:]},
    ]
    for change in bad:
        stage.frames.add(LiveSilhouettes.model_validate(good | change))
    assert stage.frames.dropped == before + len(bad)
    assert stage.frames.n_ready == 0


def test_it_ends_when_all_files_are_over(stage: Stage) -> None:
    stage.send_all(9)
    stage.report([0, 1], ended=True)
    stage.report([2, 3], ended=False)
    assert not stage.frames.has_ended
    stage.report([2, 3], ended=True)
    assert not stage.frames.has_ended  # there is a shot left
    assert stage.frames.take_next() is not None
    assert stage.frames.has_ended
    assert stage.frames.end_shot == 10


def test_shots_of_too_few_cameras_do_not_keep_it_from_ending(stage: Stage) -> None:
    stage.send_all(9)
    assert stage.frames.take_next() is not None
    stage.send(10, [0, 1])
    stage.report([0, 1], ended=True)
    assert stage.frames.has_ended is False  # the other group may have something
    stage.report([2, 3], ended=True)
    assert stage.frames.has_ended


def test_what_segmentation_says_is_told(stage: Stage) -> None:
    stage.report([2, 3], missed=[7, 1], dropped=[0, 2])
    drops = stage.frames.figures()["drops"]
    assert drops == {"cam01": [0, 0, 0], "cam02": [0, 0, 0], "cam03": [7, 0, 0], "cam04": [1, 2, 0]}


def test_unsure_planes_that_do_not_fit_are_dropped_and_counted(stage: Stage) -> None:
    stage.clock.now_s = stage.origin_s + 3 / _FPS + 0.02
    stage.send(3, [0, 1, 2, 3], n_unsure=2)
    assert stage.frames.dropped == 1
    stage.send(3, [0, 1, 2, 3], n_unsure=0)
    frame = stage.frames.take_next()
    assert frame is not None
    assert not frame.seen.unsure.any()
