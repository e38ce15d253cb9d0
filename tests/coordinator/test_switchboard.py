"""The coordinator's ports at the end of a take: who has everything, who is gone."""

import logging
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest
import zmq
from floor import limb_task, result_of

from proto.link import Line, Link
from proto.messages import Credit, Hello, Message, Pose, PoseRequest, Recorded, Recording, TakeEnd
from services.coordinator.incoming import RecordedFrames
from services.coordinator.recorders import LostFramesError
from services.coordinator.switchboard import Switchboard
from services.mocap.body.kinematics import N_DOF
from services.mocap.camera.rig import Rig
from services.runs.launcher import free_endpoint

RUN = "0123456789abcdef" * 2
END_FRAME = 10
_PATIENCE_S = 10.0


@pytest.fixture
def endpoint() -> str:
    return free_endpoint()


@pytest.fixture
def board(endpoint: str) -> Iterator[Switchboard]:
    """A coordinator whose take has begun, with one recorder to come."""
    rig = Rig(np.ones((1, 3, 4)), np.array([[4, 4]], np.int32))
    board = Switchboard(endpoint, RecordedFrames("walk", rig, range(END_FRAME), 25.0))
    board.recorders.begin(RUN, first_frame=0, n_expected=1)
    yield board
    board.close()


@pytest.fixture
def recorder(board: Switchboard, endpoint: str) -> Iterator[Link]:
    """A recorder that the coordinator knows."""
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    hello = Hello(role="recorder", name="recorder@test:1", backend="")
    link = Link(context, endpoint, hello)
    deadline_s = time.monotonic() + _PATIENCE_S
    while not board.recorders.recorded_ends:
        assert time.monotonic() < deadline_s, "never registered"
        board.pump(0.01)
        link.receive()
        link.tick()
    yield link
    context.destroy(linger=0)


def test_a_result_counts_for_the_deadline_before_its_worker_is_heard(
    board: Switchboard, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else a task that took longer than the deadline would be taken away first, and the deadline stay."""
    told = list[str]()
    monkeypatch.setattr(board.dispatcher, "heard", lambda *_: told.append("heard"))
    monkeypatch.setattr(board.dispatcher, "finished", lambda *_: told.append("finished"))
    board._act(b"worker", result_of(limb_task()))
    assert told == ["finished", "heard"]


def test_a_recorder_that_confirms_and_leaves_at_once_is_not_lost(
    board: Switchboard, recorder: Link, caplog: pytest.LogCaptureFixture
) -> None:
    recorder.send(Recorded(run=RUN, end_frame=END_FRAME))
    recorder.close()
    time.sleep(0.3)  # its connection is gone, its word unread
    with caplog.at_level(logging.WARNING):
        assert board.recorders.have_all(END_FRAME, lambda: board.pump(0))
    assert not caplog.records


def test_a_recorder_that_leaves_without_a_word_is_lost(
    board: Switchboard, recorder: Link, caplog: pytest.LogCaptureFixture
) -> None:
    recorder.close()
    time.sleep(0.3)
    with caplog.at_level(logging.WARNING):
        assert not board.recorders.have_all(END_FRAME, lambda: board.pump(0))
    assert "lost recorder@test:1" in caplog.text


def told(endpoint_of: Switchboard, message: Message, recorder: Link) -> list[Message]:
    """What a recorder hears in answer to a message."""
    recorder.send(message)
    heard: list[Message] = []
    for _ in range(30):
        endpoint_of.pump(0.01)
        while (answer := recorder.receive()) is not None:
            heard.append(answer)
    return heard


def test_settled_poses_are_kept_until_recorders_have_them(board: Switchboard, recorder: Link) -> None:
    """More than a thousand are kept only as long as a recorder lacks them."""
    holds = _recording(RUN, 1300)
    first = PoseRequest(run=RUN, first_frame=0, end_frame=2, settled=True)
    told(board, holds, recorder)
    for frame in range(1200):
        board.publish(_pose(frame, settled=True))
    assert [(pose.frame, pose.settled) for pose in told(board, first, recorder)] == [(0, True), (1, True)]
    told(board, holds.model_copy(update={"settled_end": 150}), recorder)
    board.publish(_pose(1200, settled=True))
    last = first.model_copy(update={"first_frame": 150, "end_frame": 152})
    assert [pose.frame for pose in told(board, last, recorder)] == [150, 151]
    with pytest.raises(LostFramesError, match="lacks frame 0, which is no longer kept"):
        told(board, first, recorder)


@pytest.mark.parametrize("is_live", [False, True])
def test_silhouettes_are_let_go_once_recorders_have_all_and_at_once_if_they_are_live(
    board: Switchboard, recorder: Link, endpoint: str, monkeypatch: pytest.MonkeyPatch, *, is_live: bool
) -> None:
    monkeypatch.setattr(RecordedFrames, "is_live", is_live)
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    poses, end = Line(context, endpoint, "poses"), TakeEnd(take="walk", run=RUN, first_frame=0, end_frame=3)
    credit = Credit(take="walk", run=RUN, next_frame=0, end_frame=3)
    deadline_s = time.monotonic() + _PATIENCE_S
    while poses.receive() is None:  # it has subscribed once it hears something
        assert time.monotonic() < deadline_s, "never subscribed"
        board.give_credit(credit)
        poses.tick()
    board.end(end)
    assert end in told(board, Recorded(run=RUN, end_frame=0), recorder)
    assert (end in _heard(poses)) == is_live
    board.publish_end()
    assert end in _heard(poses)
    context.destroy(linger=0)


def _heard(line: Line) -> list[Message]:
    """What has come, and comes within a moment."""
    heard, until_s = list[Message](), time.monotonic() + 0.3
    while time.monotonic() < until_s:
        if (message := line.receive()) is not None:
            heard.append(message)
    return heard


def test_a_recorder_that_comes_too_late_ends_no_run(
    board: Switchboard, recorder: Link, endpoint: str, caplog: pytest.LogCaptureFixture
) -> None:
    """The expected one has everything; nobody waits for the other, who cannot have it any more."""
    many = 1100
    recorder.send(_recording(RUN, many))
    _until(board, recorder, lambda: board.recorders.recorded_ends == {"recorder@test:1": many})
    for frame in range(many):
        board.publish(_pose(frame))
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    late = Link(context, endpoint, Hello(role="recorder", name="late@test:2", backend=""))
    _until(board, late, lambda: len(board.recorders.recorded_ends) == 2)
    late.send(_recording("", 0))
    late.send(PoseRequest(run=RUN, first_frame=0, end_frame=64))
    _until(board, late, lambda: "late@test:2 lacks frame 0" in caplog.text)
    heard_s = board.recorders.heard_s
    for _ in range(3):
        late.send(PoseRequest(run=RUN, first_frame=0, end_frame=64))
        _pump_both(board, late)
    assert board.recorders.heard_s == heard_s, "asking in vain is no reason to wait"
    assert board.recorders.n_lacking == 0
    assert board.recorders.n_unrecorded == 0
    recorder.send(Recorded(run=RUN, end_frame=many))
    _until(board, recorder, lambda: board.recorders.have_all(many, lambda: board.pump(0.0)))
    held = board.recorders.held("walk", "0" * 64, n_expected=1)
    assert held is not None
    assert held.end_frame == many
    context.destroy(linger=0)


def _recording(run: str, end_frame: int) -> Recording:
    poses = np.zeros((min(end_frame, 2), N_DOF))
    return Recording(
        take="walk", run=run, plan="0" * 64 if run else "", shards=1, end_frame=end_frame, retries=0,
        worker_backends={}, memory={}, poses=poses, actor=np.zeros(0, np.uint8),
    )  # fmt: skip


def _pose(frame: int, *, settled: bool = False) -> Pose:
    return Pose(
        take="walk", run=RUN, frame=frame, time_s=0.0, energy_px=1.0, passes=1, evaluations=1, workers=0,
        retries=0, backend="cpu", worker_backends={}, seconds={}, settled=settled, pose=np.zeros(N_DOF),
    )  # fmt: skip


def _until(board: Switchboard, link: Link, condition: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + _PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline_s
        _pump_both(board, link)


def _pump_both(board: Switchboard, link: Link) -> None:
    board.pump(0.01)
    link.receive()
    link.tick()
