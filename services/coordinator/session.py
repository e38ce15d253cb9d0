"""One take from its first frame to its last: where frames come in, poses go out, and nothing is skipped."""

import logging
import time
from dataclasses import dataclass
from typing import Literal

import numpy as np

from proto.auth import Admission
from proto.messages import Blob, Credit, Pose, Silhouettes, TakeEnd, TakeInfo
from services.coordinator.assembly import FrameAssembler
from services.coordinator.limbs import RemoteLimbs
from services.coordinator.opening import Opening, solve_opening
from services.coordinator.switchboard import Switchboard
from services.coordinator.tracker import Tracker
from services.mocap.body.actor import Actor
from services.mocap.camera.rig import Rig
from services.mocap.energy.engine import Engine
from services.mocap.search.chains import LIMBS
from services.mocap.search.found import FrameSolution
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.take.folder import Take
from services.mocap.take.settings import TakeSettings
from services.mocap.types import Bytes, Floats
from services.process import StopRequest

log = logging.getLogger(__name__)

_AHEAD_FRAMES = 8
"""How far segmentation may be ahead of the fit."""
_LOOK_S = 0.2
_CONFIRM_S = 20.0
"""How long recorders may be silent before they have confirmed all frames."""
_SAY_WAITING_EVERY = 25
"""Looks without a frame after which the log says what is missing."""


@dataclass(frozen=True)
class Plan:
    """What a session is to do."""

    take: Take
    frames: range
    settings: SearchSettings
    actor: Actor | None
    """None: the generic body in the height that the take gives, or else the one that fits the first frame."""
    fitted_pose: Floats | None = None
    """(35,) of the first frame, where it was found along with the actor."""


class Session:
    """Tracks one take; sockets belong to the switchboard, the energy to the engine."""

    def __init__(
        self,
        plan: Plan,
        engine: Engine,
        endpoint: str,
        stop: StopRequest,
        admission: Admission | None = None,
    ) -> None:
        self._plan, self._engine, self._stop = plan, engine, stop
        self._name = plan.take.settings.name
        self._rig = Rig.of(plan.take.cameras)
        self._assembler = FrameAssembler(self._name, self._rig, plan.frames.start, plan.frames.stop)
        self._board = Switchboard(endpoint, self._take_in, admission)
        self._published_s = time.perf_counter()
        self._solved_end = plan.frames.start
        self._recorders, self._shards = 0, 1

    def _credit_end(self) -> int:
        return min(self._assembler.next_frame + _AHEAD_FRAMES, self._plan.frames.stop)

    def _take_in(self, message: Silhouettes) -> None:
        self._assembler.add(message, self._credit_end())

    def await_clients(self, workers: int, recorders: int, timeout_s: float) -> None:
        """Wait until so many are there, or until the time is up; from eight workers on they share limbs."""
        board, deadline_s = self._board, time.monotonic() + timeout_s
        self._recorders = recorders
        while board.dispatcher.n_workers < workers or board.n_recorders < recorders:
            if time.monotonic() > deadline_s or self._stop:
                found = (board.dispatcher.n_workers, workers, board.n_recorders, recorders)
                log.warning("going on with %d of %d workers and %d of %d recorders", *found)
                break
            board.pump(_LOOK_S)
        self._shards = max(1, max(workers, board.dispatcher.n_workers) // len(LIMBS))

    def run(self) -> None:
        """Track all frames, or as many as are done when a stop is asked for; then say so and close.

        After an error too the frames solved before it are said to be all.
        """
        try:
            self._track()
        finally:
            self._board.end(
                TakeEnd(take=self._name, first_frame=self._plan.frames.start, end_frame=self._solved_end)
            )
            self._await_recorders()
            log.info("end: %s", self._board.counts() | {"silhouettes_dropped": self._assembler.dropped})
            self._board.close()

    def _track(self) -> None:
        first = self._next_frame()
        if first is None:
            return
        self._published_s = time.perf_counter()
        opening = solve_opening(
            first,
            self._rig,
            self._plan.actor,
            self._hints(),
            self._pool,
            self._engine,
            self._plan.settings,
            self._plan.fitted_pose,
            [camera.name for camera in self._plan.take.cameras],
        )
        self._announce(opening)
        self._publish(self._plan.frames.start, opening.solution)
        model, limbs = opening.model, self._pool(opening.model, opening.actor)
        tracker = Tracker(model, self._plan.settings, limbs, opening.solution)
        for frame in self._plan.frames[1:]:
            silhouettes = self._next_frame()
            if silhouettes is None:
                return
            limbs.frame = frame
            self._publish(frame, tracker.solve(silhouettes))

    def _hints(self) -> TakeSettings:
        """take.toml; what it says of frame 0 is left out when another one comes first."""
        settings = self._plan.take.settings
        if self._plan.frames.start == 0:
            return settings
        return settings.model_copy(update={"facing": None, "initial_pose": {}})

    def _next_frame(self) -> Bytes | None:
        """The next frame's silhouettes; None when a stop was asked for."""
        looks = 0
        while not self._stop:
            silhouettes = self._assembler.take_next()
            self._board.give_credit(
                Credit(
                    take=self._name, next_frame=self._assembler.first_lacking(), end_frame=self._credit_end()
                )
            )
            if silhouettes is not None:
                return silhouettes
            self._board.pump(_LOOK_S)
            looks += 1
            if looks % _SAY_WAITING_EVERY == 0:
                missing = [self._plan.take.cameras[c].name for c in self._assembler.waiting_for()]
                log.info("frame %d still lacks %s", self._assembler.next_frame, ", ".join(missing))
        return None

    def _pool(self, model: Model, actor: Actor) -> RemoteLimbs:
        """The workers, told what they need to know of an actor."""
        self._board.offer(_blob(actor.content_hash, "actor", actor.to_toml().encode()))
        self._board.offer(_blob(self._rig.content_hash, "rig", self._rig.to_json().encode()))
        if actor.mesh is not None:
            self._board.offer(_blob(actor.mesh.content_hash, "mesh", actor.mesh.content))
        dispatcher, pump = self._board.dispatcher, self._board.pump
        limbs = RemoteLimbs(model, self._name, actor.content_hash, dispatcher, pump, self._shards)
        limbs.frame = self._plan.frames.start
        return limbs

    def _announce(self, opening: Opening) -> None:
        """Tell recorders and viewers about the take."""
        self._board.announce(
            TakeInfo(
                take=self._name,
                fps=self._plan.take.settings.fps,
                first_frame=self._plan.frames.start,
                end_frame=self._plan.frames.stop,
                actor=opening.actor.content_hash,
                rig=self._rig.content_hash,
                backend=self._engine.name,
                backend_reason=self._engine.reason[:1000],
                threads=self._engine.settings.threads,
                search=self._plan.settings.to_wire(),
            )
        )

    def _publish(self, frame: int, solution: FrameSolution) -> None:
        dispatcher, now = self._board.dispatcher, time.perf_counter()
        whole_s, self._published_s = now - self._published_s, now
        self._board.publish(
            Pose(
                take=self._name,
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
                seconds={**solution.seconds, **solution.limb_seconds, "frame": whole_s},
                confidence=solution.confidence,
                distrusted=solution.distrusted,
                pose=solution.pose,
            )
        )
        self._solved_end = frame + 1

    def _await_recorders(self) -> None:
        """Wait until all expected recorders have all frames, or none has asked for any for a while."""
        while not self._board.recorded_up_to(self._solved_end, self._recorders):
            if time.monotonic() - self._board.recorders_heard_s > _CONFIRM_S:
                log.error("a recorder has not confirmed all frames")
                return
            self._board.pump(_LOOK_S)


def _blob(content_hash: str, kind: Literal["actor", "rig", "mesh"], content: bytes) -> Blob:
    return Blob(hash=content_hash, kind=kind, content=np.frombuffer(content, np.uint8))
