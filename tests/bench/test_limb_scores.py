"""Scores that can be worked out by hand."""

from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from bench.limb_scores import (
    bones_off_percent,
    errors_of,
    limb_confidence,
    limb_errors_mm,
    mark_errors_of,
    marked_limbs,
    without_definition,
)
from bench.reliability import (
    MARKED,
    NOT_JUDGED,
    NOT_MARKED,
    Counted,
    as_table,
    draw,
    reliability_of,
    together,
)
from services.mocap.take.marks import PARTS, Marks
from services.mocap.take.tables import REFERENCE_JOINTS
from services.mocap.types import Floats

INDEX = {name: j for j, name in enumerate(REFERENCE_JOINTS)}
N_JOINTS = len(REFERENCE_JOINTS)


def standing(n_frames: int) -> Floats:
    """Somebody upright (F, 15, 3), in mm, who turns to the left by a quarter turn a frame, from facing x."""
    joints_mm = np.zeros((N_JOINTS, 3))
    for side, y in (("left", 1.0), ("right", -1.0)):
        joints_mm[INDEX[f"{side}_hip"]] = 0.0, 100.0 * y, 900.0
        joints_mm[INDEX[f"{side}_knee"]] = 0.0, 100.0 * y, 500.0
        joints_mm[INDEX[f"{side}_ankle"]] = 0.0, 100.0 * y, 100.0
        joints_mm[INDEX[f"{side}_shoulder"]] = 0.0, 180.0 * y, 1400.0
        joints_mm[INDEX[f"{side}_elbow"]] = 0.0, 430.0 * y, 1400.0
        joints_mm[INDEX[f"{side}_wrist"]] = 0.0, 680.0 * y, 1400.0
    joints_mm[INDEX["pelvis"]] = 0.0, 0.0, 900.0
    joints_mm[INDEX["neck"]] = 0.0, 0.0, 1450.0
    joints_mm[INDEX["head_top"]] = 0.0, 0.0, 1700.0
    turned = [joints_mm]
    for _ in range(1, n_frames):
        turned.append(turned[-1] @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    return np.array(turned)


def marks_of(n_frames: int, *marked: tuple[int, str]) -> Marks:
    distrusted = np.zeros((n_frames, len(PARTS)), bool)
    for frame, part in marked:
        distrusted[frame, list(PARTS).index(part)] = True
    return Marks(np.where(distrusted, 0.35, 1.0), distrusted)


def test_one_wrist_that_is_off() -> None:
    true_mm = standing(2)
    found_mm = true_mm.copy()
    found_mm[1, INDEX["left_wrist"]] += (0.0, 0.0, 300.0)
    errors = errors_of(found_mm, true_mm)
    assert errors.mean_mm == errors.raw_mean_mm == pytest.approx(300.0 / (2 * N_JOINTS))
    assert errors.p95_mm == pytest.approx(0.0)
    assert errors.lost_percent == pytest.approx(100.0 / 8)
    assert limb_errors_mm(found_mm, true_mm).tolist() == [[0.0] * 4, [pytest.approx(300.0), 0.0, 0.0, 0.0]]


def test_lost_silent_and_false() -> None:
    limbs_mm = np.array([[200.0, 200.0, 100.0, 10.0], [200.0, 10.0, 10.0, 10.0]])
    by_limb = marked_limbs(marks_of(2, (0, "left_arm"), (0, "left_leg"), (0, "right_leg")), 2)
    errors = mark_errors_of(limbs_mm, by_limb)
    assert errors.silent_percent == pytest.approx(100.0 * 2 / 8)  # the other arm, and the arm in frame 1
    assert errors.false_percent == pytest.approx(100.0 / 8)  # 100 mm is neither lost nor right
    assert errors.marked_percent == pytest.approx(100.0 * 3 / 8)


def test_a_mark_on_the_torso_is_on_all_limbs_and_one_on_the_head_on_none() -> None:
    assert marked_limbs(marks_of(2, (0, "head"), (1, "torso")), 2).tolist() == [[False] * 4, [True] * 4]
    assert not marked_limbs(None, 2).any()
    assert np.isnan(limb_confidence(None, 2)).all()


def test_what_moves_with_the_trunk_is_a_matter_of_definition() -> None:
    """The neck lies 30 mm farther forward in the other body, whichever way it faces."""
    true_mm = standing(3)
    found_mm = true_mm.copy()
    found_mm[:, INDEX["neck"]] += [(30.0, 0.0, 0.0), (0.0, 30.0, 0.0), (-30.0, 0.0, 0.0)]
    errors = errors_of(found_mm, true_mm)
    assert errors.mean_mm == pytest.approx(0.0, abs=1e-9)
    assert errors.raw_mean_mm == pytest.approx(30.0 / N_JOINTS)


def test_at_most_60_mm_are_a_matter_of_definition_and_nothing_of_limbs() -> None:
    true_mm = standing(2)
    off_mm = np.zeros_like(true_mm)
    off_mm[:, INDEX["left_hip"]] = off_mm[:, INDEX["left_knee"]] = (0.0, 0.0, 100.0)
    left_out_mm = np.linalg.norm(without_definition(off_mm, true_mm), axis=2)
    assert left_out_mm[:, INDEX["left_hip"]] == pytest.approx(40.0)
    assert left_out_mm[:, INDEX["left_knee"]] == pytest.approx(100.0)
    assert left_out_mm.sum() == pytest.approx(2 * 140.0)


def test_bones_are_compared_by_their_median_length() -> None:
    found_mm = standing(3)
    found_mm[0, INDEX["left_wrist"]] *= 2.0
    off = bones_off_percent(found_mm, {"forearm": 0.25, "thigh": 0.5, "hip_width": 0.1})
    assert off == {"forearm": pytest.approx(0.0), "thigh": pytest.approx(-20.0)}


def test_limb_frames_are_counted_by_what_was_said_of_them(tmp_path: Path) -> None:
    limbs_mm = np.array([[200.0, 10.0, 200.0, 10.0]])
    confidence = np.array([[0.35, 0.31, 1.0, np.nan]])
    marked = np.array([[True, True, False, False]])
    found = reliability_of(limbs_mm, marked, confidence)
    assert found == {
        MARKED: Counted(2, 1, 2),
        NOT_MARKED: Counted(2, 1, 0),
        NOT_JUDGED: Counted(1, 0, 0),
        "confidence 0.00 to 0.40": Counted(2, 1, 2),
        "confidence 0.98 to 1.00": Counted(1, 1, 0),
    }
    twice = together([found, found, {}])
    assert twice[MARKED] == Counted(4, 2, 4)
    assert list(twice) == list(found)
    console = Console(width=100, record=True)
    console.print(as_table([found]))
    assert "50.0 %" in console.export_text()
    draw([found], tmp_path / "plot.svg")
    assert "confidence of a limb" in (tmp_path / "plot.svg").read_text()
