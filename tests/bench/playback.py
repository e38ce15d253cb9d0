"""A coordinator that only plays back a take's known poses, to measure and to test what follows one."""

import threading
import time
from typing import Self

import numpy as np
import zmq

from proto.messages import Blob, BlobRequest, Message, Pose, PoseRequest, TakeEnd, TakeInfo
from proto.sockets import bind, make_socket, send, wait
from proto.streams import stream_endpoint
from router import receive_from
from services.mocap.camera.rig import Rig
from services.mocap.errors import UserError
from services.mocap.search.settings import SearchSettings
from services.mocap.take.actor_file import take_actor
from services.mocap.take.folder import Take
from services.mocap.take.layout import ACTOR
from services.mocap.take.marks import PARTS
from services.mocap.take.tables import read_poses_csv
from services.mocap.types import Bytes

RUN = "0" * 32
_INFO_S = 0.3
_ANSWERED_FRAMES = 64
_LOOK_S = 0.02


class Playback:
    """Sends a frame more every period, round and round, from a thread of its own; a context manager."""

    def __init__(self, take: Take, endpoint: str, *, frames: int = 10_000, period_s: float = 0.1) -> None:
        """frames: how many the take pretends to have; its poses repeat.

        Raises UserError for a take without an actor or without reference/poses.csv.
        """
        actor, poses = take_actor(take), take.folder / "reference" / "poses.csv"
        if actor is None or not poses.exists():
            raise UserError(f"{take.folder}: has no {ACTOR} or no reference/poses.csv: expected both")
        self.endpoint, self.frames, self._take, self._period_s = endpoint, frames, take, period_s
        self._poses = read_poses_csv(poses).poses
        rig = Rig.of(take.cameras)
        blobs = (
            Blob(hash=actor.content_hash, kind="actor", content=_bytes(actor.to_toml())),
            Blob(hash=rig.content_hash, kind="rig", content=_bytes(rig.to_json())),
        )
        self._blobs = {blob.hash: blob for blob in blobs}
        self._info = TakeInfo(
            take=take.settings.name, run=RUN, fps=take.settings.fps, first_frame=0, end_frame=frames,
            plan="0" * 64, shards=1,
            actor=actor.content_hash, rig=rig.content_hash, backend="cpu", backend_reason="none",
            threads=1, search=SearchSettings().model_dump(mode="json"),
        )  # fmt: skip
        self.next_frame = 0
        self.sent_s: dict[int, float] = {}
        """When each frame was sent (time.monotonic)."""
        self._ending = threading.Event()

    def pose(self, frame: int) -> Pose:
        """A frame's message."""
        return Pose(
            take=self._take.settings.name, run=RUN, frame=frame, time_s=frame / self._take.settings.fps,
            energy_px=500 + 50 * np.sin(frame / 5), passes=1, evaluations=10, workers=4, retries=0,
            backend="cpu", worker_backends={}, seconds={"torso": 0.02, "limbs": 0.01, "frame": 0.04},
            confidence={"torso": 0.9, "left_arm": 0.7}, distrusted=[],
            measured={
                "prior": [1.0], "iou": [0.9] * len(self._take.cameras),
                "part_px": [float(round(50 + 10 * k * np.sin(frame / 9))) for k in range(len(PARTS))],
            },
            pose=self._poses[frame % len(self._poses)],
        )  # fmt: skip

    def __enter__(self) -> Self:
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._publisher = make_socket(self._context, zmq.PUB)
        self._router = make_socket(self._context, zmq.ROUTER)
        bind(self._publisher, stream_endpoint(self.endpoint, "poses"))
        bind(self._router, stream_endpoint(self.endpoint, "tasks"))
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self._thread.join()
        self._publisher.close(linger=0)
        self._router.close(linger=0)
        self._context.term()

    def _run(self) -> None:
        told_s = 0.0
        due_s = time.monotonic()
        while not self._ending.is_set():
            now = time.monotonic()
            if now - told_s > _INFO_S:
                send(self._publisher, self._info)
                told_s = now
            if now >= due_s and self.next_frame < self.frames and self._goes_on():
                self._send_frame()
                due_s = max(due_s + self._period_s, now)
            wait([self._router], max(min(due_s - time.monotonic(), _LOOK_S), 0.001))
            while (arrived := receive_from(self._router)) is not None:
                for answer in self._answers(arrived[1]):
                    send(self._router, answer, arrived[0])

    def _goes_on(self) -> bool:
        """Whether a frame may be sent at all now."""
        return True

    def _send_frame(self) -> None:
        frame = self.next_frame
        self.sent_s[frame] = time.monotonic()
        send(self._publisher, self.pose(frame))
        self.next_frame = frame + 1
        if self.next_frame == self.frames:
            end = TakeEnd(take=self._info.take, run=RUN, first_frame=0, end_frame=self.frames)
            send(self._publisher, end)

    def _answers(self, message: Message) -> list[Message]:
        if isinstance(message, BlobRequest):
            return [self._blobs[message.hash]]
        if isinstance(message, PoseRequest):
            end = min(message.end_frame, message.first_frame + _ANSWERED_FRAMES, self.next_frame)
            return [self.pose(frame) for frame in range(message.first_frame, end)]
        return []


def _bytes(text: str) -> Bytes:
    return np.frombuffer(text.encode(), np.uint8)
