"""One take from its first frame to its last: where frames come in, poses go out, and nothing is skipped."""

import logging
import secrets
import time
from collections.abc import Callable
from typing import Literal

from proto.auth import Admission
from proto.messages import Credit, Recording, Silhouettes, TakeEnd, Telemetry
from services.coordinator.assembly import FrameAssembler
from services.coordinator.limbs import RemoteLimbs
from services.coordinator.metrics import Gauges, note_pose
from services.coordinator.opening import model_of, solve_opening
from services.coordinator.overhead import Overhead
from services.coordinator.plan import Plan
from services.coordinator.switchboard import LostFramesError, Switchboard
from services.coordinator.tracker import Tracker
from services.coordinator.wording import Wording
from services.mocap.body.actor import Actor
from services.mocap.camera.rig import Rig
from services.mocap.energy.engine import Engine
from services.mocap.errors import UserError
from services.mocap.search.chains import LIMBS
from services.mocap.search.found import FrameSolution
from services.mocap.search.model import Model
from services.mocap.take.settings import TakeSettings
from services.mocap.types import Bytes, Floats
from services.process import StopRequest, about

log = logging.getLogger(__name__)

_AHEAD_FRAMES = 8
"""How far segmentation may be ahead of the fit."""
_UNRECORDED_FRAMES = 2000
"""How far the fit may be ahead of the recorders that are waited for."""
_LOOK_S = 0.2
_RETURN_S = 3.0
"""How long a coordinator that goes on with a run waits for workers to come back."""
_CONFIRM_S = 20.0
"""How long recorders may be silent before they have confirmed all frames."""
_SAY_WAITING_EVERY = 25
"""Looks without a frame after which the log says what is missing."""


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
        self._rig, self._plan_name = Rig.of(plan.take.cameras), plan.name
        self._wording = Wording(plan, self._plan_name, self._rig, engine)
        self._frames = self._assembler("", plan.frames.start)
        self._board = Switchboard(endpoint, self._take_in, admission)
        self._stage: Literal["waiting for clients", "first frame", "tracking", "ended"] = (
            "waiting for clients"
        )
        self._published_s = time.perf_counter()
        self._solved_end = plan.frames.start
        self._recorders, self._shards = 0, 1
        self._gauges, self._overhead = Gauges(), Overhead()
        self._board.telemetry = self._telemetry
        about(take=self._wording.take)

    def _telemetry(self) -> Telemetry:
        told = self._wording.telemetry(self._stage, self._solved_end, self._board, self._frames)
        self._gauges.latest = told
        return told

    def _credit_end(self, next_frame: int) -> int:
        return min(next_frame + _AHEAD_FRAMES, self._plan.frames.stop)

    def _take_in(self, message: Silhouettes) -> None:
        self._frames.add(message, self._credit_end(self._frames.next_frame))

    def _assembler(self, run: str, first_frame: int) -> FrameAssembler:
        """What puts together the frames of a run; of none, as long as it has no name."""
        return FrameAssembler(self._wording.take, run, self._rig, first_frame, self._plan.frames.stop)

    def run(self, workers: int, recorders: int, timeout_s: float) -> None:
        """Track all frames, or as many as are done when a stop is asked for; then say so and close.

        It first waits until so many workers and recorders are there, or until the time is up. If recorders
        hold the beginning of a run of the same plan, that run goes on after it; else a new one begins.

        After an error of the user's, too, the frames solved before it are said to be all. After another one
        nothing is said, since a coordinator that takes this one's place may still do better.
        """
        held = self._await_clients(workers, recorders, timeout_s)
        self._wording.run = held.run if held else secrets.token_hex(16)
        self._solved_end = held.end_frame if held else self._plan.frames.start
        self._board.begin(self._wording.run, self._solved_end, recorders)
        try:
            self._track(held)
        except UserError:
            self._end()
            raise
        else:
            self._end()
        finally:
            self._board.close()

    def _await_clients(self, workers: int, recorders: int, timeout_s: float) -> Recording | None:
        """Wait for clients; returns what recorders hold of this plan, if all of them do.

        From eight workers on they share limbs.
        """
        board = self._board
        self._recorders = recorders
        self._wait_until(lambda: board.n_recorders >= recorders, timeout_s)
        held = board.recording(self._wording.take, self._plan_name)
        usable = held is not None and held.memory and (self._plan.actor is not None or held.actor.size)
        patience_s = _RETURN_S if usable else timeout_s
        self._wait_until(lambda: board.dispatcher.n_workers >= workers, patience_s)
        if board.dispatcher.n_workers < workers or board.n_recorders < recorders:
            found = (board.dispatcher.n_workers, workers, board.n_recorders, recorders)
            log.warning("going on with %d of %d workers and %d of %d recorders", *found)
        self._shards = max(1, max(workers, board.dispatcher.n_workers) // len(LIMBS))
        return held if usable else None

    def _wait_until(self, condition: Callable[[], bool], timeout_s: float) -> None:
        """Wait until clients are there, until the time is up or a stop is asked for."""
        deadline_s = time.monotonic() + timeout_s
        while not condition() and time.monotonic() < deadline_s and not self._stop:
            self._board.pump(_LOOK_S)

    def _end(self) -> None:
        """Say that no pose will follow, and wait until recorders have them all."""
        self._stage = "ended"
        about(frame=None)
        run, first = self._wording.run, self._plan.frames.start
        end = TakeEnd(take=self._wording.take, run=run, first_frame=first, end_frame=self._solved_end)
        self._board.end(end)
        self._await_recorders()
        log.info("end: %s", self._board.counts() | {"silhouettes_dropped": self._frames.dropped})

    def _track(self, held: Recording | None) -> None:
        self._stage = "first frame" if held is None else "tracking"
        early, self._frames = self._frames, self._assembler(self._wording.run, self._solved_end)
        self._frames.dropped = early.dropped
        tracker = self._open() if held is None else self._go_on(held)
        if tracker is None:
            return
        self._published_s = time.perf_counter()
        self._overhead.begin()
        for frame in range(self._solved_end, self._plan.frames.stop):
            silhouettes = self._next_frame()
            if silhouettes is None:
                return
            about(frame=frame)
            self._limbs.frame = frame
            with self._overhead.fitting():
                solution = tracker.solve(silhouettes)
            solution.seconds["overhead"] = self._overhead.of_frame()
            self._publish(frame, solution, tracker)

    def _open(self) -> Tracker | None:
        """Find the actor in the first frame; None when a stop was asked for before it came."""
        first = self._next_frame()
        if first is None:
            return None
        about(frame=self._plan.frames.start)
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
        tracker = self._tracker(opening.model, opening.actor, opening.solution.pose[None])
        self._publish(self._plan.frames.start, opening.solution, tracker)
        return tracker

    def _go_on(self, held: Recording) -> Tracker:
        """Go on where the recorders' poses end, as if this coordinator had solved them itself."""
        log.warning("going on with run %s at frame %d", held.run[:8], held.end_frame)
        actor = self._plan.actor or Actor.from_toml(held.actor.tobytes().decode())
        self._shards = held.shards
        self._board.dispatcher.retries = held.retries
        self._board.dispatcher.helped.update(held.worker_backends)
        tracker = self._tracker(model_of(actor, self._rig, self._engine), actor, held.poses)
        tracker.recall(held.memory)
        return tracker

    def _tracker(self, model: Model, actor: Actor, poses: Floats) -> Tracker:
        """What follows the actor; tells recorders and viewers about the take."""
        self._limbs = self._pool(model, actor)
        self._board.announce(self._wording.take_info(actor, self._shards))
        return Tracker(model, self._plan.settings, self._limbs, poses)

    def _hints(self) -> TakeSettings:
        """take.toml; what it says of frame 0 is left out when another one comes first."""
        settings = self._plan.take.settings
        if self._plan.frames.start == 0:
            return settings
        return settings.model_copy(update={"facing": None, "initial_pose": {}})

    def _next_frame(self) -> Bytes | None:
        """The next frame's silhouettes; None when a stop was asked for."""
        looks, frames = 0, self._frames
        while not self._stop:
            silhouettes = frames.take_next() if self._is_kept_up_with() else None
            self._board.give_credit(
                Credit(
                    take=self._wording.take,
                    run=self._wording.run,
                    next_frame=frames.first_lacking(),
                    end_frame=self._credit_end(frames.next_frame),
                )
            )
            if silhouettes is not None:
                return silhouettes
            self._board.pump(_LOOK_S)
            looks += 1
            if looks % _SAY_WAITING_EVERY == 0:
                self._say_why_waiting(frames)
        return None

    def _is_kept_up_with(self) -> bool:
        """Whether recorders that are waited for are not too far behind."""
        return not self._recorders or self._board.n_unrecorded < _UNRECORDED_FRAMES

    def _say_why_waiting(self, frames: FrameAssembler) -> None:
        missing = [self._plan.take.cameras[c].name for c in frames.waiting_for()]
        if missing:
            log.info("frame %d still lacks %s", frames.next_frame, ", ".join(missing))
        else:
            log.warning("waiting for recorders, which lack %d frames", self._board.n_unrecorded)

    def _pool(self, model: Model, actor: Actor) -> RemoteLimbs:
        """The workers, told what they need to know of an actor."""
        for blob in self._wording.contents(actor):
            self._board.offer(blob)
        dispatcher, pump = self._board.dispatcher, self._board.pump
        ids = (self._wording.take, self._wording.run, actor.content_hash)
        limbs = RemoteLimbs(model, *ids, dispatcher, pump, self._shards, self._overhead)
        limbs.frame = self._plan.frames.start
        return limbs

    def _publish(self, frame: int, solution: FrameSolution, tracker: Tracker) -> None:
        now = time.perf_counter()
        whole_s, self._published_s = now - self._published_s, now
        memory, dispatcher = tracker.memory(), self._board.dispatcher
        pose = self._wording.pose(frame, solution, dispatcher, whole_s, memory)
        self._board.publish(pose)
        note_pose(pose)
        self._solved_end, self._stage = frame + 1, "tracking"

    def _await_recorders(self) -> None:
        """Wait until all expected recorders have all frames, or none has asked for any for a while."""
        while not self._board.recorded_up_to(self._solved_end, self._recorders):
            if time.monotonic() - self._board.recorders_heard_s > _CONFIRM_S:
                if self._recorders and self._board.n_unrecorded:
                    raise LostFramesError(f"a recorder has not got {self._board.n_unrecorded} frames on disk")
                log.error("a recorder has not confirmed all frames")
                return
            self._board.pump(_LOOK_S)
