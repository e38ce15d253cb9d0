"""A coordinator that solves nothing: it sends known poses of a take, and answers what viewers ask for."""

import threading
import time
from typing import Self

import numpy as np
import zmq

from proto.messages import (
    Blob,
    BlobRequest,
    Message,
    Pose,
    PoseRequest,
    Silhouettes,
    SilhouettesRequest,
    TakeEnd,
    TakeInfo,
)
from proto.sockets import bind, make_socket, receive_from, send, wait
from proto.streams import stream_endpoint
from services.mocap.body.actor import build_body
from services.mocap.camera.rig import Rig
from services.mocap.export.model_painter import ModelPainter
from services.mocap.search.settings import SearchSettings
from services.mocap.take.actor_file import take_actor
from services.mocap.take.folder import Take
from services.mocap.take.marks import PARTS
from services.mocap.take.tables import read_poses_csv
from services.segmentation.source import packed

_INFO_S = 0.3

RUN = "0" * 32


class Playback:
    """Sends a frame more every period, round and round, from a thread of its own; a context manager."""

    def __init__(
        self, take: Take, endpoint: str, *, frames: int = 10_000, period_s: float = 0.1, waits: bool = False
    ) -> None:
        """frames: how many the take pretends to have; its poses repeat.

        waits: no frame is sent before somebody has asked for something.
        """
        self._waits = waits
        actor = take_actor(take)
        assert actor is not None
        self.endpoint, self._take, self._period_s, self.frames = endpoint, take, period_s, frames
        self._rig, self._n = Rig.of(take.cameras), take.settings.frames
        self._poses_of = read_poses_csv(take.folder / "reference" / "poses.csv").poses
        self._painter = ModelPainter(build_body(actor), self._rig)
        contents = {"actor": actor.to_toml().encode(), "rig": self._rig.to_json().encode()}
        hashes = {"actor": actor.content_hash, "rig": self._rig.content_hash}
        self._blobs = {
            hashes[kind]: Blob(hash=hashes[kind], kind=kind, content=np.frombuffer(content, np.uint8))
            for kind, content in contents.items()
        }
        self._info = TakeInfo(
            take=take.settings.name, run=RUN, fps=take.settings.fps, first_frame=0, end_frame=frames,
            plan="0" * 64, shards=1,
            actor=hashes["actor"], rig=hashes["rig"], backend="cpu", backend_reason="test", threads=1,
            search=SearchSettings().to_wire(),
        )  # fmt: skip
        self.next_frame = 0
        self.asked: list[Message] = []
        """What viewers asked for."""
        self.distrusted: list[str] = []
        self.forgotten_end = 0
        """It has no frames before this one any more."""
        self._ending = threading.Event()

    def pose(self, frame: int) -> Pose:
        """A frame's message."""
        return Pose(
            take=self._take.settings.name, run=RUN, frame=frame, time_s=frame / self._take.settings.fps,
            energy_px=500 + 50 * np.sin(frame / 5), passes=1, evaluations=10, workers=4, retries=0,
            backend="cpu", worker_backends={}, seconds={"torso": 0.02, "limbs": 0.01, "frame": 0.04},
            prior=1.0, confidence={"torso": 0.9, "left_arm": 0.7}, distrusted=self.distrusted,
            part_px={part: round(50 + 10 * k * np.sin(frame / 9)) for k, part in enumerate(PARTS)},
            iou=[0.9] * len(self._take.cameras),
            pose=self._poses_of[frame % self._n],
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
        told_s = sent_s = 0.0
        while not self._ending.is_set():
            now = time.monotonic()
            if now - told_s > _INFO_S:
                send(self._publisher, self._info)
                told_s = now
            is_held = self._waits and not self.asked
            if now - sent_s > self._period_s and self.next_frame < self.frames and not is_held:
                send(self._publisher, self.pose(self.next_frame))
                self.next_frame, sent_s = self.next_frame + 1, now
                if self.next_frame == self.frames:
                    send(
                        self._publisher,
                        TakeEnd(take=self._info.take, run=RUN, first_frame=0, end_frame=self.frames),
                    )
            wait([self._router], min(self._period_s, 0.02))
            while (arrived := receive_from(self._router)) is not None:
                self.asked.append(arrived[1])
                for answer in self._answers(arrived[1]):
                    send(self._router, answer, arrived[0])

    def _answers(self, message: Message) -> list[Message]:
        if isinstance(message, BlobRequest):
            return [self._blobs[message.hash]]
        if isinstance(message, PoseRequest):
            end = min(message.end_frame, message.first_frame + 64, self.next_frame)
            return [self.pose(frame) for frame in range(max(message.first_frame, self.forgotten_end), end)]
        if isinstance(message, SilhouettesRequest):
            return [self.silhouettes(message.frame)]
        return []

    def silhouettes(self, frame: int) -> Silhouettes:
        """What the cameras would see if the model were right, but for a missing band."""
        masks = [mask > 0 for mask in self._painter.segment_masks(self._poses_of[frame % self._n])]
        for mask in masks:
            mask[: mask.shape[0] // 3] = False
        height, width = self._rig.shape_px
        cameras = list(range(len(masks)))
        planes = packed(masks, width, height)
        return Silhouettes(take=self._info.take, run=RUN, frame=frame, cameras=cameras, planes=planes)
