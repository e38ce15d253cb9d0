"""Search settings: what travels with a task comes back the same, and nonsense is refused."""

import json
from typing import Any

import pytest

from services.mocap.search.settings import SearchSettings


@pytest.mark.parametrize(
    "settings",
    [
        SearchSettings(),
        SearchSettings().widened(),
        SearchSettings(detail_px=0, camera_weights=(1, 0.5)),
    ],
)
def test_wire_round_trip(settings: SearchSettings) -> None:
    carried = json.loads(json.dumps(settings.model_dump(mode="json")))
    assert SearchSettings.model_validate(carried) == settings


def test_fields_left_out_have_their_defaults() -> None:
    assert SearchSettings.model_validate({}) == SearchSettings()


@pytest.mark.parametrize(
    "fields",
    [
        {"arm_grid": [5, 5, 3]},
        {"arm_grid": [5, 5, 3, 0]},
        {"leg_grid": [1000, 1000, 1000, 1000]},
        {"leg_grid": "wide"},
        {"grid_step_rad": 0.0},
        {"grid_step_rad": float("nan")},
        {"descent_tolerance": 1.0},
        {"descent_rounds": 10**9},
        {"max_passes": 0},
        {"max_passes": True},
        {"max_passes": "3"},
        {"detail_px": -0.5},
        {"detail_px": 100.5},
        {"detail_px": float("inf")},
        {"detail_px": "0.5"},
        {"camera_weights": [1.0, -1.0]},
        {"camera_weights": 1.0},
        {"passes": 3},
    ],
    ids=str,
)
def test_nonsense_is_refused(fields: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(fields))):
        SearchSettings.model_validate(fields)


def test_every_setting_says_what_it_has_to_be() -> None:
    assert all(field.description for field in SearchSettings.model_fields.values())


def test_cameras_that_are_left_out_weigh_nothing() -> None:
    settings = SearchSettings(camera_weights=(0.5, 1.0, 2.0))
    assert settings.without_cameras((1,), 3).camera_weights == (0.5, 0.0, 2.0)
    assert SearchSettings().without_cameras((0,), 3).camera_weights == (0.0, 1.0, 1.0)
    assert settings.without_cameras((), 3) is settings


def test_settings_for_a_rig_of_fewer_cameras() -> None:
    settings = SearchSettings(camera_weights=(0.5, 1.0, 2.0))
    assert settings.for_cameras([2, 0]).camera_weights == (2.0, 0.5)
    assert SearchSettings().for_cameras([2, 0]).camera_weights == ()
