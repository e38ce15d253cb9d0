"""The first frame of a take: finds the actor, whose height may be unknown, and the first pose."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from services.mocap.body.actor import DEFAULT_HEIGHT_M, Actor
from services.mocap.body.body_mesh import OwnMesh
from services.mocap.body.skeleton import DOF_INDEX
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes, unpack
from services.mocap.energy.engine import Engine
from services.mocap.energy.picture import Picture
from services.mocap.errors import CertainError, TakeError
from services.mocap.search.first_pose import FirstPose, find_first_pose, standing_pose
from services.mocap.search.found import FrameSolution
from services.mocap.search.frame import solve_frame
from services.mocap.search.hull import Hull, carve
from services.mocap.search.jobs import LimbPool
from services.mocap.search.line import minimise_line
from services.mocap.search.model import Model, model_of
from services.mocap.search.other_people import without_others
from services.mocap.search.plausibility import look_first
from services.mocap.search.settings import SearchSettings
from services.mocap.search.single_person import check_alone
from services.mocap.search.unsure_shares import UnsureShares
from services.mocap.take.settings import TakeSettings
from services.mocap.types import Floats

log = logging.getLogger(__name__)

_HEIGHT_RANGE_M = (0.7, 2.4)
"""Range of heights, from children to the tallest adults."""
_LIES = (
    "the actor is only %.2f m high in the first frame, and seems to lie or crawl: a height of %.2f m is "
    "assumed: give actor_height in take.toml"
)
_HEIGHT_STEP = 0.03
"""First change of the height, as a share of it."""
_LARGEST_STEPS = 5.0
_TOLERANCE_STEPS = 0.15
_MOST_TRIES = 5
"""Evaluations after the best height is bracketed."""


@dataclass(frozen=True, eq=False)
class FirstFrame:
    """The results of the first frame for the whole take."""

    actor: Actor
    model: Model
    first: FirstPose

    @property
    def solution(self) -> FrameSolution:
        """The pose that fits best."""
        return self.first.solution


@dataclass(frozen=True, eq=False)
class FirstFrameSearch:
    """Finds the actor and the pose of a take's first frame."""

    rig: Rig
    hints: TakeSettings
    """Of take.toml, for this very frame."""
    pool: Callable[[Model, Actor], LimbPool]
    """Makes the limb pool for a model."""
    engine: Engine
    """Makes the model's backend."""
    settings: SearchSettings
    """Those of the frames to come."""
    names: Sequence[str] = ()
    """Of the cameras."""
    mesh: OwnMesh | None = None
    """In place of the generic body, where the actor is not known."""
    told_model: Model | None = None
    """The model of the told actor (told_actor), where there is one already."""

    def solve(self, seen: TriPlanes, actor: Actor | None, fitted_pose: Floats | None = None) -> FirstFrame:
        """The actor and the pose, from what is seen (P, H, W); actor: None where the take has none.

        fitted_pose: (D,), where it was found along with the actor; then nothing is searched far and wide.
        Raises TakeError where nobody is to be seen, or the silhouettes make no sense (look_first).
        """
        n_cameras = self.rig.n_cameras
        if actor is not None and fitted_pose is not None:
            model = self._model_of(actor)
            picture = model.picture_of(without_others(model, seen, fitted_pose))
            limbs = self.pool(model, actor)
            solution = solve_frame(model, picture, fitted_pose[None], self.settings, limbs)
            return FirstFrame(actor, model, FirstPose(solution))
        masks, possible = unpack(seen.silhouettes, n_cameras), unpack(seen.possible, n_cameras)
        look = look_first(self.rig, masks, self.names, possible)
        for remark in look.remarks:
            log.warning("%s", remark)
        picture = Picture.of_frame(self.rig, look.alone(seen))
        believing = replace(self, settings=self.settings.without_cameras(look.left_out, n_cameras))
        hull = carve(self.rig, look.believed(masks), look.possible)
        guess = believing.guess(hull, picture, actor)
        if actor is not None or self.hints.actor_height is not None:
            return guess
        guess.model.close()
        pose = guess.solution.pose
        height_m = believing.fit_height(picture, pose, guess.actor.height)
        actor = Actor(height=round(height_m, 3), mesh=self.mesh)
        log.warning("take.toml has no actor_height: %.2f m fits the first frame best", actor.height)
        model = model_of(actor, self.rig, self.engine)
        wide = believing.settings.widened()
        fitted = solve_frame(model, picture, pose[None], wide, self.pool(model, actor))
        return FirstFrame(actor, model, FirstPose(fitted))

    def guess(
        self, hull: Hull, picture: Picture, actor: Actor | None, *, is_fitted_next: bool = False
    ) -> FirstFrame:
        """The pose, with the actor or else with the generic body, from the frame's hull and its picture.

        That body, or a mesh in its place, has the height of take.toml, else of the visual hull. Raises
        TakeError for an implausible height, or if a body of the hull's height covers too little of the
        silhouettes, unless it is_fitted_next; the message first mentions unsure areas.
        """
        told = told_actor(actor, self.hints, self.mesh)
        unsure = UnsureShares.of_picture(picture, self.rig, self.names)
        with unsure.blamed_first():
            actor = told or Actor(height=round(_plausible_height_m(hull), 3), mesh=self.mesh)
        if not (hull.suits(actor.height) or hull.lies(actor.height)):
            sentence = (
                f"the actor, {actor.height:.2f} m tall, is {hull.height_m:.2f} m high in the first frame: "
                "check the scale of the calibration"
            )
            log.warning("%s", unsure.before(sentence))
        model = self._model_of(actor)
        first = self._first_pose(model, picture, hull, self.pool(model, actor))
        if not is_fitted_next:  # before a fit, a coat is wider than any body
            tell_facing(first)
            pose = first.solution.pose
            try:
                check_alone(model, picture, pose, self.settings, self.names, is_told=told is not None)
            except TakeError:
                model.close()
                raise
        return FirstFrame(actor, model, first)

    def _model_of(self, actor: Actor) -> Model:
        return self.told_model or model_of(actor, self.rig, self.engine)

    def _first_pose(self, model: Model, picture: Picture, hull: Hull, limbs: LimbPool) -> FirstPose:
        if self.hints.initial_pose:
            standing = standing_pose(model, hull)
            standing[DOF_INDEX["root_heading"]] = self.hints.facing_rad or 0.0
            start = self.hints.with_initial_pose(standing)
            return FirstPose(solve_frame(model, picture, start[None], self.settings.widened(), limbs))
        return find_first_pose(model, picture, hull, limbs, self.settings, self.hints.facing_rad)

    def fit_height(self, picture: Picture, pose: Floats, height_m: float) -> float:
        """The height in metres, near height_m, of the body that leaves the least energy: the generic one, or
        the mesh in its place.

        picture: a whole frame. pose (D,): its pose, found with a body of height_m, which is in
        _HEIGHT_RANGE_M; for each other height one pass searches the pose from there.
        """
        # No level of detail: thinning a body's meshes takes longer than one search.
        once = self.settings.model_copy(update={"max_passes": 1, "detail_px": 0.0})

        def energy_px(steps: float) -> float:
            scale = 1.0 + _HEIGHT_STEP * steps
            actor = Actor(height=height_m * scale, mesh=self.mesh)
            model, start = model_of(actor, self.rig, self.engine), pose.copy()
            # The feet stay on the ground.
            start[DOF_INDEX["root_z"]] += (scale - 1.0) * model.body.pelvis_height_m
            found = solve_frame(model, picture, start[None], once, self.pool(model, actor))
            model.close()
            return found.energy_px

        low, high = ((limit_m / height_m - 1.0) / _HEIGHT_STEP for limit_m in _HEIGHT_RANGE_M)
        least, most = max(low, -_LARGEST_STEPS), min(high, _LARGEST_STEPS)
        best = minimise_line(energy_px, energy_px(0.0), least, most, _TOLERANCE_STEPS, _MOST_TRIES)
        return height_m * (1.0 + _HEIGHT_STEP * best.t)


def told_actor(actor: Actor | None, hints: TakeSettings, mesh: OwnMesh | None = None) -> Actor | None:
    """The actor, else the generic body or a mesh with the height of the hints; None if they have no
    height."""
    if actor is not None or hints.actor_height is None:
        return actor
    return Actor(height=round(hints.actor_height, 3), mesh=mesh)


def _plausible_height_m(hull: Hull) -> float:
    low_m, high_m = _HEIGHT_RANGE_M
    if hull.may_be(low_m, high_m):
        return min(max(hull.height_m, low_m), high_m)
    if hull.lies(DEFAULT_HEIGHT_M):
        log.warning(_LIES, hull.height_m, DEFAULT_HEIGHT_M)
        return DEFAULT_HEIGHT_M
    # What is unsure, or not seen, makes a hull smaller, never larger.
    raised = CertainError if hull.height_m > high_m else TakeError
    raise raised(
        f"calibration.toml: what cameras see of the actor in the first frame is {hull.height_m:.2f} m high: "
        "check that translations are in metres, or give actor_height in take.toml"
    )


def tell_facing(first: FirstPose) -> None:
    """Log the direction that the actor faces, and how certain it is."""
    facing_deg = np.degrees(first.solution.pose[DOF_INDEX["root_heading"]]) % 360
    if first.opposite is not None and first.ambiguous:
        log.warning(
            "the actor faces %.0f degrees, but the other way fits nearly as well (%.0f against %.0f px): "
            "if the overlay shows the actor turned round, set facing in take.toml",
            facing_deg,
            first.solution.energy_px,
            first.opposite.energy_px,
        )
    else:
        log.info("the actor faces %.0f degrees", facing_deg)
