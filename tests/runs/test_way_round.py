"""Which way round the actor is: how a fit decides between opposite first poses."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from services.mocap.body.actor import Actor
from services.mocap.body.skeleton import DOF_INDEX, DOFS
from services.mocap.camera.rig import Rig
from services.mocap.fit.fitting import Fit
from services.mocap.fit.quality import FitQuality
from services.mocap.search.first_pose import FirstPose
from services.mocap.search.found import FrameSolution
from services.mocap.search.settings import SearchSettings
from services.mocap.take.folder import open_take
from services.mocap.types import Floats
from services.runs.take_fit import TakeFit
from services.runs.take_silhouettes import seen_of
from services.runs.way_round import fit_best_way_round, tracked_px
from services.segmentation.segmenters import make_segmenter


@pytest.mark.parametrize(
    ("opposite_px", "fits_px", "motions_px", "chosen", "is_told"),
    [
        (None, {1.0: 50.0}, {}, 1.0, False),
        (1300.0, {1.0: 50.0}, {}, 1.0, False),
        (1100.0, {1.0: 50.0, 2.0: 60.0}, {}, 1.0, False),
        (1100.0, {1.0: 50.0, 2.0: 40.0}, {}, 2.0, False),
        (1000.0, {1.0: 50.0, 2.0: 49.0}, {1.0: 300.0, 2.0: 290.0}, 2.0, True),
        (1000.0, {1.0: 50.0, 2.0: 49.0}, {1.0: 200.0, 2.0: 290.0}, 1.0, False),
    ],
)
def test_the_fit_decides_between_opposite_first_poses(
    opposite_px: float | None,
    fits_px: dict[float, float],
    motions_px: dict[float, float],
    chosen: float,
    is_told: bool,
    caplog: pytest.LogCaptureFixture,
) -> None:
    """Poses are 1 and 2 all over; is_told: whether a warning says that it is uncertain."""
    shares, tried = list[float](), list[float]()

    def fit(pose: Floats, told: Callable[[float], None]) -> Fit:
        tried.append(float(pose[0]))
        for share in (0.0, 1.0):
            told(share)
        quality = FitQuality(np.array([fits_px[tried[-1]]]), np.zeros(1), np.ones((1, 3)))
        return Fit(Actor(), pose[None], quality, quality)

    ones = np.ones(len(DOFS))
    opposite = None if opposite_px is None else FrameSolution(2.0 * ones, opposite_px)
    first = FirstPose(FrameSolution(ones, 1000.0), opposite)
    way = fit_best_way_round(first, fit, lambda fitted: motions_px[fitted.poses[0, 0]], shares.append)
    assert way.pose.tolist() == way.fit.poses[0].tolist() == (chosen * ones).tolist()
    assert tried == list(fits_px)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert ("the other way fits nearly as well" in caplog.text) is is_told


def test_tracking_on_from_the_truth_costs_less_than_from_the_opposite(walk: Path, walk_fit: TakeFit) -> None:
    take = open_take(walk)
    made = make_segmenter(take, take.cameras)
    cameras, seen = seen_of(take, range(3), made, lambda _: None)
    turned = walk_fit.fit.poses.copy()
    turned[:, DOF_INDEX["root_heading"]] += np.pi
    ways = walk_fit.fit, replace(walk_fit.fit, poses=turned)
    right_px, wrong_px = (
        tracked_px(Rig.of(cameras), [seen[f] for f in range(3)], fit, SearchSettings()) for fit in ways
    )
    assert right_px < wrong_px
