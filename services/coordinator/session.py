"""One take from its first frame to its last: where frames come in, poses go out, and nothing is skipped."""

import logging
import time
from dataclasses import dataclass
from typing import Literal

import numpy as np

from proto.messages import Blob, Credit, Pose, Silhouettes, TakeEnd, TakeInfo
from services.coordinator.assembly import FrameAssembler
from services.coordinator.limbs import RemoteLimbs
from services.coordinator.switchboard import Switchboard
from services.mocap.body.actor import Actor, build_body
from services.mocap.body.skeleton import DOF_INDEX
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import unpack
from services.mocap.energy.cpu import CpuBackend
from services.mocap.energy.picture import Picture
from services.mocap.search.first_pose import FirstPose, find_first_pose, standing_pose
from services.mocap.search.frame import FrameSolution, extrapolated, solve_frame
from services.mocap.search.hull import carve
from services.mocap.search.settings import SearchSettings
from services.mocap.search.solve import Model
from services.mocap.take.folder import Take
from services.mocap.types import Bytes
from services.process import StopRequest

log = logging.getLogger(__name__)

_AHEAD_FRAMES = 8
"""How far segmentation may be ahead of the fit."""
_LOOK_S = 0.2
_CONFIRM_S = 4.0
"""How long recorders may take to ask for what they lack and confirm all frames."""
_SAY_WAITING_EVERY = 25
"""Looks without a frame after which the log says what is missing."""


@dataclass(frozen=True)
class Plan:
    """What a session is to do."""

    take: Take
    first_frame: int
    end_frame: int
    settings: SearchSettings
    actor: Actor | None
    """None: the generic body in the height that the take gives, or else that of the first frame's hull."""


class Session:
    """Tracks one take; sockets belong to the switchboard."""

    def __init__(self, plan: Plan, endpoint: str, stop: StopRequest) -> None:
        self._plan, self._stop = plan, stop
        self._name = plan.take.settings.name
        self._rig = Rig.of(plan.take.cameras)
        self._assembler = FrameAssembler(self._name, self._rig, plan.first_frame, plan.end_frame)
        self._board = Switchboard(endpoint, self._take_in)
        self._published_s = time.perf_counter()

    def _credit_end(self) -> int:
        return min(self._assembler.next_frame + _AHEAD_FRAMES, self._plan.end_frame)

    def _take_in(self, message: Silhouettes) -> None:
        self._assembler.add(message, self._credit_end())

    def await_clients(self, workers: int, recorders: int, timeout_s: float) -> None:
        """Wait until so many are there, or until the time is up."""
        looks = int(timeout_s / _LOOK_S)
        board = self._board
        while looks > 0 and not self._stop:
            if board.dispatcher.n_workers >= workers and board.n_recorders >= recorders:
                return
            board.pump(_LOOK_S)
            looks -= 1
        log.warning(
            "going on with %d of %d workers and %d of %d recorders",
            board.dispatcher.n_workers,
            workers,
            board.n_recorders,
            recorders,
        )

    def run(self) -> None:
        """Track all frames, or as many as are done when a stop is asked for; then say so and close."""
        end_frame = self._plan.first_frame
        try:
            end_frame = self._track()
        finally:
            first_frame = self._plan.first_frame
            self._board.end(TakeEnd(take=self._name, first_frame=first_frame, end_frame=end_frame))
            self._await_recorders(end_frame)
            self._board.close()

    def _track(self) -> int:
        """Returns one past the last frame that was solved."""
        first = self._next_frame()
        if first is None:
            return self._plan.first_frame
        model, actor = self._make_model(first)
        limbs = RemoteLimbs(model, self._name, actor.content_hash, self._board.dispatcher, self._board.pump)
        limbs.frame = self._plan.first_frame
        solution = self._first_pose(model, first, limbs)
        self._publish(limbs.frame, solution)
        poses = [solution.pose]
        for frame in range(self._plan.first_frame + 1, self._plan.end_frame):
            silhouettes = self._next_frame()
            if silhouettes is None:
                return frame
            limbs.frame = frame
            picture = Picture.whole(self._rig, silhouettes)
            solution = solve_frame(model, picture, extrapolated(poses[-2:]), self._plan.settings, limbs)
            self._publish(frame, solution)
            poses = [*poses[-1:], solution.pose]
        return self._plan.end_frame

    def _next_frame(self) -> Bytes | None:
        """The next frame's silhouettes; None when a stop was asked for."""
        looks = 0
        while not self._stop:
            silhouettes = self._assembler.take_next()
            self._board.give_credit(
                Credit(take=self._name, next_frame=self._assembler.next_frame, end_frame=self._credit_end())
            )
            if silhouettes is not None:
                return silhouettes
            self._board.pump(_LOOK_S)
            looks += 1
            if looks % _SAY_WAITING_EVERY == 0:
                missing = [self._plan.take.cameras[c].name for c in self._assembler.waiting_for()]
                log.info("frame %d still lacks %s", self._assembler.next_frame, ", ".join(missing))
        return None

    def _make_model(self, first: Bytes) -> tuple[Model, Actor]:
        """The model, once the first frame can tell the actor's height, and what clients need of it."""
        actor = self._plan.actor
        if actor is None:
            height_m = self._plan.take.settings.actor_height or self._hull_height_m(first)
            actor = Actor(height=round(height_m, 3))
        body = build_body(actor)
        self._board.offer(_blob(actor.content_hash, "actor", actor.to_toml()))
        self._board.offer(_blob(self._rig.content_hash, "rig", self._rig.to_json()))
        backend = CpuBackend(body, self._rig)
        self._board.announce(
            TakeInfo(
                take=self._name,
                fps=self._plan.take.settings.fps,
                first_frame=self._plan.first_frame,
                end_frame=self._plan.end_frame,
                actor=actor.content_hash,
                rig=self._rig.content_hash,
                backend=backend.name,
                search=self._plan.settings.to_wire(),
            )
        )
        return Model(body, self._rig, backend), actor

    def _hull_height_m(self, silhouettes: Bytes) -> float:
        height_m = carve(self._rig, unpack(silhouettes, self._rig.n_cameras)).height_m
        log.warning("no actor_height in take.toml: the first frame's visual hull is %.2f m high", height_m)
        return height_m

    def _first_pose(self, model: Model, silhouettes: Bytes, limbs: RemoteLimbs) -> FrameSolution:
        picture, settings = Picture.whole(self._rig, silhouettes), self._plan.take.settings
        hull = carve(self._rig, unpack(silhouettes, self._rig.n_cameras))
        if settings.initial_pose and self._plan.first_frame == 0:
            start = settings.with_initial_pose(standing_pose(model, hull))
            return solve_frame(model, picture, start[None], SearchSettings.wide(), limbs)
        facing_rad = settings.facing_rad if self._plan.first_frame == 0 else None
        first = find_first_pose(model, picture, hull, limbs, facing_rad)
        _tell_facing(first)
        return first.solution

    def _publish(self, frame: int, solution: FrameSolution) -> None:
        dispatcher, now = self._board.dispatcher, time.perf_counter()
        whole_s, self._published_s = now - self._published_s, now
        self._board.publish(
            Pose(
                take=self._name,
                frame=frame,
                time_s=frame / self._plan.take.settings.fps,
                energy_px=solution.energy_px,
                passes=solution.passes,
                evaluations=solution.evaluations,
                workers=dispatcher.n_workers,
                retries=dispatcher.retries,
                seconds={**solution.seconds, "frame": whole_s},
                pose=solution.pose,
            )
        )

    def _await_recorders(self, end_frame: int) -> None:
        for _ in range(int(_CONFIRM_S / _LOOK_S)):
            if self._board.recorded_up_to(end_frame):
                return
            self._board.pump(_LOOK_S)
        log.error("a recorder has not confirmed all frames")


def _blob(content_hash: str, kind: Literal["actor", "rig"], text: str) -> Blob:
    return Blob(hash=content_hash, kind=kind, content=np.frombuffer(text.encode(), np.uint8))


def _tell_facing(first: FirstPose) -> None:
    """Log which way the actor was found to face, and how sure that is."""
    facing_deg = np.degrees(first.solution.pose[DOF_INDEX["root_heading"]]) % 360
    if first.ambiguous:
        log.warning(
            "the actor faces %.0f degrees, but the other way fits nearly as well (%.0f against %.0f px): "
            "if the overlay shows the actor turned round, set facing in take.toml",
            facing_deg,
            first.solution.energy_px,
            first.opposite_energy_px,
        )
    else:
        log.info("the actor faces %.0f degrees", facing_deg)
