"""How many bytes a limb task costs on the wire beyond the windows themselves."""

import numpy as np
import pytest

from proto.framing import encode
from proto.messages import Beat, LimbResult, LimbTask, Message
from services.mocap.body.kinematics import N_DOF
from services.mocap.search.settings import SearchSettings

_BUDGET_BYTES = 2304
_FRAME_BYTES = 9 + 33
"""What ZMTP (a long frame's flags and length) and CURVE (nonce, tag, command) may add to a frame."""
_LONG_NAME = "a-take-with-a-name-of-forty-characters--"


def wire_bytes(message: Message, but: str = "") -> int:
    """Bytes on the wire, encrypted, without the content of one array field."""
    frames = encode(message)
    left_out = getattr(message, but).nbytes if but else 0
    return sum(len(frame) + _FRAME_BYTES for frame in frames) - left_out


@pytest.mark.parametrize("cameras", [4, 8, 16])
def test_a_limb_task_costs_less_than_nine_quarters_of_a_kilobyte_beyond_its_windows(cameras: int) -> None:
    ids = {
        "take": _LONG_NAME,
        "run": "f" * 32,
        "frame": 99_999,
        "pass_index": 9_001,
        "limb": "right_arm",
        "shard": 7,
        "shards": 8,
    }
    settings = SearchSettings(camera_weights=(0.123456789,) * cameras)
    task = LimbTask.model_validate(
        ids
        | {
            "actor": "a" * 64,
            "rig": "b" * 64,
            "search": settings.model_dump(mode="json"),
            "pose": np.full(N_DOF, 0.1),
            "origin_px": np.full((cameras, 2), 100, np.int32),
            "window": np.ones((-(-cameras // 8), 128, 128), np.uint8),
        }
    )
    result = LimbResult.model_validate(
        ids | {"energy_px": 123.4, "evaluations": 99_999, "seconds": 0.123, "backend": "cpu"}
        | {"values": np.full(7, 0.1)}
    )  # fmt: skip
    beats = 2 * wire_bytes(Beat())
    assert wire_bytes(task, but="window") + wire_bytes(result) + beats < _BUDGET_BYTES
