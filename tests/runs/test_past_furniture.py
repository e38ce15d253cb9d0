"""The actor is fitted past furniture, if that explains more, with the fitting itself replaced."""

from typing import Any

import cv2
import numpy as np
import pytest

from exact_take import write_exact_take
from first_pose import say_first_pose
from replaced_fit import fit_by
from services.mocap.body.actor import Actor, build_body
from services.mocap.body.skeleton import DOF_INDEX
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.fit.fitting import Fit
from services.mocap.fit.quality import quality_of
from services.mocap.take.folder import Take, open_take
from services.mocap.take.tables import read_poses_csv
from services.mocap.types import Floats

_TABLE = np.s_[130:, :]
"""In two of four pictures: it hides the shanks."""


@pytest.fixture(scope="module")
def behind_table(tmp_path_factory: pytest.TempPathFactory) -> Take:
    """A take without an actor, before whose legs a table stands in two of four cameras."""
    folder = tmp_path_factory.mktemp("table") / "walk"
    write_exact_take(folder, n_frames=3, n_cameras=4)
    say_first_pose(folder)
    for camera in ("cam01", "cam02"):
        for path in (folder / "silhouettes" / camera).iterdir():
            silhouette = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
            assert silhouette[_TABLE].any()
            silhouette[_TABLE] = 0
            cv2.imwrite(str(path), silhouette)
    return open_take(folder)


@pytest.mark.parametrize("is_better", [True, False])
def test_legs_are_fitted_past_what_may_hide_them(behind_table: Take, is_better: bool) -> None:
    """The fit bends a leg out of silhouettes that lack it, and not where it may be hidden there."""
    truth = read_poses_csv(behind_table.folder / "reference" / "poses.csv").poses
    bent = truth.copy()
    bent[:, DOF_INDEX["right_knee_flexion"]] += np.radians(100)
    unsure_px = list[int]()

    def fitter(rig: Rig, seen: TriPlanes, actor: Actor, _poses: Floats, *_: Any) -> Fit:
        unsure_px.append(np.count_nonzero(seen.unsure))
        poses = (truth if seen.unsure.any() and is_better else bent)[: len(seen)]
        quality = quality_of(build_body(actor), poses, rig, seen)
        return Fit(actor, poses, quality, quality)

    found = fit_by(fitter, behind_table, range(3))
    assert unsure_px[0] == 0
    assert any(unsure_px)
    np.testing.assert_array_equal(found.fit.poses, truth if is_better else bent)
    assert sorted(found.occluded) == (["cam01", "cam02"] if is_better else [])
    said = [sentence for sentence in found.warnings if "something hides the actor" in sentence]
    assert len(said) == len(found.occluded)
    for name, mask in found.occluded.items():
        assert any(name in sentence for sentence in said)
        assert mask[_TABLE].sum() > 0.8 * mask.sum()
    one = fit_by(fitter, behind_table, range(1))
    assert one.occluded.keys() == found.occluded.keys(), "one frame tells as much"
