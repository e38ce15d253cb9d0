"""A recorder knows what it has, what it lacks, and when it is done."""

import hashlib
import tempfile
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from proto.framing import encode
from proto.messages import OPEN_END, Blob, Pose, PoseRequest, TakeEnd, TakeInfo
from services.mocap.body.kinematics import N_DOF
from services.mocap.camera.rig import Rig
from services.mocap.take.journal import JOURNAL, Journal
from services.recorder.collection import Collection
from services.recorder.store import Store

RUN, OTHER = "0" * 32, "1" * 32
_ACTOR = "height = 1.8 # größe\n"
_RIG = Rig(np.ones((1, 3, 4)), np.array([[4, 4]], np.int32)).to_json()


_TEMPORARY = tempfile.TemporaryDirectory()


def hash_of(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def info(first: int = 0, end: int = 10, **changed: Any) -> TakeInfo:
    fields = {"actor": hash_of(_ACTOR), "rig": hash_of(_RIG), "search": {}, "fps": 25.0}
    fields |= {"backend": "cpu", "backend_reason": "asked for", "threads": 1, "run": RUN}
    fields |= {"plan": "0" * 64, "shards": 1}
    return TakeInfo(**{"take": "walk", "first_frame": first, "end_frame": end, **fields, **changed})


def pose(frame: int, energy_px: float = 1.0, run: str = RUN) -> Pose:
    return Pose(
        take="walk", run=run, frame=frame, time_s=frame / 25, energy_px=energy_px, passes=1, evaluations=1,
        workers=0, retries=frame, backend="cpu", worker_backends={"gl": 2}, seconds={"frame": 0.1},
        memory={"tracker": [2, 0, 0, 0], "rest": [frame]}, pose=np.full(N_DOF, frame / 7),
    )  # fmt: skip


def blob(text: str, kind: Any = "actor", name: str | None = None) -> Blob:
    return Blob(hash=name or hash_of(text), kind=kind, content=np.frombuffer(text.encode(), np.uint8))


def settled(frame: int) -> Pose:
    """Another pose and energy, of the second way; what was measured of the work differs too."""
    changed = {"settled": True, "passes": 9, "seconds": {"frame": 9.0}, "pose": np.full(N_DOF, -frame / 7)}
    return pose(frame, 7.0).model_copy(update=changed)


def end(frame: int, run: str = RUN, *, settled: bool = False) -> TakeEnd:
    return TakeEnd(take="walk", run=run, first_frame=0, end_frame=frame, settled=settled)


def store(folder: Path | None = None) -> Store:
    return Store(folder or Path(tempfile.mkdtemp(dir=_TEMPORARY.name)))


def collection(*messages: TakeInfo | Pose | TakeEnd | Blob) -> Collection:
    made = Collection(store())
    for message in messages:
        made.add(message)
    return made


def test_a_new_one_lacks_nothing_that_it_knows_of() -> None:
    new = collection()
    assert new.missing_blobs() == []
    assert new.missing_frames() is None
    assert new.recorded() == []
    assert not new.complete
    with pytest.raises(ValueError, match="not over"):
        _ = new.end_frame


@pytest.mark.parametrize(
    ("frames", "gap"),
    [
        ([], None),
        ([0, 1, 2], None),
        ([1, 2], (0, 1)),
        ([0, 3, 5], (1, 3)),
        ([5], (0, 5)),
        ([4, 2, 0, 1], (3, 4)),
    ],
)
def test_the_first_gap_up_to_the_latest_pose(frames: list[int], gap: tuple[int, int] | None) -> None:
    assert collection(info(), *map(pose, frames)).missing_frames() == gap


def test_once_the_end_is_known_the_rest_is_missing_too() -> None:
    assert collection(info(), pose(0), end(4)).missing_frames() == (1, 4)
    assert collection(info(), end(4)).missing_frames() == (0, 4)
    assert collection(info(2), pose(2), end(3)).missing_frames() is None


def test_a_range_that_begins_later_has_no_gap_before_it() -> None:
    assert collection(info(first=7), pose(8)).missing_frames() == (7, 8)
    assert collection(info(first=7), pose(7), pose(8)).missing_frames() is None


def test_gaps_are_told_once_the_take_is_known() -> None:
    early = collection(pose(3))
    assert early.missing_frames() is None
    early.add(info())
    assert early.missing_frames() == (0, 3)


def test_content_is_asked_for_until_it_is_here() -> None:
    some = collection(info())
    assert some.missing_blobs() == [hash_of(_ACTOR), hash_of(_RIG)]
    some.add(blob(_RIG, "rig"))
    assert some.missing_blobs() == [hash_of(_ACTOR)]
    some.add(blob(_ACTOR))
    assert some.missing_blobs() == []
    assert some.actor().height == 1.8
    assert some.recording("walk").actor.tobytes() == _ACTOR.encode()


@pytest.mark.parametrize(
    "damaged",
    [
        blob("height = 1.9\n", name=hash_of(_ACTOR)),
        blob("", name=hash_of(_ACTOR)),
        Blob(hash=hash_of(_ACTOR), kind="actor", content=np.array([0xFF, 0xFE], np.uint8)),
    ],
)
def test_damaged_content_is_asked_for_again(damaged: Blob) -> None:
    some = collection(info(), damaged)
    assert hash_of(_ACTOR) in some.missing_blobs()
    some.add(blob(_ACTOR))
    some.add(damaged)
    assert hash_of(_ACTOR) not in some.missing_blobs()
    assert some.actor().height == 1.8


@pytest.mark.parametrize("binary", [b"\xff\xfe", b"height = ", b"weight = 1.8\n"])
def test_content_that_is_no_actor_is_refused(binary: bytes) -> None:
    name = hashlib.sha256(binary).hexdigest()
    content = np.frombuffer(binary, np.uint8)
    some = collection(info(actor=name), Blob(hash=name, kind="actor", content=content))
    assert name in some.missing_blobs()


def test_content_that_nobody_named_is_not_kept() -> None:
    folder = store()
    Collection(folder).add(info())
    some = Collection(folder)
    some.add(blob("height = 1.9\n"))
    assert some.missing_blobs() == [hash_of(_ACTOR), hash_of(_RIG)]
    assert folder.described == [info()]


def test_the_first_of_repeated_messages_counts() -> None:
    some = collection(info(), pose(0, 1.0), info(end=99), pose(0, 2.0))
    assert [message.energy_px for message in some.recorded()] == [1.0]
    assert some.info == info()


def test_complete_takes_everything() -> None:
    parts: list[TakeInfo | Pose | TakeEnd | Blob] = [
        info(0, 2),
        pose(0),
        pose(1),
        blob(_ACTOR),
        blob(_RIG, "rig"),
        end(2),
    ]
    assert collection(*parts).complete
    for left_out in range(1, len(parts)):
        assert not collection(*parts[:left_out], *parts[left_out + 1 :]).complete
    assert collection(*parts).end_frame == 2


def test_poses_without_the_takes_description_are_not_complete() -> None:
    """The end may overtake the description: they come on different streams."""
    some = collection(pose(0), pose(1), end(2))
    assert not some.complete
    for late in (info(0, 2), blob(_ACTOR), blob(_RIG, "rig")):
        some.add(late)
    assert some.complete


def test_a_take_that_ended_before_its_first_frame_is_complete() -> None:
    assert collection(end(0)).complete
    assert collection(end(0)).recorded() == []


def test_a_take_stopped_early_is_complete_with_what_was_solved() -> None:
    some = collection(info(0, 100), pose(0), blob(_ACTOR), blob(_RIG, "rig"), end(1))
    assert some.complete
    assert len(some.recorded()) == 1


@settings(max_examples=100, deadline=None)
@given(st.permutations(range(3, 9)), st.lists(st.integers(3, 8), max_size=6), st.integers(0, 6))
def test_asking_for_gaps_completes_in_any_order(order: list[int], repeats: list[int], known: int) -> None:
    some = collection(info(3, 9), blob(_ACTOR), blob(_RIG, "rig"))
    for frame in [*order[:known], *repeats[:known]]:
        some.add(pose(frame))
    some.add(end(9))
    asked = 0
    while (gap := some.missing_frames()) is not None:
        first, last = gap
        assert first < last
        assert not {message.frame for message in some.recorded()} & set(range(first, last))
        some.add(pose(last - 1))
        asked += 1
    assert asked <= 6
    assert some.complete
    assert [message.frame for message in some.recorded()] == list(range(3, 9))


def test_another_run_begins_anew() -> None:
    some = collection(info(), pose(0), blob(_ACTOR), info(run=OTHER))
    assert some.recorded() == []
    assert some.missing_blobs() == [hash_of(_ACTOR), hash_of(_RIG)]
    some.add(pose(0, run=OTHER))
    assert [message.run for message in some.recorded()] == [OTHER]


def test_another_run_lacks_no_settled_pose_before_it_has_one() -> None:
    some = collection(info(), pose(0), end(1, settled=True), info(run=OTHER))
    some.add(pose(0, run=OTHER))
    assert some.missing_settled() is None


def test_messages_of_other_runs_are_dropped_and_counted() -> None:
    some = collection(info(), pose(0), pose(1, run=OTHER), end(1, run=OTHER))
    assert len(some.recorded()) == 1
    assert not some.complete
    assert some.foreign == 2


def test_another_recorder_goes_on_with_the_journal(tmp_path: Path) -> None:
    parts: list[TakeInfo | Pose | Blob] = [
        info(3, 9),
        blob(_ACTOR),
        blob(_RIG, "rig"),
        pose(3),
        pose(4),
        pose(6),
    ]
    first = store(tmp_path)
    one = Collection(first)
    for message in parts:
        one.add(message)
    before = one.recording("walk")
    first.close(remove=False)
    two = Collection(store(tmp_path))
    assert encode(two.recording("walk")) == encode(before)
    assert two.missing_frames() == (5, 6)
    assert two.missing_blobs() == []
    assert [message.frame for message in two.recorded()] == [3, 4]
    assert not two.complete
    assert not two.is_announced
    two.add(info(3, 9))
    assert two.is_announced
    assert len(two.recorded()) == 2


def test_a_journal_of_the_whole_take_is_complete(tmp_path: Path) -> None:
    first = store(tmp_path)
    one = Collection(first)
    one_way = info(0, 2, search={"both_ways": False})
    for message in (one_way, blob(_ACTOR), blob(_RIG, "rig"), pose(1), pose(0)):
        one.add(message)
    assert not one.complete
    first.close(remove=False)
    assert Collection(store(tmp_path)).complete


def test_live_poses_are_settled_as_far_as_settled_ones_came() -> None:
    live = info(0, OPEN_END)
    one = collection(live, blob(_ACTOR), blob(_RIG, "rig"), pose(0), pose(1), pose(2), settled(0), settled(1))
    assert [message.settled for message in one.recorded()] == [True, True, False]
    one.add(end(3))
    assert one.complete


def test_settled_poses_replace_the_first_ones_once_all_are_here(tmp_path: Path) -> None:
    first = store(tmp_path)
    one = Collection(first)
    for message in (info(0, 2), blob(_ACTOR), blob(_RIG, "rig"), pose(0), pose(1), settled(1)):
        one.add(message)
    assert one.missing_settled() == (0, 1)
    one.add(end(2, settled=True))
    assert one.missing_frames() is None
    assert one.missing_settled() == (0, 1)
    assert not one.complete
    assert [message.settled for message in one.recorded()] == [False, False]
    first.close(remove=False)
    again = Collection(store(tmp_path))
    assert again.missing_settled() == (0, 1)
    assert not again.complete
    again.add(settled(0))
    assert again.missing_settled() is None
    for found, at in zip(again.recorded(), (0, 1), strict=True):
        changed = {"settled": True, "energy_px": 7.0, "pose": found.pose}
        assert encode(found) == encode(pose(at).model_copy(update=changed))
        assert (found.pose == settled(at).pose).all()
    journal = store(tmp_path / "other")
    for message in (info(0, 2), blob(_ACTOR), blob(_RIG, "rig"), pose(0), pose(1), settled(0), settled(1)):
        journal.keep(message)
    journal.close(remove=False)
    assert Collection(store(tmp_path / "other")).complete


def test_a_run_that_was_stopped_has_its_first_poses(tmp_path: Path) -> None:
    one = Collection(store(tmp_path))
    for message in (info(0, 2), blob(_ACTOR), blob(_RIG, "rig"), pose(0), pose(1), settled(0), end(2)):
        one.add(message)
    assert one.complete
    assert [message.energy_px for message in one.recorded()] == [1.0, 1.0]


def test_first_poses_are_sent_back() -> None:
    one = collection(info(), pose(0), pose(1), pose(3), settled(1))
    asked = PoseRequest(run=RUN, first_frame=1, end_frame=9)
    assert [(back.frame, back.settled) for back in one.sent_back(asked)] == [(1, False), (3, False)]
    assert list(one.sent_back(asked.model_copy(update={"run": OTHER}))) == []


def test_a_journal_that_nobody_goes_on_with_is_left_alone(tmp_path: Path) -> None:
    first = store(tmp_path)
    one = Collection(first)
    for message in (info(0, 4), blob(_ACTOR), blob(_RIG, "rig"), pose(0)):
        one.add(message)
    first.close(remove=False)
    second = store(tmp_path)
    two = Collection(second)
    two.add(end(0, run=OTHER))  # the coordinator was stopped before its run's first frame
    assert two.complete
    assert two.n_recorded == 0
    second.close(remove=False)
    assert Collection(store(tmp_path)).n_recorded == 1


def test_what_a_recorder_says_that_it_has() -> None:
    nothing = collection().recording("walk")
    assert (nothing.run, nothing.plan, nothing.end_frame, nothing.poses.shape) == ("", "", 0, (0, N_DOF))
    some = collection(info(2, 9, shards=3), pose(2), blob(_ACTOR), pose(5))
    said = some.recording("walk")
    assert (said.run, said.shards, said.end_frame, said.retries) == (RUN, 3, 3, 2)
    assert said.actor.tobytes().decode() == _ACTOR
    np.testing.assert_array_equal(said.poses, [np.full(N_DOF, 2 / 7)])
    for frame in (3, 4):
        some.add(pose(frame))
    said = some.recording("walk")
    assert (said.end_frame, said.retries, said.memory) == (6, 5, {"tracker": [2, 0, 0, 0], "rest": [5]})
    np.testing.assert_array_equal(said.poses, [np.full(N_DOF, 4 / 7), np.full(N_DOF, 5 / 7)])


@pytest.mark.parametrize(
    "record", [[], [b""], [msgpack.packb({"v": 1, "type": "take_info", "shapes": [], "take": "walk"})]]
)
def test_a_journal_of_another_version_is_dropped(tmp_path: Path, record: list[bytes]) -> None:
    journal = Journal(tmp_path / JOURNAL)
    journal.append(record)
    journal.close()
    assert Collection(store(tmp_path)).info is None


def test_a_live_run_that_is_continued_mixes_no_moments(tmp_path: Path) -> None:
    """Frame 3 was lost, and the coordinator died before it was sent again: from there on, frames are new."""
    first = info(end=OPEN_END, coordinator="a" * 32)
    again = info(end=OPEN_END, coordinator="b" * 32, continued_at=3)
    kept = store(tmp_path)
    some = Collection(kept)
    old = [pose(frame) for frame in (0, 1, 2, 4, 5)]
    for message in (first, blob(_ACTOR), blob(_RIG, "rig"), *old, *map(settled, (0, 1, 4))):
        some.add(message)
    new = [pose(frame, 9.0) for frame in (3, 4)]
    for message in (again, *new, again):
        some.add(message)
    assert some.missing_frames() is None
    energies = [1.0, 1.0, 1.0, 9.0, 9.0]
    assert [one.energy_px for one in some.first_poses()] == energies
    assert some.held_ends == (5, 2)
    kept.close(remove=False)
    reopened = Collection(store(tmp_path))
    assert [one.energy_px for one in reopened.first_poses()] == energies
    reopened.add(again)
    assert [one.energy_px for one in reopened.first_poses()] == energies


def test_a_recorded_run_that_is_continued_keeps_what_came_before() -> None:
    """Its frames are the same whoever solves them."""
    some = collection(info(), *map(pose, (0, 1, 3)))
    some.add(info(coordinator="b" * 32, continued_at=2))
    some.add(pose(2))
    assert some.missing_frames() is None
    assert len(some.first_poses()) == 4
