"""Damped least squares over one shape and many poses (Levenberg and Marquardt).

There is a second solver in search/alignment, for one pose of a known body in milliseconds: compiled, with
matches of the rim alone, along its normals. A shape needs matches both ways, and takes seconds. One solver
for both was measured: results of some takes became worse.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from services.mocap.body import shape_space
from services.mocap.body.actor import Actor
from services.mocap.body.kinematics import N_DOF
from services.mocap.camera.rig import Rig
from services.mocap.fit.contours import Contour
from services.mocap.fit.jacobian import ShapeSlopes, jacobian
from services.mocap.fit.normal_equations import FitStage, State, System, normal_sums
from services.mocap.fit.priors import WEIGHT_PX3, Prior
from services.mocap.fit.rim_matching import Matches, match_frames
from services.mocap.side_by_side import side_by_side
from services.mocap.types import Floats

_FAR_PX = np.array([100.0])
"""Residual, in working pixels, of a contour whose body is outside of the picture: no state may be better for
leaving pictures."""
_GAIN = 0.995
"""A step without progress leaves more than this share of the least cost so far."""
CONTOUR_POINTS = 250
"""Most contour points of a view that are matched with the model."""
_AVERAGED = 4
"""Matches change with every step: the mean of the last states is better than the last one."""
_USUAL_COST_PX2 = 0.085
"""Cost per length of outline of silhouettes such as WEIGHT_PX3 was measured on; more is more noise."""
_MISFIT_STAGE = FitStage((), (), cap_px=0.8, steps=0, is_strict=True)
"""Its loss measures the misfit; missing pieces of silhouettes hardly count."""
_MISFIT_PULL = 4.0
"""How much more a misfit pulls than noise of the same cost: the smallest power of two for which bones of
takes of people are not pulled away from what people have."""
_EDGE_PX = 0.2
"""Standard deviation, in working pixels, of a segmentation's common offset of the actor's edge."""
_OFF_PX = 0.1
"""Shift of all outlines by which its effect is measured, so small that no residual becomes an outlier."""
_CAMERA_SLACK = 2.0
"""Cameras whose median residual is this many times the median over the cameras count less."""


@dataclass(frozen=True, eq=False)
class _Matched:
    """A state, its matches and its cost."""

    state: State
    matches: list[list[Matches]]
    cost: float


class Fitting:
    """The least-squares problem of some frames: contours of F frames before a rig, and a prior.

    base: has the mesh, the skirt and the hat whose shapes are sought.
    """

    def __init__(
        self, rig: Rig, contours: list[list[Contour]], prior: Prior, base: Actor = shape_space.GENERIC_ACTOR
    ) -> None:
        self._rig, self._contours, self._prior, self._base = rig, contours, prior, base
        self._camera_weights, self._n_views = np.ones(rig.n_cameras), len(contours) * rig.n_cameras

    def run(self, state: State, stage: FitStage, on_step: Callable[[], None]) -> State:
        """Minimise from a state; on_step is called stage.steps times in total.

        Every step changes the matches, so that costs vary by a few hundredths in the end: all steps are
        taken, and the mean of the last ones is returned.
        """
        matches = self._match(state)
        self._camera_weights = self._weigh_cameras(matches)
        current = best = self._matched(state, stage, matches)
        if len(stage.parameters) > 1:
            self._prior.misfit = _misfit(current)
            current = best = self._matched(state, stage, matches)
        trail, since_best, slopes = [current], 0, ShapeSlopes.at(state.x, stage.parameters, self._base)
        for _ in range(stage.steps):
            on_step()
            if since_best >= stage.patience:
                continue
            slopes = slopes.near(current.state.x, self._base)
            stepped = self._linearise(current, slopes, stage).step(current.state, stage)
            current = self._matched(stepped, stage)
            trail.append(current)
            since_best = 0 if current.cost < _GAIN * best.cost else since_best + 1
            best = min(best, current, key=lambda matched: matched.cost)
        mean = mean_of_last([matched.state for matched in trail])
        return min(best, self._matched(mean, stage), key=lambda matched: matched.cost).state

    def cost(self, state: State, stage: FitStage) -> float:
        """The cost of a state, with the cameras' weights of the last run."""
        return self._matched(state, stage).cost

    def shape_covariance(self, state: State, stage: FitStage) -> Floats:
        """(s, s) of the stage's shape parameters where its cost is least, cameras as in its run.

        Noise is assumed to be equal in all frames, because more frames of a person who hardly moves add no
        information. Directions that silhouettes do not determine have the prior's variance. The effect of a
        common offset of all outlines is added to both.
        """
        current = self._matched(state, stage)
        slopes = ShapeSlopes.at(state.x, stage.parameters, self._base)
        information = self._linearise(current, slopes, stage).shape_information()
        known = self._prior.shape_precision(self._n_views)[np.ix_(stage.parameters, stage.parameters)]
        scatter = WEIGHT_PX3 * _misfit(current) * (information - known) + self._prior.shape_weight_px3 * known
        inverse = np.asarray(np.linalg.inv(information))
        noise = self._n_views * inverse @ scatter @ inverse
        widened = [
            self._linearise(_off_by(current, off_px), slopes, stage).free_shape_step()
            for off_px in (-_OFF_PX, _OFF_PX)
        ]
        shift: Floats = _EDGE_PX * (widened[1] - widened[0]) / (2.0 * _OFF_PX)
        return noise + np.outer(shift, shift)

    def _match(self, state: State) -> list[list[Matches]]:
        body = shape_space.body_of(state.x, self._base)
        return match_frames(body, state.poses, self._rig, self._contours)

    def _matched(self, state: State, stage: FitStage, matches: list[list[Matches]] | None = None) -> _Matched:
        """A state with its cost; matches: its own, where they are known."""
        matches = self._match(state) if matches is None else matches
        cost = self._prior.cost(state, self._n_views)
        for views in matches:
            for view, camera_weight in zip(views, self._camera_weights, strict=True):
                cost += camera_weight * float(view.lengths_px @ stage.losses(view.residuals_px))
                cost += view.unmatched_px * float(stage.losses(_FAR_PX)[0])
        return _Matched(state, matches, cost)

    def _weigh_cameras(self, matches: list[list[Matches]]) -> Floats:
        """(C,) lower weights for cameras whose silhouettes disagree with the others."""
        per_camera = [
            np.concatenate([np.abs(views[c].residuals_px) for views in matches])
            for c in range(self._rig.n_cameras)
        ]
        medians_px = np.array([np.median(r) if len(r) else np.nan for r in per_camera])
        typical = np.nanmedian(medians_px) if np.any(np.isfinite(medians_px)) else 1.0
        excess = np.nan_to_num(medians_px, nan=0.0) / max(_CAMERA_SLACK * float(typical), 1e-6)
        weights: Floats = 1.0 / np.maximum(excess, 1.0) ** 2
        return weights

    def _linearise(self, current: _Matched, slopes: ShapeSlopes, stage: FitStage) -> System:
        system = self._prior.system(current.state, stage, self._n_views)
        columns = np.array([*stage.dofs, *range(N_DOF, N_DOF + len(stage.parameters))])

        def sums_of(f: int) -> tuple[Floats, Floats]:
            views = current.matches[f]
            rows = jacobian(slopes, current.state.poses[f], self._rig, views)[:, columns]
            residuals_px = np.concatenate([view.residuals_px for view in views])
            lengths_px = [w * view.lengths_px for view, w in zip(views, self._camera_weights, strict=True)]
            weights = np.concatenate(lengths_px) * stage.weights(residuals_px)
            return normal_sums(rows, residuals_px, weights)

        for f, (sums, gradient) in enumerate(side_by_side(sums_of, range(len(current.matches)))):
            system.add_frame(f, sums, gradient)
        return system


def mean_of_last(trail: Sequence[State]) -> State:
    """The mean of the last states of a minimisation."""
    last = trail[-_AVERAGED:]
    return State(np.mean([s.x for s in last], axis=0), np.mean([s.poses for s in last], axis=0))


def _misfit(matched: _Matched) -> float:
    """How many times the usual variance the data have, from the cost of their residuals.

    Usual noise has the usual cost. A higher cost is not noise, but a body of another form than the model's.
    It is the same in every frame and along a whole limb, so the excess is squared and counts several times.
    """
    views = [view for of_frame in matched.matches for view in of_frame]
    length_px = sum(float(view.lengths_px.sum()) for view in views)
    cost = sum(float(view.lengths_px @ _MISFIT_STAGE.losses(view.residuals_px)) for view in views)
    excess = cost / max(_USUAL_COST_PX2 * length_px, 1e-9)
    return 1.0 + _MISFIT_PULL * max(excess**2 - 1.0, 0.0)


def _off_by(matched: _Matched, off_px: float) -> _Matched:
    """The same matches as if all outlines were as far from the model's, in working pixels."""
    matches = [
        [replace(view, residuals_px=np.full(len(view.residuals_px), off_px)) for view in views]
        for views in matched.matches
    ]
    return replace(matched, matches=matches)
