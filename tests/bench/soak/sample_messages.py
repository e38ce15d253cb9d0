"""One well-formed message of every type, for hostile ones to be made from."""

import numpy as np

from proto.framing import encode
from proto.messages import (
    MESSAGES,
    Beat,
    Blob,
    BlobRequest,
    Credit,
    Hello,
    LimbRefusal,
    LimbResult,
    LimbTask,
    LivePace,
    LiveSilhouettes,
    LiveSources,
    Message,
    Pose,
    PoseRequest,
    Recorded,
    Recording,
    Silhouettes,
    SilhouettesRequest,
    TakeEnd,
    TakeInfo,
    Telemetry,
)
from services.mocap.body.kinematics import N_DOF
from services.mocap.search.settings import SearchSettings

_CAMERAS = 8
_HASH = "0" * 64
_RUN = "f" * 32
"""No real run has it."""
_SEEN, _UNSURE = np.ones((1, 12, 16), np.uint8), np.full((1, 12, 16), 2, np.uint8)
"""Silhouettes of two cameras, and their unsure pixels."""
_PASS = 1_000_003
"""No task of a real run has it."""


def _of_limbs(take: str, frame: int) -> list[Message]:
    ids = {
        "take": take,
        "run": _RUN,
        "frame": frame,
        "pass_index": _PASS,
        "limb": "left_arm",
        "shard": 0,
        "shards": 1,
    }
    measured = {"energy_px": 120.5, "evaluations": 900, "seconds": 0.05, "backend": "cpu"}
    task = LimbTask.model_validate(
        ids
        | {
            "actor": _HASH,
            "rig": _HASH,
            "search": SearchSettings().model_dump(mode="json"),
            "pose": np.zeros(N_DOF),
            "origin_px": np.zeros((_CAMERAS, 2), np.int32),
            "window": np.zeros((1, 16, 16), np.uint8),
            "unsure": np.ones((1, 16, 16), np.uint8),
        }
    )
    result = LimbResult.model_validate(ids | measured | {"values": np.zeros(7)})
    return [task, result, LimbRefusal.model_validate(ids | {"reason": "cannot"})]


def _of_takes(take: str, frame: int) -> list[Message]:
    info = {
        "run": _RUN,
        "plan": _HASH,
        "shards": 1,
        "first_frame": 0,
        "end_frame": 9,
        "actor": _HASH,
        "rig": _HASH,
        "backend": "cpu",
    }
    info |= {"fps": 15.0, "backend_reason": "no GPU", "threads": 1}
    info |= {"search": SearchSettings().model_dump(mode="json")}
    solved: dict[str, object] = {
        "frame": frame,
        "time_s": 0.5,
        "energy_px": 900.0,
        "passes": 2,
        "evaluations": 9000,
        "workers": 4,
    }
    solved |= {"retries": 0, "backend": "cpu", "worker_backends": {"cpu": 8}, "seconds": {"torso": 0.1}}
    return [
        Silhouettes(take=take, run=_RUN, frame=frame, cameras=[0, 1], planes=_SEEN, unsure=_UNSURE),
        Credit(take=take, run=_RUN, next_frame=frame, end_frame=frame + 8),
        TakeInfo.model_validate({"take": take} | info),
        Pose.model_validate({"take": take, "run": _RUN} | solved | {"pose": np.zeros(N_DOF)}),
        TakeEnd(take=take, run=_RUN, first_frame=0, end_frame=frame),
    ]


def _recording(take: str, frame: int) -> Recording:
    return Recording(
        take=take,
        run=_RUN,
        plan=_HASH,
        shards=1,
        end_frame=frame,
        retries=0,
        worker_backends={"cpu": 8},
        memory={"rest": [0, 3]},
        poses=np.zeros((2, N_DOF)),
        actor=np.frombuffer(b"height = 1.8\n", np.uint8),
    )


def _telemetry(take: str, frame: int) -> Telemetry:
    return Telemetry(
        take=take,
        run=_RUN,
        stage="tracking",
        first_frame=0,
        next_frame=frame,
        end_frame=frame + 9,
        frames_ready=2,
        unrecorded=1,
        deadline_s=0.7,
        tasks_waiting=0,
        workers={"limb_worker@somewhere:1": "cpu"},
        limbs={"limb_worker@somewhere:1": "left_arm"},
        recorders={"recorder@somewhere:2": frame},
        counts={"retries": 0},
        seconds={"torso": 0.1},
    )


def _of_live(take: str, shot: int) -> list[Message]:
    cameras, clock = [0, 1], {"asked_s": 10.0, "take": take}
    return [
        LiveSilhouettes(
            take=take,
            run=_RUN,
            shot=shot,
            cameras=cameras,
            times_s=[10.0, 10.01],
            planes=_SEEN,
            unsure=_UNSURE,
        ),
        LiveSources.model_validate(
            clock
            | {"cameras": cameras, "latest_s": [9.9, 9.91], "missed": [0, 3], "dropped": [1, 1]}
            | {"unsent": 2, "absent": [1], "ended": False}
        ),
        LivePace.model_validate(
            clock
            | {"run": _RUN, "answered_s": 12.0, "clock": "somewhere", "shot": shot}
            | {"shot_s": 12.01, "period_s": 0.04}
        ),
    ]


def sample_messages(take: str, frame: int) -> dict[str, list[bytes]]:
    """The frames of a message of every type, about a take and a frame of it."""
    others: list[Message] = [
        Hello(role="limb_worker", name="limb_worker@somewhere:1", backend="cpu"),
        Beat(),
        BlobRequest(hash=_HASH),
        Blob(hash=_HASH, kind="rig", content=np.frombuffer(b"{}", np.uint8)),
        _recording(take, frame),
        _telemetry(take, frame),
        *_of_live(take, frame),
        PoseRequest(run=_RUN, first_frame=0, end_frame=frame),
        SilhouettesRequest(frame=frame),
        Recorded(run=_RUN, end_frame=frame),
    ]
    messages = [*_of_limbs(take, frame), *_of_takes(take, frame), *others]
    made = {message.type: [bytes(part) for part in encode(message)] for message in messages}
    assert made.keys() == MESSAGES.keys()
    return made
