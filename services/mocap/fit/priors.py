"""The priors of a fit: people's proportions, and the initial pose.

Shapes are normally distributed over the shape space. Stout people are stout everywhere, and neighbouring
places on a limb or the trunk change together; bones vary independently, except that those of a limb, and of
both limbs, are correlated.

Everything is weighed in the unit of the data's cost, square working pixels of distance times working
pixels of outline: one standard deviation costs as much as WEIGHT_PX3 in every view.
"""

from math import inf

import numpy as np

from services.mocap.body.actor import DEFAULT_HEIGHT_M
from services.mocap.body.shape_space import DEVIATIONS, INDEX
from services.mocap.body.skeleton import DOFS, JOINTS, SEGMENTS, Dof, dofs_of
from services.mocap.body.skeleton_table import EXTREMITY_WINDOW_PX, ROWS
from services.mocap.fit.normal_equations import FitStage, State, System
from services.mocap.types import Floats, Mask

WEIGHT_PX3 = 0.05
"""Times eight cameras and ten frames, that is the variance of what the data pull at, as measured on people of
known shape in noisy silhouettes: the prior then weighs what it should."""
_WEIGHT_VARIED_PX3 = 0.02
"""For poses that differ, because errors of a fit differ between poses."""
_VARIED_RAD = 0.15
"""From this standard deviation of the bend of elbows and knees on, poses differ. First frames, and two
seconds of a quiet motion, have .05; whole motions, .2 to .8."""
_MEASURED_HEIGHT_DEVIATION = 0.008
"""Of the logarithm of a height that somebody measured."""
_TWIST_DEVIATION_RAD, _END_DEVIATION_RAD, _ANGLE_DEVIATION_RAD = 0.4, 0.4, 1.5
"""Standard deviation of the pose from the initial one: twists; head, hands and feet; all other joints."""
_ROOT = JOINTS[0].name
_HINGES = [dof for joint in JOINTS if len(dofs := dofs_of(joint.name)) == 1 for dof in dofs]
"""The bend of elbows and knees."""
_END_JOINTS = {segment.joint for segment in SEGMENTS if segment.row.window_px == EXTREMITY_WINDOW_PX}

_STOUTNESS = 0.5
"""Share of a girth's variance that all girths have in common."""
_CHAINS = ("trunk_width", "trunk_depth", "arm_girth", "leg_girth")
_NECK = "neck_girth"
_HIPS = ("trunk_width_hip", "trunk_depth_hip", "leg_girth_hip")
_HIPS_ALIKE = 0.25
"""Share of the variance at the hips that pelvis and thighs have in common besides stoutness."""
_CHAIN_REACH = 1.5
"""Controls along a chain over which the correlation falls to 1/e."""
_LENGTHS = [(row, length) for row in ROWS for length in row.lengths]
_LIMB_BONES = [length.bone for row, length in _LENGTHS if row.paired]
_LONG_BONES = [length.bone for _, length in _LENGTHS if length.looks_changed_by_clothes]
_MEAN_FACTORS = {length.bone: length.mean_factor for _, length in _LENGTHS} | {"foot_depth": 1.35}
"""People's mean measures over the generic body's, both over stature. Feet have soles of 1 to 4 cm."""
_LOOSE = 8.0
"""From this misfit on, the deviations of _LONG_BONES are divided by the misfit over it. Loose clothes shift
hips, knees and ankles in all views and frames alike, and the data's cost cannot tell that from long or short
bones."""
_LONG_LIMBS = 0.4
"""Share of a limb bone's variance that all limb bones have in common."""


def _correlation() -> Floats:
    """(n, n) as a sum of non-negative parts, so that it is a valid correlation matrix."""
    names = list(INDEX)
    chain_of = {name: next((c for c in _CHAINS if name.startswith(c)), "") for name in names}
    stout = np.array([bool(chain_of[name]) or name == _NECK for name in names], float)
    limbs = np.array([name in _LIMB_BONES for name in names], float)
    places = np.arange(len(names))
    near = np.exp(-np.abs(places[:, None] - places) / _CHAIN_REACH)
    same = np.array([[bool(chain_of[a]) and chain_of[a] == chain_of[b] for b in names] for a in names])
    own = np.where(same, near, np.eye(len(names)))
    hips = np.array([name in _HIPS for name in names], float)
    groups = ((_STOUTNESS, stout), (_LONG_LIMBS, limbs), (_HIPS_ALIKE, hips))
    shared = sum((share * np.outer(group, group) for share, group in groups), np.zeros(near.shape))
    left = np.sqrt(1.0 - np.diag(shared))
    correlation: Floats = shared + own * np.outer(left, left)
    return correlation


COVARIANCE: Floats = _correlation() * np.outer(DEVIATIONS, DEVIATIONS)
"""(n, n) of the shape vectors of people."""
_IS_LONG: Mask = np.array([name in _LONG_BONES for name in INDEX])
MEAN: Floats = np.log([_MEAN_FACTORS.get(name, 1.0) for name in INDEX])
"""(n,) of the shape vectors of people; zero is the generic body."""
_LEAST_STIFFNESS = 1e-9
"""Against steps of pose parameters that nothing determines: the place of a body that no silhouette shows."""


class Prior:
    """Draws shapes to the mean of people, and poses to the initial ones."""

    def __init__(self, poses: Floats, height_m: float | None = None) -> None:
        """poses (F, D): those begun with. height_m: the actor's, if it is known."""
        is_varied = np.std(poses[:, _HINGES], axis=0).mean() >= _VARIED_RAD
        self._poses, self._weight_px3 = poses, _WEIGHT_VARIED_PX3 if is_varied else WEIGHT_PX3
        self.misfit = 1.0
        """How many times as much the prior on shapes counts; that on long bones counts more beyond _LOOSE."""
        covariance, self._mean = COVARIANCE.copy(), MEAN.copy()
        if height_m is not None:
            height = INDEX["height"]
            self._mean[height] = np.log(height_m / DEFAULT_HEIGHT_M)
            covariance[height, height] = _MEASURED_HEIGHT_DEVIATION**2
        self._pose_precision = np.array([_deviation(dof) ** -2 for dof in DOFS])
        self._shape_precision = np.asarray(np.linalg.inv(covariance), np.float64)

    def cost(self, state: State, n_views: int) -> float:
        """What a state costs, seen in n_views."""
        off, off_poses = state.x - self._mean, (state.poses - self._poses) ** 2 @ self._pose_precision
        shape = float(off @ self.shape_precision(n_views) @ off)
        return shape + n_views * self._weight_px3 * float(off_poses.sum()) / len(state.poses)

    @property
    def shape_weight_px3(self) -> float:
        """What one standard deviation of a shape costs in a view."""
        return self.misfit * self._weight_px3

    def shape_precision(self, n_views: int) -> Floats:
        """(S, S) the prior's part of the normal equations of shapes seen in n_views."""
        held = np.where(_IS_LONG, max(self.misfit / _LOOSE, 1.0), 1.0)
        precision: Floats = self.shape_weight_px3 * n_views * self._shape_precision * np.outer(held, held)
        return precision

    def system(self, state: State, stage: FitStage, n_views: int) -> System:
        """The normal equations of that cost in what a stage varies."""
        parameters, dofs, n_frames = list(stage.parameters), list(stage.dofs), len(state.poses)
        shape, per_frame = self.shape_precision(n_views), self._weight_px3 * n_views / n_frames
        return System(
            poses=np.tile(
                np.diag(per_frame * self._pose_precision[dofs] + _LEAST_STIFFNESS), (n_frames, 1, 1)
            ),
            cross=np.zeros((n_frames, len(dofs), len(parameters))),
            shape=shape[np.ix_(parameters, parameters)],
            pose_slopes=(per_frame * self._pose_precision * (state.poses - self._poses))[:, dofs],
            shape_slopes=(shape @ (state.x - self._mean))[parameters],
        )


def _deviation(dof: Dof) -> float:
    if dof.joint == _ROOT:
        return inf
    if dof.role == "twist":
        return _TWIST_DEVIATION_RAD
    return _END_DEVIATION_RAD if dof.joint in _END_JOINTS else _ANGLE_DEVIATION_RAD
