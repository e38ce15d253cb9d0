"""What a coordinator says of its take: the messages, made from what it knows."""

from itertools import islice
from typing import Literal, TypeVar

import numpy as np

from proto.messages import MAX_TOLD, Blob, Pose, TakeInfo, Telemetry
from services.coordinator.assembly import FrameAssembler
from services.coordinator.dispatch import Dispatcher
from services.coordinator.plan import Plan
from services.coordinator.switchboard import Switchboard
from services.mocap.body.actor import Actor
from services.mocap.camera.rig import Rig
from services.mocap.energy.engine import Engine
from services.mocap.search.found import FrameSolution

T = TypeVar("T")
_LONGEST_REASON = 1000


class Wording:
    """Makes the messages of one run."""

    def __init__(self, plan: Plan, plan_name: str, rig: Rig, engine: Engine) -> None:
        self._plan, self._plan_name, self._rig, self._engine = plan, plan_name, rig, engine
        self.take = plan.take.settings.name
        self.run = ""
        self._seconds: dict[str, float] = {}

    def contents(self, actor: Actor) -> list[Blob]:
        """The actor and the rig, and the actor's own mesh if there is one."""
        mesh = [] if actor.mesh is None else [_blob(actor.mesh.content_hash, "mesh", actor.mesh.content)]
        return [
            _blob(actor.content_hash, "actor", actor.to_toml().encode()),
            _blob(self._rig.content_hash, "rig", self._rig.to_json().encode()),
            *mesh,
        ]

    def take_info(self, actor: Actor, shards: int) -> TakeInfo:
        """The take and how it is tracked."""
        return TakeInfo(
            take=self.take,
            run=self.run,
            fps=self._plan.take.settings.fps,
            first_frame=self._plan.frames.start,
            end_frame=self._plan.frames.stop,
            plan=self._plan_name,
            shards=shards,
            actor=actor.content_hash,
            rig=self._rig.content_hash,
            backend=self._engine.name,
            backend_reason=self._engine.reason[:_LONGEST_REASON],
            threads=self._engine.settings.threads,
            search=self._plan.settings.to_wire(),
        )

    def telemetry(
        self,
        stage: Literal["waiting for clients", "first frame", "tracking", "ended"],
        next_frame: int,
        board: Switchboard,
        frames: FrameAssembler,
    ) -> Telemetry:
        """How the take is doing."""
        dispatcher = board.dispatcher
        return Telemetry(
            take=self.take,
            run=self.run,
            stage=stage,
            first_frame=self._plan.frames.start,
            next_frame=next_frame,
            end_frame=self._plan.frames.stop,
            frames_ready=frames.n_ready,
            unrecorded=board.n_unrecorded,
            deadline_s=dispatcher.deadline_s,
            tasks_waiting=dispatcher.n_waiting,
            workers=_some(dispatcher.workers),
            limbs=_some(dispatcher.busy),
            recorders=_some(board.recorders),
            counts=board.counts() | {"silhouettes_dropped": frames.dropped},
            seconds=self._seconds,
        )

    def pose(
        self,
        frame: int,
        solution: FrameSolution,
        dispatcher: Dispatcher,
        seconds: float,
        memory: dict[str, list[int]],
    ) -> Pose:
        """A solved frame. seconds: since the one before; memory: the tracker's after it."""
        self._seconds = {**solution.seconds, **solution.limb_seconds, "frame": seconds}
        return Pose(
            take=self.take,
            run=self.run,
            frame=frame,
            time_s=frame / self._plan.take.settings.fps,
            energy_px=solution.energy_px,
            prior=solution.prior,
            passes=solution.passes,
            evaluations=solution.evaluations,
            workers=dispatcher.n_workers,
            retries=dispatcher.retries,
            backend=self._engine.name,
            worker_backends=dict(dispatcher.helped),
            seconds=self._seconds,
            confidence=solution.confidence,
            distrusted=solution.distrusted,
            part_px=solution.part_px,
            iou=solution.iou,
            memory=memory,
            pose=solution.pose,
        )


def _some(told: dict[str, T]) -> dict[str, T]:
    return dict(islice(told.items(), MAX_TOLD))


def _blob(content_hash: str, kind: Literal["actor", "rig", "mesh"], content: bytes) -> Blob:
    return Blob(hash=content_hash, kind=kind, content=np.frombuffer(content, np.uint8))
