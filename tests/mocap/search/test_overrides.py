"""Search settings as users write them: what is read, what wins, and every refusal in one sentence."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.mocap.errors import UserError
from services.mocap.search.overrides import as_assignments, search_settings
from services.mocap.search.settings import SearchSettings

_STEP = st.floats(0, 1, exclude_min=True)
_SHARE = st.floats(0, 1, exclude_max=True)
_GRID = st.tuples(*[st.integers(1, 15)] * 4)
ANY_SETTINGS = st.builds(
    SearchSettings,
    max_passes=st.integers(1, 20),
    pass_tolerance=_SHARE,
    arm_grid=_GRID,
    leg_grid=_GRID,
    grid_step_rad=_STEP,
    line_tolerance=st.floats(0, 1, exclude_min=True, exclude_max=True),
    angle_step_rad=_STEP,
    shift_step_m=_STEP,
    descent_tolerance=_SHARE,
    descent_rounds=st.integers(1, 100),
    detail_px=st.floats(0, 100),
    camera_weights=st.just(()) | st.tuples(st.floats(0.1, 1000), *[st.floats(0, 1000)] * 3),
)


def refusal(*assignments: str, file: Path | None = None) -> str:
    with pytest.raises(UserError) as refused:
        search_settings(assignments, file, 4)
    sentence = str(refused.value)
    assert "\n" not in sentence
    return sentence


@given(ANY_SETTINGS)
def test_what_is_written_is_read_back(settings: SearchSettings) -> None:
    assert search_settings(as_assignments(settings), None, 4) == settings


def test_only_what_differs_is_written() -> None:
    assert as_assignments(SearchSettings()) == []
    changed = SearchSettings(detail_px=0, arm_grid=(3, 3, 1, 3), camera_weights=(1, 0.5))
    assert as_assignments(changed) == ["arm_grid=[3, 3, 1, 3]", "detail_px=0.0", "camera_weights=[1.0, 0.5]"]


def test_nothing_said_is_the_default() -> None:
    assert search_settings([], None, 4) == SearchSettings()


def test_later_words_win_and_words_outweigh_the_file(tmp_path: Path) -> None:
    file = tmp_path / "search.toml"
    file.write_text("max_passes = 7  # many\ndetail_px = 3\narm_grid = [3, 3, 1, 3]\n")
    settings = search_settings(["detail_px=1", " detail_px = 2 "], file, 4)
    assert settings == SearchSettings(max_passes=7, detail_px=2, arm_grid=(3, 3, 1, 3))


@pytest.mark.parametrize(
    ("assignment", "sentence"),
    [
        ("detail=0", "--set detail: unknown field: did you mean detail_px"),
        ("max_passes", "--set max_passes: expected NAME=VALUE, such as detail_px=0"),
        ("=3", "--set =3: expected NAME=VALUE, such as detail_px=0"),
        ("max_passes=0", "--set max_passes: expected an integer from 1 to 20, found 0"),
        ("max_passes=2.5", "--set max_passes: expected an integer from 1 to 20, found 2.5"),
        ("max_passes=true", "--set max_passes: expected an integer from 1 to 20, found True"),
        ("detail_px='fine'", "--set detail_px: expected a number from 0 to 100, found 'fine'"),
        ("detail_px=nan", "--set detail_px: expected a number from 0 to 100, found nan"),
        (
            "arm_grid=[5, 5]",
            "--set arm_grid: expected four integers from 1 to 15, such as [5, 5, 3, 5], found [5, 5]",
        ),
        (
            "camera_weights=1",
            "--set camera_weights: expected a list of numbers from 0 to 1000, such as [1.0, 0.5, 1.0], "
            "found 1",
        ),
    ],
)
def test_what_cannot_be_is_said(assignment: str, sentence: str) -> None:
    assert refusal(assignment) == sentence


@pytest.mark.parametrize("value", ["", "fine", "[1, 2", "1 2", "1\ndetail_px = 2", "[" * 5000 + "]" * 5000])
def test_values_that_are_no_toml_are_said(value: str) -> None:
    expected = "--set detail_px: expected a value as in TOML, such as 0.5 or [5, 5, 3, 5], found '"
    assert refusal(f"detail_px={value}").startswith(expected)


@pytest.mark.parametrize("weights", ["[1]", "[1, 1, 1]", "[1, 1, 1, 1, 1]"])
def test_weights_of_another_number_of_cameras_are_said(weights: str, tmp_path: Path) -> None:
    file = tmp_path / "search.toml"
    file.write_text(f"camera_weights = {weights}\n")
    said = refusal(f"camera_weights={weights}")
    assert said.startswith("camera_weights: expected 4 numbers, one for each camera of the take")
    assert refusal(file=file) == said


def test_a_bad_file_is_named(tmp_path: Path) -> None:
    file = tmp_path / "search.toml"
    assert refusal(file=file).startswith(f"{file}: is missing")
    file.write_text("max_passes = 0\n")
    said = refusal("max_passes=1", file=file)
    assert said == f"{file}: max_passes: expected an integer from 1 to 20, found 0"
    file.write_text("[search]\nmax_passes = 1\n")
    assert refusal(file=file).startswith(f"{file}: search: unknown field: ")
