"""Frames are put together from any number of senders, whole and in order, in bounded memory."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from proto.messages import Silhouettes
from services.coordinator.incoming import Frame, RecordedFrames
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import pack, unpack
from services.mocap.types import Bytes, Mask

_HEIGHT_PX, _WIDTH_PX = 4, 6
_N_CAMERAS = 10
_FPS = 25.0
_RUN, _OTHER = "0" * 32, "1" * 32
_GROUPS = ([0, 1, 2, 3, 4, 5, 6, 7, 8], [9])


def make_rig(n_cameras: int = _N_CAMERAS) -> Rig:
    sizes_px = np.array([[_WIDTH_PX, _HEIGHT_PX]] * n_cameras, np.int32)
    return Rig(np.ones((n_cameras, 3, 4)), sizes_px)


def begun(first: int = 0, end: int = 20) -> RecordedFrames:
    frames = RecordedFrames("walk", make_rig(), range(first, end), _FPS)
    frames.begin(_RUN, first)
    return frames


def masks_of(frame: int) -> Mask:
    rng = np.random.default_rng(frame)
    return rng.random((_N_CAMERAS, _HEIGHT_PX, _WIDTH_PX)) < 0.5


def message(
    frame: int, cameras: list[int], take: str = "walk", planes: Bytes | None = None, run: str = _RUN
) -> Silhouettes:
    sent = pack(masks_of(frame)[cameras]) if planes is None else planes
    return Silhouettes(take=take, run=run, frame=frame, cameras=cameras, planes=sent)


def assert_frame(found: Frame | None, frame: int) -> None:
    assert found is not None
    assert (found.shot, found.time_s) == (frame, frame / _FPS)
    seen = found.seen
    assert seen.silhouettes.dtype == np.uint8
    np.testing.assert_array_equal(seen.silhouettes, pack(masks_of(frame)))
    assert not seen.unsure.any()


def test_one_group_with_cameras_in_any_order() -> None:
    frames = begun()
    cameras = [3, 9, 0, 8, 1, 7, 2, 6, 4, 5]
    frames.add(message(0, cameras))
    assert_frame(frames.take_next(), 0)
    assert frames.take_next() is None
    assert frames.next_frame == 1


def test_a_frame_waits_for_every_group() -> None:
    frames = begun()
    frames.add(message(0, _GROUPS[0]))
    assert frames.take_next() is None
    assert frames.waiting_for() == [9]
    frames.add(message(0, _GROUPS[1]))
    assert frames.waiting_for() == []
    assert_frame(frames.take_next(), 0)
    assert frames.waiting_for() == list(range(_N_CAMERAS))


@settings(max_examples=60, deadline=None)
@given(st.permutations([(frame, group) for frame in range(3, 8) for group in (0, 1)]), st.data())
def test_any_order_and_any_repeats_give_frames_in_order(
    order: list[tuple[int, int]], data: st.DataObject
) -> None:
    frames = begun(3, 8)
    out: list[Frame] = []
    repeats = data.draw(st.lists(st.sampled_from(order), max_size=5))
    for frame, group in [*order, *repeats]:
        frames.add(message(frame, _GROUPS[group]))
        while (found := frames.take_next()) is not None:
            assert_frame(found, 3 + len(out))
            out.append(found)
    assert len(out) == 5
    assert frames.next_frame == 8


def test_a_group_that_sends_twice_is_not_counted_twice() -> None:
    frames = begun()
    for _ in range(3):
        frames.add(message(0, _GROUPS[0]))
    assert frames.take_next() is None
    assert frames.waiting_for() == [9]


@pytest.mark.parametrize(
    "foreign",
    [
        message(0, _GROUPS[0], take="run"),
        message(0, _GROUPS[0], run=_OTHER),
        message(8, _GROUPS[0]),
        message(2**31 - 1, _GROUPS[0]),
        message(0, [0, 10], planes=np.zeros((1, _HEIGHT_PX, _WIDTH_PX), np.uint8)),
        message(0, [0, 0], planes=np.zeros((1, _HEIGHT_PX, _WIDTH_PX), np.uint8)),
        message(0, [0], planes=np.zeros((2, _HEIGHT_PX, _WIDTH_PX), np.uint8)),
        message(0, list(range(9)), planes=np.zeros((1, _HEIGHT_PX, _WIDTH_PX), np.uint8)),
        message(0, [0], planes=np.zeros((1, _WIDTH_PX, _HEIGHT_PX), np.uint8)),
        message(0, [0], planes=np.zeros((0, 0, 0), np.uint8)),
    ],
)
def test_what_is_not_wanted_is_counted_and_changes_nothing(foreign: Silhouettes) -> None:
    frames = begun()
    frames.add(foreign)
    assert frames.dropped == 1
    assert frames.waiting_for() == list(range(_N_CAMERAS))


def test_frames_that_were_handed_out_are_over() -> None:
    frames = begun()
    frames.add(message(0, list(range(_N_CAMERAS))))
    assert_frame(frames.take_next(), 0)
    frames.add(message(0, list(range(_N_CAMERAS))))
    assert frames.dropped == 1
    assert frames.take_next() is None


def test_nothing_beyond_the_take_and_nothing_beyond_credit() -> None:
    frames = begun(0, 2)
    for frame in range(4):
        frames.add(message(frame, list(range(_N_CAMERAS))))
    assert frames.dropped == 2
    assert_frame(frames.take_next(), 0)
    assert_frame(frames.take_next(), 1)
    assert frames.take_next() is None


def test_what_is_kept_is_bounded_by_credit() -> None:
    frames = begun(0, 10_000)
    for frame in range(1, 1000):  # frame 0 never comes
        frames.add(message(frame, [0]))
    assert frames.dropped == 1000 - 8
    assert frames.take_next() is None
    assert len(frames._partial) == 7


def test_unused_bits_do_not_matter() -> None:
    frames = begun()
    dirty = pack(masks_of(0)[[9]]) | np.uint8(0b1111_1110)
    frames.add(message(0, _GROUPS[0]))
    frames.add(message(0, _GROUPS[1], planes=dirty))
    found_frame = frames.take_next()
    assert found_frame is not None
    seen = found_frame.seen
    np.testing.assert_array_equal(unpack(seen.silhouettes, _N_CAMERAS), masks_of(0))
    assert not np.any(seen.silhouettes[1] & 0b1111_1100)


def unsure_message(unsure: Bytes) -> Silhouettes:
    """Of the cameras of the first group in frame 0, with such unsure planes."""
    return message(0, _GROUPS[0]).model_copy(update={"unsure": unsure})


def test_unsure_pixels_come_through_and_win() -> None:
    frames, rng = begun(), np.random.default_rng(5)
    planes = message(0, _GROUPS[0]).planes
    unsure = planes & rng.integers(0, 256, planes.shape, np.uint8)  # each of them is set in both
    frames.add(unsure_message(unsure))
    frames.add(message(0, _GROUPS[1]))
    found_frame = frames.take_next()
    assert found_frame is not None
    seen = found_frame.seen
    found, expected = unpack(seen.unsure, _N_CAMERAS), unpack(unsure, len(_GROUPS[0]))
    np.testing.assert_array_equal(found[_GROUPS[0]], expected)
    assert not found[_GROUPS[1]].any()
    silhouettes = masks_of(0)
    silhouettes[_GROUPS[0]] &= ~expected
    np.testing.assert_array_equal(unpack(seen.silhouettes, _N_CAMERAS), silhouettes)


@pytest.mark.parametrize("shape", [(1, 4, 6), (3, 4, 6), (2, 6, 4)])
def test_unsure_planes_that_do_not_fit_are_dropped_and_counted(shape: tuple[int, int, int]) -> None:
    frames = begun()
    frames.add(unsure_message(np.zeros(shape, np.uint8)))
    assert frames.dropped == 1
    assert 0 in frames.waiting_for()


def test_nothing_counts_before_the_run_has_begun() -> None:
    frames = RecordedFrames("walk", make_rig(), range(20), _FPS)
    frames.add(message(0, list(range(_N_CAMERAS))))
    assert frames.dropped == 1
    assert frames.take_next() is None


def test_credit_goes_from_the_first_frame_that_lacks_a_camera() -> None:
    frames = begun(3, 13)
    frames.add(message(3, list(range(_N_CAMERAS))))
    frames.add(message(4, _GROUPS[0]))
    credit = frames.credit()
    assert (credit.next_frame, credit.end_frame, frames.n_ready) == (4, 11, 1)
    frames.take_next()
    assert (frames.credit().next_frame, frames.credit().end_frame, frames.n_ready) == (4, 12, 0)
