"""Whatever comes in, decode returns a message or raises MalformedMessage with a short reason."""

from collections.abc import Callable
from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from wire_model import messages

from proto.framing import MAX_FRAME_BYTES, MAX_HEADER_BYTES, MalformedMessage, decode, encode
from proto.messages import MESSAGES, PROTOCOL_VERSION, Credit, Message, Pose, Silhouettes

Header = dict[str, Any]
_LONGEST_REASON = 300
_D = 30
"""Parameters of a pose; the wire takes any number."""
_POSE_BYTES = 8 * _D
_V = PROTOCOL_VERSION
_OTHER_VERSION = f"protocol version is not {_V}"
_CROWDED = "header holds a list or map of more than 1000 entries"
_NONE = [0, 2, 3]
_NO_4D = [0, 1, 2, 3]
_MOST = MAX_FRAME_BYTES
"""The shape of unsure planes that there are none of."""
_BAD_SIZE = "silhouettes.planes: a size is not an integer in range"


def frames_of(message: Message) -> list[bytes]:
    return [bytes(frame) for frame in encode(message)]


def silhouettes_frames() -> list[bytes]:
    planes = np.ones((1, 2, 3), np.uint8)
    return frames_of(Silhouettes(take="walk", run="0" * 32, frame=7, cameras=[0, 1], planes=planes))


def pose_frames(pose: bytes) -> list[bytes]:
    message = Pose(
        take="walk", run="0" * 32, frame=0, time_s=0.0, energy_px=1.0, passes=1, evaluations=1,
        workers=0, retries=0, backend="cpu", worker_backends={}, seconds={}, pose=np.zeros(_D),
    )  # fmt: skip
    return [frames_of(message)[0], pose, b""]


def reason_for(frames: list[bytes]) -> str:
    with pytest.raises(MalformedMessage) as refused:
        decode(frames)
    assert "\n" not in str(refused.value)
    return str(refused.value)


def with_header(change: Callable[[Header], object], frames: list[bytes]) -> list[bytes]:
    header = msgpack.unpackb(frames[0])
    change(header)
    return [msgpack.packb(header), *frames[1:]]


def silhouettes_with(**changed: Any) -> list[bytes]:
    return with_header(lambda header: header.update(changed), silhouettes_frames())


@pytest.mark.parametrize(
    ("frames", "reason"),
    [
        ([], "the header is missing or too long"),
        ([b""], "header is not msgpack"),
        ([b"\xc1"], "header is not msgpack"),
        ([b"\x81"], "header is not msgpack"),
        ([msgpack.packb({}) + b"\x00"], "header is not msgpack"),
        ([msgpack.packb([1, 2])], "header is not a map with string keys"),
        ([msgpack.packb({b"v": 1})], "header is not a map with string keys"),
        ([msgpack.packb({1: 1})], "header is not msgpack"),
        ([b"\x81\xa1v\x91" + b"\x91" * 5000 + b"\x01"], "header is not msgpack"),
        ([b"\x81\xa1v\xdb\xff\xff\xff\xff"], "header is not msgpack"),
        ([b"\x81\xa1v\xdd\xff\xff\xff\xff"], _CROWDED),
        ([msgpack.packb({"v": _V, "x": [0] * 1001})], _CROWDED),
        ([msgpack.packb({str(k): 0 for k in range(1001)})], _CROWDED),
        ([msgpack.packb({"v": _V, "x": [[{str(k): 0 for k in range(1001)}]]})], _CROWDED),
        ([b"\x81\xa1v\xd5\xff\x00\x00"], "header is not msgpack"),
        ([b"\x81\xa1v\xa1\xff"], "header is not msgpack"),
        ([msgpack.packb({"v": _V, "x": "y" * MAX_HEADER_BYTES})], "the header is missing or too long"),
        ([msgpack.packb({})], _OTHER_VERSION),
        ([msgpack.packb({"v": 1, "type": "beat", "shapes": []})], _OTHER_VERSION),
        ([msgpack.packb({"v": True, "type": "beat", "shapes": []})], _OTHER_VERSION),
        ([msgpack.packb({"v": float(_V), "type": "beat", "shapes": []})], _OTHER_VERSION),
        ([msgpack.packb({"v": _V, "shapes": []})], "unknown message type"),
        ([msgpack.packb({"v": _V, "type": "dance", "shapes": []})], "unknown message type"),
        ([msgpack.packb({"v": _V, "type": ["beat"], "shapes": []})], "unknown message type"),
        ([msgpack.packb({"v": _V, "type": "beat"})], "beat: expected 0 arrays"),
        ([msgpack.packb({"v": _V, "type": "beat", "shapes": [[1]]})], "beat: expected 0 arrays"),
        ([msgpack.packb({"v": _V, "type": "beat", "shapes": {}})], "beat: expected 0 arrays"),
        ([msgpack.packb({"v": _V, "type": "beat", "shapes": []}), b""], "beat: expected 0 arrays"),
    ],
)  # fmt: skip
def test_bad_headers(frames: list[bytes], reason: str) -> None:
    assert reason_for(frames) == reason


@pytest.mark.parametrize(
    ("frames", "reason"),
    [
        (silhouettes_frames()[:1], "silhouettes: expected 3 arrays"),
        ([*silhouettes_frames(), b""], "silhouettes: expected 3 arrays"),
        (
            [silhouettes_frames()[0], b"12345", b"", b""],
            "silhouettes.planes: 5 bytes where the shape needs 6",
        ),
        (
            [silhouettes_frames()[0], b"1234567", b"", b""],
            "silhouettes.planes: 7 bytes where the shape needs 6",
        ),
        (silhouettes_with(shapes=[[6], _NONE, _NO_4D]), "silhouettes.planes: expected 3 dimensions"),
        (silhouettes_with(shapes=[6, _NONE, _NO_4D]), "silhouettes.planes: expected 3 dimensions"),
        (silhouettes_with(shapes=[[1, 2, -3], _NONE, _NO_4D]), _BAD_SIZE),
        (silhouettes_with(shapes=[[1, 2, 3.0], _NONE, _NO_4D]), _BAD_SIZE),
        (silhouettes_with(shapes=[[True, 2, 3], _NONE, _NO_4D]), _BAD_SIZE),
        (silhouettes_with(shapes=[[1, 2, 2**63], _NONE, _NO_4D]), _BAD_SIZE),
        (
            silhouettes_with(shapes=[[_MOST] * 3, [0, _MOST, _MOST], [0, _MOST, _MOST, _MOST]]),
            f"silhouettes.planes: 6 bytes where the shape needs {MAX_FRAME_BYTES**3}",
        ),
        (silhouettes_with(shapes=[[1, 2, 3], [0, 2], _NO_4D]), "silhouettes.unsure: expected 3 dimensions"),
        (silhouettes_with(shapes=[[1, 2, 3], [0, 3, 2], _NO_4D]), "silhouettes.unsure: size 3 where H is 2"),
        (
            silhouettes_with(shapes=[[1, 2, 3], [1, 2, 3], _NO_4D]),
            "silhouettes.unsure: 0 bytes where the shape needs 6",
        ),
        (silhouettes_with(take=""), "silhouettes.take: String should have at least 1 character"),
        (silhouettes_with(take=b"walk"), "silhouettes.take: Input should be a valid string"),
        (silhouettes_with(take=None), "silhouettes.take: Input should be a valid string"),
        (silhouettes_with(frame=-1), "silhouettes.frame: Input should be greater than or equal to 0"),
        (silhouettes_with(frame=2**31), "silhouettes.frame: Input should be less than 2147483648"),
        (silhouettes_with(frame=7.0), "silhouettes.frame: Input should be a valid integer"),
        (silhouettes_with(frame="7"), "silhouettes.frame: Input should be a valid integer"),
        (silhouettes_with(frame=True), "silhouettes.frame: Input should be a valid integer"),
        (
            silhouettes_with(cameras=[]),
            "silhouettes.cameras: List should have at least 1 item after validation, not 0",
        ),
        (silhouettes_with(cameras=[0, "1"]), "silhouettes.cameras.1: Input should be a valid integer"),
        (silhouettes_with(colour="red"), "silhouettes.colour: Extra inputs are not permitted"),
        (
            silhouettes_with(planes="hidden"),
            "silhouettes.planes: belongs in its own frame, not in the header",
        ),
        (
            with_header(lambda header: header.pop("take"), silhouettes_frames()),
            "silhouettes.take: Field required",
        ),
    ],
)  # fmt: skip
def test_bad_fields_and_frames(frames: list[bytes], reason: str) -> None:
    assert reason_for(frames) == reason


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf])
def test_numbers_that_are_not_finite(number: float) -> None:
    pose = np.zeros(_D)
    pose[20] = number
    assert reason_for(pose_frames(pose.tobytes())) == "pose.pose: holds a number that is not finite"
    whole = pose_frames(bytes(_POSE_BYTES))
    for field in ("time_s", "energy_px"):
        changed = with_header(lambda header, field=field: header.update({field: number}), whole)  # type: ignore[misc]
        assert reason_for(changed).startswith(f"pose.{field}: ")
    in_map = with_header(lambda header: header.update(seconds={"torso": number}), whole)
    assert reason_for(in_map).startswith("pose.seconds.torso: ")


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"confidence": {"torso": 1.01}}, "pose.confidence.torso: Input should be less than or equal to 1"),
        ({"confidence": {"tail": 0.5}}, "pose.confidence.tail.[key]: "),
        ({"distrusted": ["tail"]}, "pose.distrusted.0: "),
        ({"distrusted": ["head"] * 7}, "pose.distrusted: List should have at most 6 items"),
    ],
)
def test_marks_of_parts_that_are_none(changed: Header, reason: str) -> None:
    frames = with_header(lambda header: header.update(changed), pose_frames(bytes(_POSE_BYTES)))
    assert reason_for(frames).startswith(reason)


@pytest.mark.parametrize("field", ["confidence", "distrusted"])
def test_what_has_a_default_is_needed_on_the_wire_all_the_same(field: str) -> None:
    frames = with_header(lambda header: header.pop(field), pose_frames(bytes(_POSE_BYTES)))
    assert reason_for(frames) == f"pose.{field}: Field required"


def test_letters_stand_for_one_size() -> None:
    assert reason_for(pose_frames(b"")) == f"pose.pose: 0 bytes where the shape needs {_POSE_BYTES}"
    shorter = with_header(lambda header: header.update(shapes=[[_D - 1], [0, _D]]), pose_frames(b""))
    assert reason_for(shorter) == f"pose.steady: size {_D} where D is {_D - 1}"


def test_a_sender_cannot_fill_the_log() -> None:
    assert len(reason_for(silhouettes_with(**{"x\n" * 20_000: 1}))) < _LONGEST_REASON


def test_whole_numbers_do_for_floats() -> None:
    """Many msgpack libraries write 25.0 as the integer 25."""
    pose = decode(
        with_header(lambda header: header.update(time_s=2, energy_px=3), pose_frames(bytes(_POSE_BYTES)))
    )
    assert isinstance(pose, Pose)
    assert (pose.time_s, pose.energy_px) == (2.0, 3.0)
    assert isinstance(pose.time_s, float)


def decodes_or_is_malformed(frames: list[bytes]) -> None:
    try:
        message = decode(frames)
    except MalformedMessage as error:
        assert len(str(error)) < _LONGEST_REASON
        assert str(error).isprintable()
    else:
        assert decode(frames_of(message)).type == message.type


@settings(max_examples=300, deadline=None)
@given(st.lists(st.binary(max_size=60), max_size=5))
def test_random_bytes(frames: list[bytes]) -> None:
    decodes_or_is_malformed(frames)


_JUNK = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats() | st.text(max_size=8)
    | st.binary(max_size=8) | st.just(msgpack.Timestamp(0)) | st.just(msgpack.ExtType(4, b"\x00")),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4),
    max_leaves=8,
)  # fmt: skip
_FIELDS = sorted(
    {name for message in MESSAGES.values() for name in message.model_fields} | {"shapes", "v", "type"}
)


@settings(max_examples=150, deadline=None)
@given(
    messages(),
    st.dictionaries(st.sampled_from(_FIELDS), _JUNK, max_size=2),
    st.sets(st.sampled_from(_FIELDS), max_size=1),
)
def test_headers_with_junk_in_them(message: Message, junk: Header, left_out: set[str]) -> None:
    header, *frames = frames_of(message)
    fields = {**msgpack.unpackb(header), **junk}
    decodes_or_is_malformed([msgpack.packb({k: v for k, v in fields.items() if k not in left_out}), *frames])


@settings(max_examples=150, deadline=None)
@given(messages(), st.data())
def test_damaged_frames(message: Message, data: st.DataObject) -> None:
    """Frames cut short, lengthened, swapped, repeated, or with some bytes changed."""
    frames = frames_of(message)
    k = data.draw(st.integers(0, len(frames) - 1))
    damaged = bytearray(frames[k])
    for _ in range(data.draw(st.integers(0, 3))):
        if damaged:
            damaged[data.draw(st.integers(0, len(damaged) - 1))] = data.draw(st.integers(0, 255))
    end = data.draw(st.integers(0, len(damaged)))
    frames[k] = bytes(damaged[:end]) + data.draw(st.binary(max_size=3))
    decodes_or_is_malformed(data.draw(st.permutations(frames)) if data.draw(st.booleans()) else frames)


@settings(max_examples=300, deadline=None)
@given(st.lists(st.lists(st.integers(-1, MAX_FRAME_BYTES) | st.integers(0, 8), max_size=5), max_size=4))
@example([[0, MAX_FRAME_BYTES, MAX_FRAME_BYTES]] * 2)
def test_any_shapes(shapes: list[list[int]]) -> None:
    decodes_or_is_malformed(silhouettes_with(shapes=shapes))
    decodes_or_is_malformed([silhouettes_with(shapes=shapes)[0], b"", b""])


def test_reading_on_after_malformed_ones() -> None:
    good = frames_of(Credit(take="walk", run="0" * 32, next_frame=0, end_frame=8))
    reason_for([b"junk", *good])
    assert decode(good) == Credit(take="walk", run="0" * 32, next_frame=0, end_frame=8)
