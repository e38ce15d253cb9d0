"""Search settings as users write them: a TOML file, and NAME=VALUE assignments that override it."""

import json
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from services.mocap.body.skeleton import BodyName
from services.mocap.errors import UserError, in_short, load_toml, validated
from services.mocap.search.settings import PRESETS, Preset, SearchSettings


def search_settings(
    assignments: Sequence[str],
    file: Path | None,
    n_cameras: int,
    preset: Preset = "default",
    body: BodyName | None = None,
) -> SearchSettings:
    """A preset, changed by a TOML file, then by the body, if one is given, and then by assignments
    NAME=VALUE, of which the last one wins.

    VALUE is written as in TOML; n_cameras are those of the take. Raises UserError for invalid settings.
    """
    said = {} if file is None else load_toml(file, UserError)
    base = PRESETS[preset].model_dump(exclude_defaults=True)
    validated(SearchSettings, said, f"{file}: ", UserError)
    chosen = {} if body is None else {"body": body}
    asked = base | said | chosen | dict(map(_parsed, assignments))
    settings = validated(SearchSettings, asked, "--set ", UserError)
    check_weights(settings, n_cameras)
    return settings


def check_weights(settings: SearchSettings, n_cameras: int) -> None:
    """Raise UserError if the number of camera weights differs from the number of cameras."""
    n_weights = len(settings.camera_weights)
    if n_weights not in (0, n_cameras):
        raise UserError(
            f"camera_weights: expected {n_cameras} numbers, one for each camera of the take in the order of "
            f"calibration.toml, or none, found {n_weights}"
        )


def as_assignments(settings: SearchSettings) -> list[str]:
    """NAME=VALUE of all settings that are not the default: search_settings reads them back."""
    # JSON's numbers and lists of them are TOML's as well, and stand on one line.
    changed = settings.model_dump(exclude_defaults=True)
    return [f"{name}={json.dumps(value)}" for name, value in changed.items()]


def _parsed(assignment: str) -> tuple[str, Any]:
    name, equals, value = (part.strip() for part in assignment.partition("="))
    if not (name and equals):
        raise UserError(f"--set {assignment}: expected NAME=VALUE, such as detail_px=0")
    try:
        table = tomllib.loads(f"value = {value}")
    except (tomllib.TOMLDecodeError, RecursionError):  # the reader recurses into nested arrays
        table = {}
    if list(table) != ["value"]:
        raise UserError(
            f"--set {name}: expected a value as in TOML, such as 0.5 or [5, 5, 3, 5], found {in_short(value)}"
        )
    return name, table["value"]
