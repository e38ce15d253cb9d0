"""The coordinator's outgoing messages about its take."""

import secrets
import time
from itertools import islice
from typing import Literal, TypeVar

import numpy as np

from proto.messages import (
    LONGEST_REASON,
    MAX_TOLD,
    Blob,
    CoordinatorStage,
    Pose,
    Silhouettes,
    TakeEnd,
    TakeInfo,
    Telemetry,
)
from services.coordinator.incoming import Frame
from services.coordinator.plan import Plan
from services.coordinator.switchboard import Switchboard
from services.mocap.body.actor import Actor
from services.mocap.energy.engine import Engine
from services.mocap.motion.smoothing import OneEuro
from services.mocap.search.found import FrameSolution
from services.mocap.types import Floats

T = TypeVar("T")


class OutgoingMessages:
    """Makes the messages of one run."""

    def __init__(self, plan: Plan, engine: Engine, board: Switchboard) -> None:
        self._plan, self._engine, self._board = plan, engine, board
        self.take, self.run = plan.take.settings.name, ""
        self.continued_at = 0
        """The first frame after those of another coordinator; 0 if this one began the run."""
        self._coordinator = secrets.token_hex(16)
        self._published_s = time.perf_counter()
        self._seconds: dict[str, float] = {}
        self._filter, self._filtered_s = OneEuro(), -1.0

    def contents(self, actor: Actor) -> list[Blob]:
        """The actor and the rig, and the actor's own mesh if there is one."""
        mesh = [] if actor.mesh is None else [_blob(actor.mesh.content_hash, "mesh", actor.mesh.content)]
        return [
            _blob(actor.content_hash, "actor", actor.to_toml().encode()),
            _blob(self._plan.rig.content_hash, "rig", self._plan.rig.to_json().encode()),
            *mesh,
        ]

    def take_info(self, actor: Actor, shards: int) -> TakeInfo:
        """The take and its settings."""
        return TakeInfo(
            take=self.take,
            run=self.run,
            fps=self._plan.take.settings.fps,
            first_frame=self._plan.frames.start,
            end_frame=self._plan.frames.stop,
            plan=self._plan.name,
            shards=shards,
            actor=actor.content_hash,
            rig=self._plan.rig.content_hash,
            backend=self._engine.name,
            backend_reason=self._engine.reason[:LONGEST_REASON],
            threads=self._engine.settings.threads,
            search=self._plan.settings.model_dump(mode="json"),
            coordinator=self._coordinator,
            continued_at=self.continued_at,
        )

    def telemetry(self, stage: CoordinatorStage, next_frame: int) -> Telemetry:
        """The state of the take."""
        board, incoming = self._board, self._board.incoming
        dispatcher, recorders = board.dispatcher, board.recorders
        return Telemetry(
            take=self.take,
            run=self.run,
            stage=stage,
            first_frame=self._plan.frames.start,
            next_frame=next_frame,
            end_frame=self._plan.frames.stop,
            frames_ready=incoming.n_ready,
            unrecorded=recorders.n_unrecorded,
            deadline_s=dispatcher.deadline_s,
            tasks_waiting=dispatcher.n_waiting,
            workers=_some(dispatcher.workers),
            limbs=_some(dispatcher.busy),
            recorders=_some(recorders.recorded_ends),
            counts=board.counts(),
            seconds=self._seconds,
            **incoming.figures(),
        )

    def begin_frame(self) -> None:
        """The time of the next frame counts from now, and not from the previous pose."""
        self._published_s = time.perf_counter()

    def pose(
        self, number: int, frame: Frame, solution: FrameSolution, memory: dict[str, list[int]] | None = None
    ) -> Pose:
        """A solved frame; memory: the state after it, or None for a settled frame."""
        dispatcher, is_settled = self._board.dispatcher, memory is None
        seconds = {**solution.seconds, **solution.limb_seconds}
        if not is_settled or frame.shutter_s is None:  # else they are those of the first solution
            now_s = time.perf_counter()
            seconds["frame"], self._published_s = now_s - self._published_s, now_s
            self._seconds = seconds
        live = {"cameras_absent": [float(len(frame.absent))]} if frame.shutter_s is not None else {}
        return Pose(
            take=self.take,
            run=self.run,
            frame=number,
            time_s=frame.time_s,
            energy_px=solution.energy_px,
            passes=solution.passes,
            evaluations=solution.evaluations,
            workers=dispatcher.n_workers,
            retries=dispatcher.retries,
            backend=self._engine.name,
            worker_backends=dict(dispatcher.helped),
            seconds=seconds,
            confidence=solution.confidence,
            distrusted=solution.distrusted,
            measured=solution.measured | live,
            memory=memory or {},
            shot=frame.shot,
            latency_s=self._board.incoming.note_latency(frame, is_settled=is_settled),
            settled=is_settled,
            absent=list(frame.absent),
            pose=solution.pose,
            steady=np.zeros((0, len(solution.pose))) if is_settled else self._steady(frame, solution.pose),
        )

    def silhouettes(self, number: int, frame: Frame) -> Silhouettes:
        """The silhouettes of a frame, for viewers."""
        return Silhouettes(
            take=self.take,
            run=self.run,
            frame=number,
            cameras=list(range(self._plan.rig.n_cameras)),
            planes=frame.seen.silhouettes,
            unsure=frame.seen.sent_unsure,
            classes=frame.seen.sent_classes,
        )

    def take_end(self, end_frame: int, *, is_settled: bool) -> TakeEnd:
        """The end of the take; end_frame: one past the last solved frame."""
        return TakeEnd(
            take=self.take,
            run=self.run,
            first_frame=self._plan.frames.start,
            end_frame=end_frame,
            end_shot=self._board.incoming.end_shot,
            settled=is_settled,
        )

    def _steady(self, frame: Frame, pose: Floats) -> Floats:
        """(1, D) the pose filtered for whoever shows it live, (0, D) for recorded frames."""
        if frame.shutter_s is None:
            return np.zeros((0, len(pose)))
        if frame.time_s <= self._filtered_s:  # the pace has shifted: no time has passed
            return pose[None].copy()
        self._filtered_s = frame.time_s
        return self._filter(pose, frame.time_s)[None]


def _some(told: dict[str, T]) -> dict[str, T]:
    return dict(islice(told.items(), MAX_TOLD))


def _blob(content_hash: str, kind: Literal["actor", "rig", "mesh"], content: bytes) -> Blob:
    return Blob(hash=content_hash, kind=kind, content=np.frombuffer(content, np.uint8))
