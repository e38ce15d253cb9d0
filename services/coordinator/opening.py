"""How tracking begins: with the actor in the first frame, or after the poses of another coordinator."""

import logging
import time
from dataclasses import dataclass

from proto.messages import Recording
from services.coordinator.frame_input import FrameInput
from services.coordinator.incoming import Frame
from services.coordinator.limbs import RemoteLimbs
from services.coordinator.outgoing_messages import OutgoingMessages
from services.coordinator.overhead import Overhead
from services.coordinator.plan import Plan
from services.coordinator.switchboard import Switchboard
from services.coordinator.unsure import UnsureParts
from services.logs import NOT_YET, about
from services.mocap.body.actor import Actor
from services.mocap.energy.engine import Engine
from services.mocap.errors import TakeError
from services.mocap.search.first_frame import FirstFrame, FirstFrameSearch, told_actor
from services.mocap.search.found import FrameSolution
from services.mocap.search.model import Model, model_of
from services.mocap.search.tracker import Tracker
from services.mocap.search.warm_up import rehearse
from services.mocap.types import Floats

log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Tracking:
    """What tracks the actor once it is known."""

    model: Model
    limbs: RemoteLimbs
    tracker: Tracker
    unsure: UnsureParts


class Opening:
    """Makes what tracks the actor, and announces the take to recorders and viewers."""

    def __init__(
        self,
        plan: Plan,
        engine: Engine,
        board: Switchboard,
        outgoing: OutgoingMessages,
        overhead: Overhead,
        shards: int,
    ) -> None:
        """shards: see RemoteLimbs."""
        self._plan, self._engine, self._board, self._outgoing = plan, engine, board, outgoing
        self._overhead, self._shards = overhead, shards
        self._rehearsed: Model | None = None
        """Of the actor that is told."""

    def rehearse(self) -> None:
        """Prepare everything for the first pose, here and in workers, before cameras start, because cameras
        do not wait."""
        told = told_actor(self._plan.actor, self._plan.take.settings)
        model = model_of(told or Actor(), self._plan.rig, self._engine)
        began_s = time.perf_counter()
        rehearse(model, self._pool(model, told or Actor()), self._plan.settings)
        log.info("ready for the first shot: prepared in %.1f s", time.perf_counter() - began_s)
        if told is not None:
            self._rehearsed = model
        else:
            model.close()

    def find(self, frames: FrameInput) -> tuple[Frame, FrameSolution, Tracking] | None:
        """Find the actor: in the first frame of a recorded take, in the first live one that shows somebody.

        None if a stop was requested before. Raises TakeError if a recorded take's first frame cannot be used.
        """
        incoming, reason = self._board.incoming, ""
        while (frame := frames.next()) is not None:
            if incoming.is_live and set(frame.absent) - set(incoming.waiting_for()):
                continue  # cameras that are only late will be in the next one
            about(frame=self._plan.frames.start)
            self._outgoing.begin_frame()
            try:
                solved = self._solved(frame)
            except TakeError as problem:
                if not incoming.is_live:
                    raise
                if str(problem) != reason:  # once for each reason
                    reason = str(problem)
                    log.info("first pose:%s%s", NOT_YET, reason)
                continue
            incoming.catch_up()
            tracking = self._tracking(solved.model, solved.actor, solved.solution.pose[None])
            return frame, solved.solution, tracking
        return None

    def _solved(self, first: Frame) -> FirstFrame:
        plan = self._plan
        search = FirstFrameSearch(
            plan.rig,
            plan.take.settings.beginning_at(plan.frames.start),
            self._pool,
            self._engine,
            plan.settings.without_cameras(first.absent, plan.rig.n_cameras),
            names=plan.take.camera_names,
            told_model=self._rehearsed,
        )
        return search.solve(first.seen, plan.actor, plan.known_poses.get(plan.frames.start))

    def continue_after(self, held: Recording) -> Tracking:
        """Continue after the recorders' poses, as if this coordinator had solved them itself."""
        log.warning("continuing run %s at frame %d", held.run[:8], held.end_frame)
        actor = self._plan.actor or Actor.from_toml(held.actor.tobytes().decode())
        self._board.dispatcher.retries = held.retries
        self._board.dispatcher.helped.update(held.worker_backends)
        tracking = self._tracking(model_of(actor, self._plan.rig, self._engine), actor, held.poses)
        tracking.tracker.recall(held.memory)
        self._board.incoming.recall(held.memory)
        return tracking

    def _tracking(self, model: Model, actor: Actor, poses: Floats) -> Tracking:
        limbs = self._pool(model, actor)
        self._board.announce(self._outgoing.take_info(actor, self._shards))
        tracker = Tracker(model, self._plan.settings, limbs, poses)
        return Tracking(model, limbs, tracker, UnsureParts(model, self._plan.take.camera_names))

    def _pool(self, model: Model, actor: Actor) -> RemoteLimbs:
        """The pool of workers for an actor."""
        for blob in self._outgoing.contents(actor):
            self._board.offer(blob)
        dispatcher, pump = self._board.dispatcher, self._board.pump
        ids = (self._outgoing.take, self._outgoing.run, actor.content_hash)
        limbs = RemoteLimbs(model, *ids, dispatcher, pump, self._shards, self._overhead)
        limbs.frame = self._plan.frames.start
        return limbs
