"""The table of what is known of a frame: how a quantity is read from a frame, and what the rows must hold."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from proto.messages import Pose
from services.mocap.take.marks import PARTS
from services.mocap.take.quantities import QUANTITIES, Quantity, further_columns, numbers_of

ROWS = {row.name: row for row in QUANTITIES}


def test_rows_have_names_of_their_own_and_are_fields_or_explained() -> None:
    assert len(ROWS) == len(QUANTITIES)
    columns = [
        (row.file, column)
        for row in QUANTITIES
        for column in {row.column.format(label) for label in row.labels}
    ]
    assert len(columns) == len(set(columns))
    for row in QUANTITIES:
        assert (row.name in Pose.model_fields) != bool(row.meaning), row.name
        assert ("{}" in row.column) == (row.per != "frame" and row.name != "distrusted"), row.name


@pytest.mark.parametrize(
    ("name", "known", "numbers"),
    [
        ("energy_px", {"energy_px": 12.0}, [12.0]),
        ("seconds", {"seconds": {"head": 0.5, "other": 3.0}}, [np.nan, np.nan, 0.5, *[np.nan] * 5]),
        ("confidence", {"confidence": {"torso": 1.0, "head": 1.5}}, [1.0, *[np.nan] * 5]),
        ("distrusted", {"distrusted": ["head"]}, [0.0, 1.0, 0.0, 0.0, 0.0, 0.0]),
        ("prior", {"measured": {"prior": [2.5]}}, [2.5]),
        ("prior", {"measured": {"prior": [-1.0]}}, [np.nan]),
        ("prior", {}, [np.nan]),
        ("part_px", {"measured": {"part_px": list(range(6))}}, [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]),
        ("part_px", {"measured": {"part_px": [1.0, 2.0]}}, [np.nan] * 6),
    ],
)
def test_a_number_for_each_label_or_none(name: str, known: dict[str, Any], numbers: list[float]) -> None:
    frame = SimpleNamespace(**{"measured": {}, **known})
    np.testing.assert_array_equal(numbers_of(frame, ROWS[name], ROWS[name].labels), numbers)


def test_cameras_are_those_of_the_take() -> None:
    frame = SimpleNamespace(measured={"iou": [0.5, 0.75]})
    assert numbers_of(frame, ROWS["iou"], ["left", "right"]) == [0.5, 0.75]
    assert np.isnan(numbers_of(frame, ROWS["iou"], ["left"])).all()


def test_columns_that_some_frame_lacks_are_left_out() -> None:
    measured = {"prior": [1.0], "cameras_absent": [2.0], "something else": [3.0]}
    whole = SimpleNamespace(measured=measured, shot=4, latency_s=0.25)
    assert list(further_columns([whole, whole], is_live=False)) == ["prior"]
    live = further_columns([whole, whole], is_live=True)
    assert {name: values.tolist() for name, values in live.items()} == {
        "prior": [1.0, 1.0], "shot": [4.0, 4.0], "latency_s": [0.25, 0.25], "cameras_absent": [2.0, 2.0],
    }  # fmt: skip
    lacking = SimpleNamespace(measured={}, shot=4, latency_s=0.25)
    assert list(further_columns([whole, lacking], is_live=True)) == ["shot", "latency_s"]


def test_a_row_is_all_that_a_further_column_needs(monkeypatch: pytest.MonkeyPatch) -> None:
    row = Quantity("hue", "1", "poses.csv", "hue_{}", "part", ".3f", meaning="For this test.")
    monkeypatch.setattr("services.mocap.take.quantities.FURTHER", (row,))
    frame = SimpleNamespace(measured={"hue": [0.5] * 6})
    assert list(further_columns([frame], is_live=False)) == [f"hue_{part}" for part in PARTS]
