"""How good silhouettes are, on masks drawn by hand, and the table of a small take."""

import json
from collections.abc import Callable
from functools import partial
from io import StringIO
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console
from typer.testing import CliRunner

from bench.__main__ import app
from bench.segmentation import Row, as_table, measure, quality_of
from services.mocap.camera.camera import Camera
from services.mocap.energy.bitplanes import trimap_of
from services.mocap.errors import UserError
from services.mocap.take import layout
from services.mocap.take.folder import open_take
from services.mocap.types import ACTOR, UNSURE, Mask

SmallTake = Callable[..., Path]
Ball = Callable[[Camera, int], Mask]


def square() -> Mask:
    """20 x 20 pixels of a picture of 60 x 80."""
    mask = np.zeros((60, 80), bool)
    mask[20:40, 30:50] = True
    return mask


def test_the_true_silhouette_is_perfect() -> None:
    found = quality_of(trimap_of(square()), square())
    assert (found.iou, found.recall, found.surplus, found.shadow, found.unsure, found.edge_px) == (
        1,
        1,
        0,
        0,
        0,
        0,
    )


def test_half_of_it() -> None:
    half = square()
    half[:, 40:] = False
    found = quality_of(trimap_of(half), square())
    assert found.iou == found.recall == 0.5
    assert found.surplus == found.shadow == found.unsure == 0


def test_a_rim_is_surplus_but_no_shadow() -> None:
    rim = cv2.dilate(square().astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    found = quality_of(trimap_of(rim), square())
    assert found.recall == 1
    assert found.surplus == pytest.approx((22 * 22 - 400) / 400)
    assert found.iou == pytest.approx(400 / (22 * 22))
    assert found.shadow == 0
    assert found.edge_px == pytest.approx(1, abs=0.03)


def test_a_patch_away_from_it_is_shadow() -> None:
    patch = square()
    patch[50:55, 10:20] = True
    found = quality_of(trimap_of(patch), square())
    assert found.surplus == found.shadow == 50 / 400
    assert found.iou == 400 / 450


def test_unsure_pixels_count_for_nothing_else() -> None:
    trimap = trimap_of(square())
    trimap[:, 40:] = UNSURE  # a half of the actor, and background
    found = quality_of(trimap, square())
    assert found.iou == found.recall == 1
    assert found.unsure == 0.5
    assert found.surplus == 0
    everything = np.full((60, 80), UNSURE, np.uint8)
    assert (quality_of(everything, square()).iou, quality_of(everything, square()).unsure) == (1, 1)


def test_an_empty_silhouette_has_found_nothing() -> None:
    found = quality_of(np.zeros((60, 80), np.uint8), square())
    assert (found.iou, found.recall, found.surplus, found.edge_px) == (0, 0, 0, 0)


@pytest.mark.parametrize("shift_px", [0, 1, 3])
def test_an_outline_off_to_one_side(shift_px: int) -> None:
    found = quality_of(trimap_of(np.roll(square(), shift_px, axis=1)), square())
    assert found.recall == 1 - shift_px / 20
    assert found.iou == pytest.approx((20 - shift_px) / (20 + shift_px))
    assert found.edge_px <= shift_px
    assert (found.edge_px > 0) == (shift_px > 0)


@settings(max_examples=50)
@given(st.integers(0, 2**32 - 1))
def test_measures_fit_together(seed: int) -> None:
    rng = np.random.default_rng(seed)
    true = rng.random((12, 15)) < 0.4
    true[0, 0] = True
    trimap = rng.choice(np.array([0, UNSURE, ACTOR], np.uint8), true.shape)
    found = quality_of(trimap, true)
    area, hits = true.sum(), int(((trimap == ACTOR) & true).sum())
    assert 0 <= found.iou <= found.recall <= 1
    assert 0 <= found.shadow <= found.surplus
    sure = area * (1 - found.unsure)
    assert found.recall * sure == pytest.approx(hits)
    assert found.iou * (sure + found.surplus * area) == pytest.approx(hits)
    mirrored = quality_of(np.ascontiguousarray(trimap[:, ::-1]), np.ascontiguousarray(true[:, ::-1]))
    assert (mirrored.iou, mirrored.shadow, mirrored.unsure) == (found.iou, found.shadow, found.unsure)
    assert mirrored.edge_px == pytest.approx(found.edge_px)


def with_truth(folder: Path, ball: Ball, frames: int) -> Path:
    take = open_take(folder)
    for camera in take.cameras:
        truth = folder / "reference" / layout.SILHOUETTES / camera.name
        truth.mkdir(parents=True)
        for frame in range(frames):
            cv2.imwrite(str(layout.silhouette_path(truth, frame)), ball(camera, frame).astype(np.uint8) * 255)
    return folder


def test_a_row_per_segmenter_and_camera(small_take: SmallTake, ball_silhouette: Ball) -> None:
    folder = with_truth(small_take(n_cameras=3, frames=5), ball_silhouette, 5)
    rows = list(measure(lambda: folder, ["clean-plate", "paper"], every=2))
    assert [(row.segmenter, row.camera) for row in rows] == [
        (name, f"cam0{c}") for name in ("clean-plate", "paper") for c in (1, 2, 3)
    ]
    for row in rows:
        assert row.pictures == 5
        assert row.ms > 0
        assert row.iou is not None and row.worst_iou is not None
        assert 0.5 < row.worst_iou <= row.iou <= 1


def test_without_truth_there_is_only_the_time(small_take: SmallTake) -> None:
    rows = list(measure(small_take, ["paper"]))
    assert [row.camera for row in rows] == ["cam01", "cam02"]
    for row in rows:
        assert row.ms > 0
        assert {row.iou, row.worst_iou, row.recall, row.surplus, row.shadow, row.unsure, row.edge_px} == {
            None
        }


def test_ready_silhouettes_are_refused(small_take: SmallTake) -> None:
    with pytest.raises(UserError, match="has ready silhouettes: expected videos and clean plates"):
        list(measure(partial(small_take, source="silhouettes")))


def test_the_table_holds_means_and_the_worst() -> None:
    def row(take: str, camera: str, iou: float | None) -> Row:
        return Row(take, "paper", camera, 7, 2.0, iou, iou, iou, 0.1, 0.0, 0.0, 0.5)

    printed = StringIO()
    console = Console(width=160, file=printed)
    console.print(as_table([row("one", "cam01", 0.9), row("one", "cam02", 0.7), row("two", "cam01", 0.5)]))
    text = printed.getvalue()
    assert "0.800 (0.700)" in text
    assert "0.700 (0.500)" in text  # of all takes
    assert "all 2" in text


def test_the_command_takes_segmenters_and_a_step(
    small_take: SmallTake, ball_silhouette: Ball, tmp_path: Path
) -> None:
    folder, file = with_truth(small_take(frames=4), ball_silhouette, 4), tmp_path / "rows.json"
    arguments = ["segmentation", str(folder), "--segmenter", "paper", "--every", "3", "--json", str(file)]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    assert "paper" in done.output and "clean-plate" not in done.output
    rows = json.loads(file.read_text())["rows"]
    assert [(row["segmenter"], row["camera"]) for row in rows] == [("paper", "cam01"), ("paper", "cam02")]
    assert CliRunner().invoke(app, ["segmentation", str(folder), "--every", "0"]).exit_code != 0


def test_the_command_compares_takes_that_a_studio_makes(
    small_take: SmallTake, ball_silhouette: Ball, tmp_path: Path
) -> None:
    folder = with_truth(small_take(frames=3), ball_silhouette, 3)
    (tmp_path / "make_take.py").write_text(
        "import sys, shutil\n"
        "name, take, reference, *rest = sys.argv[1:]\n"
        "assert rest == ['--silhouettes']\n"
        f"shutil.copytree({str(folder)!r}, take, dirs_exist_ok=True)\n"
    )
    kept, file = tmp_path / "kept", tmp_path / "rows.json"
    studio = ["--studio", str(tmp_path), "--seeds", "dev-7:dev-8", "--takes", str(kept)]
    arguments = ["segmentation", *studio, "--segmenter", "paper", "--json", str(file)]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    assert {row["pictures"] for row in json.loads(file.read_text())["rows"]} == {3}
    assert sorted(path.name for path in (kept / "videos").iterdir()) == ["dev-7", "dev-8"]
    assert CliRunner().invoke(app, [*arguments, "--seeds", ""]).exit_code == 2
