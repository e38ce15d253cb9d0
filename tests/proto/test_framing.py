"""Messages survive the wire unchanged, and nothing goes out that a receiver would refuse."""

from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from wire_model import messages

from proto.framing import MAX_HEADER_BYTES, MalformedMessage, decode, encode
from proto.messages import (
    MESSAGES,
    PROTOCOL_VERSION,
    Beat,
    LimbRefusal,
    LimbResult,
    LimbTask,
    Message,
    Setting,
    Silhouettes,
    TakeInfo,
    arrays_of,
)

_TASK: dict[str, Any] = {
    "take": "walk", "run": "0" * 32, "frame": 3, "pass_index": 1, "limb": "left_leg", "shard": 0, "shards": 1,
}  # fmt: skip


def over_the_wire(message: Message) -> Message:
    return decode([bytes(frame) for frame in encode(message)])


def assert_same(one: Message, other: Message) -> None:
    assert type(one) is type(other)
    for name in type(one).model_fields:
        ours, theirs = getattr(one, name), getattr(other, name)
        if name in arrays_of(type(one)):
            assert ours.dtype == theirs.dtype and ours.shape == theirs.shape
            assert ours.tobytes() == theirs.tobytes()
        else:
            assert ours == theirs and type(ours) is type(theirs)


@pytest.mark.parametrize("name", MESSAGES)
def test_every_type_survives(name: str) -> None:
    @settings(max_examples=40, deadline=None)
    @given(messages((MESSAGES[name],)))
    def survives(message: Message) -> None:
        assert_same(message, over_the_wire(message))

    survives()


def test_header_says_version_type_and_shapes() -> None:
    task = LimbTask(
        **_TASK, actor="a" * 64, rig="b" * 64, search={}, pose=np.zeros(34),
        origin_px=np.zeros((8, 2), np.int32), window=np.zeros((1, 4, 6), np.uint8),
    )  # fmt: skip
    header, *frames = encode(task)
    fields = msgpack.unpackb(header)
    assert (fields["v"], fields["type"]) == (PROTOCOL_VERSION, "limb_task")
    assert fields["shapes"] == [[34], [8, 2], [1, 4, 6], [0, 4, 6], [0, 1, 4, 6]]
    assert [len(frame) for frame in frames] == [34 * 8, 8 * 2 * 4, 24, 0, 0]
    assert not set(fields) & set(arrays_of(LimbTask))


def test_settings_keep_their_kinds() -> None:
    search: dict[str, Setting] = {
        "a": 1,
        "b": 1.0,
        "c": True,
        "d": "x",
        "e": [1, 2],
        "f": [1.0, 2.5],
        "g": [],
    }
    info = TakeInfo(
        take="t",
        run="0" * 32,
        fps=25.0,
        first_frame=0,
        end_frame=9,
        plan="2" * 64,
        shards=1,
        actor="0" * 64,
        rig="1" * 64,
        backend="cpu",
        backend_reason="asked for",
        threads=1,
        search=search,
    )
    back = over_the_wire(info)
    assert isinstance(back, TakeInfo)
    assert {name: repr(value) for name, value in back.search.items()} == {
        k: repr(v) for k, v in search.items()
    }


def test_arrays_are_sent_whatever_their_order_in_memory() -> None:
    planes = np.arange(24, dtype=np.uint8).reshape(2, 3, 4).transpose(0, 2, 1)
    pose = np.arange(70.0)[::2].astype(">f8").astype("<f8")
    task = LimbTask(
        **_TASK, actor="a" * 64, rig="b" * 64, search={}, pose=pose,
        origin_px=np.arange(16, dtype=np.int32)[::-1].reshape(8, 2), window=planes,
    )  # fmt: skip
    back = over_the_wire(task)
    assert isinstance(back, LimbTask)
    np.testing.assert_array_equal(back.window, planes)
    np.testing.assert_array_equal(back.pose, pose)
    np.testing.assert_array_equal(back.origin_px, task.origin_px)


def _result(**changed: Any) -> LimbResult:
    fields = {
        **_TASK,
        "energy_px": 1.0,
        "evaluations": 1,
        "seconds": 0.5,
        "backend": "cpu",
        "values": np.zeros(6),
    }
    return LimbResult(**{**fields, **changed})


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        (np.zeros((2, 3)), "limb_result.values: expected 1 dimensions"),
        (np.zeros(6, np.float32), "limb_result.values: expected an array of float64, got float32"),
        (np.array([0.0, np.nan]), "limb_result.values: holds a number that is not finite"),
        (np.array([np.inf]), "limb_result.values: holds a number that is not finite"),
    ],
)
def test_what_nobody_would_take_is_not_sent(values: Any, reason: str) -> None:
    with pytest.raises(MalformedMessage) as refused:
        encode(_result(values=values))
    assert str(refused.value) == reason


def test_sizes_are_bounded_for_senders_too() -> None:
    with pytest.raises(MalformedMessage, match=r"^silhouettes\.planes: 134217728 bytes; at most 67108864$"):
        encode(
            Silhouettes(
                take="t", run="0" * 32, frame=0, cameras=[0], planes=np.zeros((2, 8192, 8192), np.uint8)
            )
        )
    many: dict[str, Setting] = {f"{k:03d}" + "x" * 190: "y" * 200 for k in range(100)}
    full = TakeInfo(
        take="t", run="0" * 32, fps=1.0, first_frame=0, end_frame=1, plan="2" * 64, shards=1,
        actor="0" * 64, rig="0" * 64, backend="b", backend_reason="", threads=0, search=many,
    )  # fmt: skip
    assert len(encode(full)[0]) < MAX_HEADER_BYTES
    with pytest.raises(MalformedMessage, match=r"^take_info: a header of"):
        encode(full.model_copy(update={"search": {name: ["😀" * 200] * 4 for name in many}}))


def test_what_was_received_cannot_be_changed() -> None:
    back = over_the_wire(_result())
    assert isinstance(back, LimbResult)
    with pytest.raises(ValueError, match="read-only"):
        back.values[0] = 1.0
    with pytest.raises(ValueError, match="frozen"):
        back.frame = 5  # type: ignore[misc]


def test_messages_without_arrays_are_one_frame() -> None:
    assert len(encode(Beat())) == 1
    assert len(encode(LimbRefusal(**_TASK, reason=""))) == 1
