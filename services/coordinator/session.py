"""Tracks one take from its first frame to its last: frames come in, poses go out, nothing is skipped."""

import logging
import secrets
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from proto.auth import Admission
from proto.messages import CoordinatorStage, Recording, TakeEnd, Telemetry
from services.coordinator.incoming import Frame, Incoming, RecordedFrames
from services.coordinator.limbs import RemoteLimbs
from services.coordinator.live_frames import LiveFrames
from services.coordinator.live_settling import LiveSettling
from services.coordinator.metrics import Gauges, note_pose
from services.coordinator.outgoing_messages import OutgoingMessages
from services.coordinator.overhead import Overhead
from services.coordinator.plan import Plan
from services.coordinator.recorders import LostFramesError
from services.coordinator.settling import Settling, fetch_poses
from services.coordinator.switchboard import Switchboard
from services.coordinator.unsure import UnsureParts
from services.health import beat
from services.logs import about
from services.mocap.body.actor import Actor
from services.mocap.body.kinematics import N_DOF
from services.mocap.camera.rig import Rig
from services.mocap.energy.engine import Engine
from services.mocap.errors import TakeError, UserError
from services.mocap.search.chains import LIMBS
from services.mocap.search.first_frame import solve_first_frame, told_actor
from services.mocap.search.found import FrameSolution
from services.mocap.search.model import Model, model_of
from services.mocap.search.tracker import Tracker
from services.mocap.search.warm_up import rehearse
from services.mocap.take.live import LiveTake
from services.mocap.types import Floats
from services.process import STOP_CHECK_S, StopRequest

log = logging.getLogger(__name__)

_UNRECORDED_FRAMES = 2000
"""How far the fit may be ahead of the expected recorders."""
_RETURN_S = 3.0
"""How long a coordinator that continues a run waits for workers to return."""
_CONFIRM_S = 20.0
"""How long recorders may be silent before confirming all frames."""
_SAY_WAITING_EVERY = 25
"""Attempts without a frame after which the log says what is missing."""


class Session:
    """Tracks one take; the switchboard owns the sockets, the engine the energy."""

    def __init__(
        self, plan: Plan, engine: Engine, endpoint: str, stop: StopRequest, admission: Admission | None = None
    ) -> None:
        self._plan, self._engine, self._stop = plan, engine, stop
        self._rig = Rig.of(plan.take.cameras)
        self._camera_names = [camera.name for camera in plan.take.cameras]
        if isinstance(plan.take, LiveTake):
            self._incoming: Incoming = LiveFrames(plan.take, self._rig)
        else:
            told = plan.take.settings
            self._incoming = RecordedFrames(told.name, self._rig, plan.frames, told.fps)
        self._board = Switchboard(endpoint, self._incoming, admission)
        self._outgoing = OutgoingMessages(plan, self._rig, engine, self._board, self._incoming)
        self._stage: CoordinatorStage = "waiting for clients"
        self._solved_end = self._told_frame = plan.frames.start
        self._n_recorders, self._shards = 0, 1
        self._told = ""
        self._made: Model | None = None
        self._unsure: UnsureParts | None = None
        is_settled_last = plan.settings.goes_both_ways and not self._incoming.is_live
        fps = plan.take.settings.fps
        self._settling = Settling(plan.frames.start, fps) if is_settled_last else None
        self._live_settling: LiveSettling | None = None
        self._is_settled = False
        self._gauges, self._overhead = Gauges(), Overhead()
        self._board.telemetry = self._telemetry
        about(take=self._outgoing.take)

    def _telemetry(self) -> Telemetry:
        told = self._outgoing.telemetry(self._stage, self._told_frame)
        self._gauges.latest = told
        return told

    def run(self, workers: int, recorders: int, timeout_s: float) -> None:
        """Track all frames, or until a stop is requested; then announce the end and close.

        It first waits for this many workers and recorders, or until the time is up. If recorders hold the
        beginning of a run of the same plan, that run continues; else a new one begins.

        After a user's error the take ends with the frames solved so far. After another error nothing is
        announced, because a restarted coordinator may still succeed.
        """
        held = self._await_clients(workers, recorders, timeout_s)
        self._outgoing.run = held.run if held else secrets.token_hex(16)
        self._solved_end = self._told_frame = held.end_frame if held else self._plan.frames.start
        self._board.recorders.begin(self._outgoing.run, self._solved_end, recorders)
        try:
            self._track(held)
        except UserError:
            self._end()
            raise
        else:
            self._end()
        finally:
            self._board.close()
            if self._settling is not None:
                self._settling.close()

    def _await_clients(self, workers: int, recorders: int, timeout_s: float) -> Recording | None:
        """Wait for clients; returns what the recorders hold of this plan, if all of them hold some of it.

        Eight or more workers share limbs.
        """
        dispatcher, reporting = self._board.dispatcher, self._board.recorders
        self._n_recorders = recorders
        self._wait_until(lambda: reporting.n_reported >= recorders, timeout_s)
        held = reporting.held(self._outgoing.take, self._outgoing.plan_name)
        usable = held is not None and held.memory and (self._plan.actor is not None or held.actor.size)
        patience_s = _RETURN_S if usable else timeout_s
        self._wait_until(lambda: dispatcher.n_workers >= workers, patience_s)
        if dispatcher.n_workers < workers or reporting.n_reported < recorders:
            found = (dispatcher.n_workers, workers, reporting.n_reported, recorders)
            log.warning("starting with %d of %d workers and %d of %d recorders", *found)
        self._shards = max(1, max(workers, dispatcher.n_workers) // len(LIMBS))
        return held if usable else None

    def _wait_until(self, condition: Callable[[], bool], timeout_s: float) -> None:
        """Wait until clients are there, the time is up or a stop is requested."""
        deadline_s = time.monotonic() + timeout_s
        while not condition() and time.monotonic() < deadline_s and not self._stop:
            beat()
            self._board.pump(STOP_CHECK_S)

    def _track(self, held: Recording | None) -> None:
        if self._incoming.is_live:
            self._rehearse()
        self._stage = "first frame" if held is None else "tracking"
        begun = self._solved_end if self._settling is None else self._plan.frames.start
        self._incoming.begin(self._outgoing.run, begun)
        tracker = self._open() if held is None else self._go_on(held)
        if tracker is None or not self._caught_up():
            return
        self._outgoing.begin_frame()
        self._overhead.begin()
        for frame in range(self._solved_end, self._plan.frames.stop):
            found = self._next_frame()
            if found is None:
                self._conclude_live()
                return
            about(frame=frame)
            self._limbs.frame = frame
            was_lost = tracker.is_lost
            with self._overhead.fitting():
                solution = tracker.solve(found.seen, found.absent, hurried=found.is_late)
            if was_lost and not tracker.is_lost:
                self._incoming.catch_up()
            solution.seconds["overhead"] = self._overhead.of_frame()
            self._publish(frame, found, solution, tracker)
        if self._settling is not None:
            self._is_settled = self._settle(self._settling)

    def _rehearse(self) -> None:
        """Prepare everything for the first pose, here and in workers, before cameras start, because cameras
        do not wait."""
        told = told_actor(self._plan.actor, self._plan.take.settings)
        model = model_of(told or Actor(), self._rig, self._engine)
        began_s = time.perf_counter()
        rehearse(model, self._pool(model, told or Actor()), self._plan.settings)
        log.info("ready for the first shot: prepared in %.1f s", time.perf_counter() - began_s)
        if told is not None:
            self._made = model
        else:
            model.backend.close()

    def _open(self) -> Tracker | None:
        """Find the actor in the first frame; None if a stop was requested before it came."""
        while (first := self._next_frame()) is not None:
            if self._incoming.is_live and set(first.absent) - set(self._incoming.waiting_for()):
                continue  # cameras that are only late will be in the next one
            about(frame=self._plan.frames.start)
            self._outgoing.begin_frame()
            try:
                solved = solve_first_frame(
                    first.seen,
                    self._rig,
                    self._plan.actor,
                    self._plan.take.settings.beginning_at(self._plan.frames.start),
                    self._pool,
                    self._engine,
                    self._plan.settings.without_cameras(first.absent, self._rig.n_cameras),
                    self._plan.fitted_pose,
                    self._camera_names,
                    self._made,
                )
            except TakeError as problem:
                if not self._incoming.is_live:
                    raise
                if str(problem) != self._told:  # once for each reason
                    self._told = str(problem)
                    log.info("not yet: %s", problem)
                continue
            self._incoming.catch_up()
            tracker = self._tracker(solved.model, solved.actor, solved.solution.pose[None])
            self._publish(self._plan.frames.start, first, solved.solution, tracker)
            if self._unsure is not None and self._plan.fitted_pose is None:  # else the fit has reported it
                self._unsure.tell_first(first.seen, solved.solution.pose)
            return tracker
        return None

    def _go_on(self, held: Recording) -> Tracker:
        """Continue after the recorders' poses, as if this coordinator had solved them itself."""
        log.warning("continuing run %s at frame %d", held.run[:8], held.end_frame)
        actor = self._plan.actor or Actor.from_toml(held.actor.tobytes().decode())
        self._shards = held.shards
        self._board.dispatcher.retries = held.retries
        self._board.dispatcher.helped.update(held.worker_backends)
        tracker = self._tracker(model_of(actor, self._rig, self._engine), actor, held.poses)
        tracker.recall(held.memory)
        self._incoming.recall(held.memory)
        if self._live_settling is not None and not self._settle_unchanged(held.end_frame):
            self._live_settling = None
        return tracker

    def _settle_unchanged(self, end_frame: int) -> bool:
        """Settle the live frames of an earlier coordinator as they are, because their silhouettes are gone;
        False if a stop was requested meanwhile."""
        recorders = self._board.recorders
        unsettled = range(recorders.settled_end, end_frame)
        first = fetch_poses(recorders, unsettled, lambda: self._look(STOP_CHECK_S))
        final = {"settled": True, "memory": {}, "steady": np.zeros((0, N_DOF))}
        if first is None:
            return False
        for frame in unsettled:
            self._board.publish(first[frame].model_copy(update=final))
        return True

    def _tracker(self, model: Model, actor: Actor, poses: Floats) -> Tracker:
        """The tracker of the actor; also announces the take to recorders and viewers."""
        self._model, self._limbs = model, self._pool(model, actor)
        self._unsure = UnsureParts(model, self._camera_names)
        self._board.announce(self._outgoing.take_info(actor, self._shards))
        if self._incoming.is_live and self._plan.settings.goes_both_ways:
            self._live_settling = LiveSettling(
                model, self._plan.settings, self._limbs, self._solved_end, self._publish_settled
            )
        return Tracker(model, self._plan.settings, self._limbs, poses)

    def _pool(self, model: Model, actor: Actor) -> RemoteLimbs:
        """The pool of workers for an actor."""
        for blob in self._outgoing.contents(actor):
            self._board.offer(blob)
        dispatcher, pump = self._board.dispatcher, self._board.pump
        ids = (self._outgoing.take, self._outgoing.run, actor.content_hash)
        limbs = RemoteLimbs(model, *ids, dispatcher, pump, self._shards, self._overhead)
        limbs.frame = self._plan.frames.start
        return limbs

    def _caught_up(self) -> bool:
        """Take in the silhouettes of frames that an earlier coordinator has solved, if they are needed again;
        False if a stop was requested before they came."""
        while self._settling is not None and self._settling.next_frame < self._solved_end:
            found = self._next_frame()
            if found is None:
                return False
            self._settling.note(found.seen, None)
        return True

    def _next_frame(self) -> Frame | None:
        """The next frame; None if a stop was requested or live input has ended."""
        looks, incoming = 0, self._incoming
        if incoming.is_live:
            self._board.pump(0.0)  # messages that have arrived meanwhile are newer
        while not self._stop and not incoming.has_ended:
            beat()
            found = incoming.take_next() if self._is_kept_up_with() else None
            credit = incoming.credit()
            if credit is not None:
                self._board.give_credit(credit)
            if found is not None:
                return found
            with self._overhead.fitting():
                is_settling = self._live_settling is not None and self._live_settling.work()
            if is_settling:
                self._board.pump(0.0)
                continue
            self._board.pump(STOP_CHECK_S)
            looks += 1
            if looks % _SAY_WAITING_EVERY == 0:
                missing = [self._camera_names[c] for c in incoming.waiting_for()]
                if missing:
                    log.info("frame %d still lacks %s", incoming.next_frame, ", ".join(missing))
                elif not self._is_kept_up_with():
                    lacking = self._board.recorders.n_unrecorded
                    log.warning("waiting for recorders, which lack %d frames", lacking)
        return None

    def _is_kept_up_with(self) -> bool:
        """Whether the expected recorders keep up."""
        return not self._n_recorders or self._board.recorders.n_unrecorded < _UNRECORDED_FRAMES

    def _publish(self, number: int, frame: Frame, solution: FrameSolution, tracker: Tracker) -> None:
        memory = tracker.memory() | self._incoming.memory()
        pose = self._outgoing.pose(number, frame, solution, memory)
        self._board.publish(pose)
        if frame.shutter_s is not None:  # recorded frames' silhouettes are kept on arrival
            self._board.keep(self._outgoing.silhouettes(number, frame))
        if self._unsure is not None and not tracker.is_lost:
            self._unsure.note(frame.seen, solution.pose)
        note_pose(pose)
        self._solved_end = self._told_frame = number + 1
        self._stage = "tracking"
        if self._settling is not None:
            self._settling.note(frame.seen, solution.pose)
        if self._live_settling is not None:
            self._live_settling.note(frame, replace(solution, seconds=pose.seconds), memory)

    def _publish_settled(self, number: int, frame: Frame, solution: FrameSolution) -> None:
        self._board.publish(self._outgoing.pose(number, frame, solution))

    def _conclude_live(self) -> None:
        """Settle what is left of live input, which has ended."""
        if self._live_settling is not None:
            self._live_settling.conclude()
            self._is_settled = True

    def _look(self, timeout_s: float) -> bool:
        """Handle messages; False once a stop was requested."""
        beat()
        self._board.pump(timeout_s)
        return not self._stop

    def _settle(self, settling: Settling) -> bool:
        """Solve all frames both ways and publish them again; False if a stop was requested meanwhile."""
        if not settling.fetch(self._board.recorders, lambda: self._look(STOP_CHECK_S)):
            return False
        for number, step in settling.solve(self._model, self._plan.settings, self._limbs):
            if step.solution is not None:
                found = Frame(settling.seen[step.frame], number / self._plan.take.settings.fps, number)
                self._publish_settled(number, found, step.solution)
                continue
            self._stage, self._told_frame = step.sweep, number
            about(frame=number)
            if not self._look(0.0):
                return False
        return True

    def _end(self) -> None:
        """Say that no pose will follow, and wait until all expected recorders have all frames.

        Not for ever: only while one of them asks for some now and then.
        """
        self._stage = "ended"
        about(frame=None)
        if self._unsure is not None:
            self._unsure.conclude()
        self._board.end(
            TakeEnd(
                take=self._outgoing.take,
                run=self._outgoing.run,
                first_frame=self._plan.frames.start,
                end_frame=self._solved_end,
                end_shot=self._incoming.end_shot,
                settled=self._is_settled,
            )
        )
        recorders = self._board.recorders
        is_empty = self._solved_end == self._plan.frames.start
        while not is_empty and not recorders.have_all(self._solved_end, lambda: self._board.pump(0)):
            beat()
            if time.monotonic() - recorders.heard_s > _CONFIRM_S:
                if self._n_recorders and recorders.n_unrecorded:
                    raise LostFramesError(f"a recorder lacks {recorders.n_unrecorded} frames on disk")
                log.error("a recorder has not confirmed all frames")
                break
            self._board.pump(STOP_CHECK_S)
        log.info("end: %s", self._board.counts() | {"silhouettes_dropped": self._incoming.dropped})
