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
from services.mocap.take.pictures import read_trimap
from services.mocap.take.tables import read_poses_csv
from services.mocap.types import Floats, Mask
from services.runs import past_furniture

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


@pytest.mark.parametrize("is_noticed", [True, False])
def test_a_poor_fit_is_made_again_without_what_the_segmentation_takes_for_furniture(
    behind_table: Take, is_noticed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first body does not tell what hides the actor; that other cameras see somebody there does."""
    monkeypatch.setattr(past_furniture, "hidden_space", lambda model, *_: _rig_mask(model.rig))
    truth = read_poses_csv(behind_table.folder / "reference" / "poses.csv").poses
    bent = truth.copy()
    bent[:, DOF_INDEX["right_knee_flexion"]] += np.radians(100)
    tables = {}
    for camera in ("cam01", "cam02"):
        (first, *_) = sorted((behind_table.folder / "silhouettes" / camera).iterdir())
        tables[camera] = np.zeros((240, 320), np.bool_)
        tables[camera][_TABLE] = read_trimap(first).any(axis=0)  # below the arms

    def fitter(rig: Rig, seen: TriPlanes, actor: Actor, _poses: Floats, *_: Any) -> Fit:
        poses = (truth if seen.unsure.any() else bent)[: len(seen)]
        quality = quality_of(build_body(actor), poses, rig, seen)
        return Fit(actor, poses, quality, quality)

    found = fit_by(fitter, behind_table, range(3), blind=tables if is_noticed else {})
    np.testing.assert_array_equal(found.fit.poses, truth if is_noticed else bent)
    assert sorted(found.occluded) == (["cam01", "cam02"] if is_noticed else [])
    for mask in found.occluded.values():
        assert 0 < mask.sum() < 0.6 * tables["cam01"].sum(), "only where it hides the body"


def _rig_mask(rig: Rig) -> Mask:
    return np.zeros((rig.n_cameras, *rig.shape_px), np.bool_)
