"""Tracks one take from its first frame to its last: frames come in, poses go out.

The way of a frame: the switchboard gives silhouettes to Incoming as they arrive, FrameInput hands out the
next whole frame, the tracker solves it, the session publishes its pose, and a settled pose follows later.
"""

import logging
import secrets
from collections.abc import Iterator
from dataclasses import replace

from proto.auth import Admission
from proto.messages import CoordinatorStage, Recording, Telemetry
from services.coordinator.clients import await_clients, await_confirmation
from services.coordinator.frame_input import FrameInput
from services.coordinator.incoming import Frame, Incoming, RecordedFrames
from services.coordinator.live_frames import LiveFrames
from services.coordinator.live_settling import LiveSettling, settle_unchanged
from services.coordinator.metrics import Gauges, note_pose
from services.coordinator.opening import Opening, Tracking
from services.coordinator.outgoing_messages import OutgoingMessages
from services.coordinator.overhead import Overhead
from services.coordinator.plan import Plan
from services.coordinator.settling import Settling
from services.coordinator.switchboard import Switchboard
from services.coordinator.unsure import UnsureParts
from services.health import beat
from services.logs import about
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.energy.engine import Engine
from services.mocap.errors import UserError
from services.mocap.search.chains import LIMBS
from services.mocap.search.found import FrameSolution
from services.mocap.search.tracker import aligned_ahead
from services.mocap.take.live import LiveTake
from services.mocap.types import Floats
from services.process import STOP_CHECK_S, StopRequest

log = logging.getLogger(__name__)


class Session:
    """Tracks one take; the switchboard owns the sockets, the engine the energy."""

    def __init__(
        self, plan: Plan, engine: Engine, endpoint: str, stop: StopRequest, admission: Admission | None = None
    ) -> None:
        self._plan, self._engine, self._stop = plan, engine, stop
        settings = plan.take.settings
        if isinstance(plan.take, LiveTake):
            self._incoming: Incoming = LiveFrames(plan.take, plan.rig)
        else:
            self._incoming = RecordedFrames(settings.name, plan.rig, plan.frames, settings.fps)
        self._board = Switchboard(endpoint, self._incoming, admission)
        self._outgoing = OutgoingMessages(plan, engine, self._board)
        self._gauges, self._overhead = Gauges(), Overhead()
        self._frames = FrameInput(plan, self._board, stop, self._work_meanwhile)
        self._stage: CoordinatorStage = "waiting for clients"
        self._solved_end = self._told_frame = plan.frames.start
        self._unsure: UnsureParts | None = None
        is_settled_last = plan.settings.goes_both_ways and not self._incoming.is_live
        self._settling = Settling(plan.frames.start, settings.fps) if is_settled_last else None
        self._live_settling: LiveSettling | None = None
        self._is_settled = False
        self._board.telemetry = self._telemetry
        about(take=self._outgoing.take)

    def _telemetry(self) -> Telemetry:
        telemetry = self._outgoing.telemetry(self._stage, self._told_frame)
        self._gauges.latest = telemetry
        return telemetry

    def run(self, workers: int, recorders: int) -> None:
        """Track all frames, or until a stop is requested; then announce the end and close.

        It first waits for this many workers and recorders (await_clients). If recorders hold the beginning of
        a run of the same plan, that run continues; else a new one begins.

        After a user's error the take ends with the frames solved so far. After another error nothing is
        announced, because a restarted coordinator may still succeed.
        """
        held = await_clients(self._board, self._plan, workers, recorders, self._look)
        # Eight or more workers share limbs.
        shards = held.shards if held else max(1, max(workers, self._board.dispatcher.n_workers) // len(LIMBS))
        self._outgoing.run = held.run if held else secrets.token_hex(16)
        self._outgoing.continued_at = held.end_frame if held else 0
        self._solved_end = self._told_frame = held.end_frame if held else self._plan.frames.start
        self._board.recorders.begin(self._outgoing.run, self._solved_end, recorders)
        try:
            self._track(held, shards)
        except UserError:
            self._end()
            raise
        else:
            self._end()
        finally:
            self._board.close()
            if self._settling is not None:
                self._settling.seen.close()

    def _look(self, timeout_s: float = STOP_CHECK_S) -> bool:
        """Handle messages; False once a stop was requested."""
        beat()
        self._board.pump(timeout_s)
        return not self._stop

    def _track(self, held: Recording | None, shards: int) -> None:
        opening = Opening(self._plan, self._engine, self._board, self._outgoing, self._overhead, shards)
        if self._incoming.is_live:
            opening.rehearse()
        self._stage = "first frame" if held is None else "tracking"
        begun = self._solved_end if self._settling is None else self._plan.frames.start
        self._incoming.begin(self._outgoing.run, begun)
        tracking = self._first_frame(opening) if held is None else self._go_on(opening, held)
        if tracking is None:
            return
        self._unsure = tracking.unsure
        self._outgoing.begin_frame()
        self._overhead.begin()
        for number, (frame, aligned) in enumerate(self._frames_ahead(tracking), self._solved_end):
            if self._stop and not self._incoming.is_live:  # several recorded frames may have been read ahead
                break
            about(frame=number)
            self._publish(number, frame, self._solve(number, frame, tracking, aligned), tracking)
        if self._solved_end < self._plan.frames.stop:  # a stop was requested, or live input has ended
            if self._live_settling is not None:
                self._live_settling.conclude()
                self._is_settled = True
        elif self._settling is not None:
            self._is_settled = self._settle(self._settling, tracking)

    def _first_frame(self, opening: Opening) -> Tracking | None:
        """Solve and publish the first frame; None if a stop was requested before it came."""
        found = opening.find(self._frames)
        if found is None:
            return None
        frame, solution, tracking = found
        self._begin_live_settling(tracking)
        self._publish(self._plan.frames.start, frame, solution, tracking)
        if self._plan.frames.start not in self._plan.known_poses:  # else the fit or the first run has said it
            tracking.unsure.tell_first(frame.seen, solution.pose)
        return tracking

    def _go_on(self, opening: Opening, held: Recording) -> Tracking | None:
        """Continue another coordinator's run; None if a stop was requested before all was there for that."""
        tracking = opening.continue_after(held)
        self._begin_live_settling(tracking)
        if self._live_settling is not None and not settle_unchanged(self._board, held.end_frame, self._look):
            return None
        # The silhouettes of the frames that are solved are needed again to settle them.
        while self._settling is not None and self._settling.next_frame < held.end_frame:
            frame = self._frames.next()
            if frame is None:
                return None
            self._settling.note(frame.seen, None)
        return tracking

    def _begin_live_settling(self, tracking: Tracking) -> None:
        settings = self._plan.settings
        if self._incoming.is_live and settings.goes_both_ways:
            self._live_settling = LiveSettling(
                tracking.model, settings, tracking.limbs, self._solved_end, self._publish_settled
            )

    def _work_meanwhile(self) -> bool:
        """Settle live frames while there is no new one; False if there is nothing to do."""
        with self._overhead.fitting():
            return self._live_settling is not None and self._live_settling.work()

    def _frames_ahead(self, tracking: Tracking) -> Iterator[tuple[Frame, FrameSolution | None]]:
        """The frames that follow; where the limbs of known poses are left to the way back, some frames ahead
        of what is solved, with their alignments."""
        plan = self._plan

        def frames() -> Iterator[tuple[Frame, TriPlanes, Floats | None]]:
            for number in range(self._solved_end, plan.frames.stop):
                frame = self._frames.next()
                if frame is None:
                    return
                yield frame, frame.seen, plan.known_poses.get(number)

        if self._settling is not None and plan.known_poses:
            return aligned_ahead(tracking.model, plan.settings, frames())
        return ((frame, None) for frame, _, _ in frames())

    def _solve(
        self, number: int, frame: Frame, tracking: Tracking, aligned: FrameSolution | None
    ) -> FrameSolution:
        tracker = tracking.tracker
        tracking.limbs.frame = number
        was_lost = tracker.is_lost
        with self._overhead.fitting():
            known = self._plan.known_poses.get(number)
            solution = tracker.solve(frame.seen, frame.absent, known, aligned=aligned, hurried=frame.is_late)
        if was_lost and not tracker.is_lost:
            self._incoming.catch_up()
        solution.seconds["overhead"] = self._overhead.end_frame()
        return solution

    def _publish(self, number: int, frame: Frame, solution: FrameSolution, tracking: Tracking) -> None:
        memory = tracking.tracker.memory() | self._incoming.memory()
        pose = self._outgoing.pose(number, frame, solution, memory)
        self._board.publish(pose)
        if frame.shutter_s is not None:  # recorded frames' silhouettes are kept on arrival
            self._board.keep(self._outgoing.silhouettes(number, frame))
        if not tracking.tracker.is_lost:
            tracking.unsure.note(frame.seen, solution.pose)
        note_pose(pose)
        self._solved_end = self._told_frame = number + 1
        self._stage = "tracking"
        if self._settling is not None:
            self._settling.note(frame.seen, solution.pose)
        if self._live_settling is not None:
            self._live_settling.note(frame, replace(solution, seconds=pose.seconds), memory)

    def _publish_settled(self, number: int, frame: Frame, solution: FrameSolution) -> None:
        self._board.publish(self._outgoing.pose(number, frame, solution))

    def _settle(self, settling: Settling, tracking: Tracking) -> bool:
        """Solve all frames both ways and publish them again; False if a stop was requested meanwhile."""
        if not settling.fetch(self._board.recorders, self._look):
            return False
        for number, step in settling.solve(tracking.model, self._plan.settings, tracking.limbs):
            if step.solution is not None:
                frame = Frame(settling.seen[step.frame], number / self._plan.take.settings.fps, number)
                self._publish_settled(number, frame, step.solution)
                continue
            self._stage, self._told_frame = step.sweep, number
            about(frame=number)
            if not self._look(0.0):
                return False
        return True

    def _end(self) -> None:
        """Say that no pose will follow, and wait until all expected recorders have all frames."""
        self._stage = "ended"
        about(frame=None)
        if self._unsure is not None:
            self._unsure.conclude()
        self._board.end(self._outgoing.take_end(self._solved_end, is_settled=self._is_settled))
        if self._solved_end > self._plan.frames.start:
            await_confirmation(self._board, self._solved_end, self._look)
        self._board.publish_end()
        log.info("end: %s", self._board.counts())
