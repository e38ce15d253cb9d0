"""Errors that a user can correct: each is one sentence with the file, the field and what was expected.

Also reads and checks all TOML files, so that every error of the TOML parser and of pydantic becomes such a
sentence.
"""

import tomllib
from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

Model = TypeVar("Model", bound=BaseModel)
_LONGEST_VALUE = 60
_TOO_LARGE = ("less_than", "less_than_equal")
"""Pydantic's types of errors."""


class FrozenModel(BaseModel):
    """Data that cannot be changed; unknown fields and infinite numbers are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class StrictModel(FrozenModel):
    """The same; values of another type are refused too, such as a number in quotes."""

    model_config = ConfigDict(strict=True)


class UserError(Exception):
    """One clear sentence for the user; the command line prints it and exits with 2."""


class TakeError(UserError):
    """A take folder, or a file in it, cannot be used."""


class NotInViewError(TakeError):
    """Nobody is in view in a frame, or nobody as a whole."""


class CertainError(TakeError):
    """A take cannot be used for a reason that nothing else about it explains."""


class CalibrationError(TakeError):
    """A calibration file cannot be used."""


def nearest(name: str, known: Iterable[str]) -> str:
    """A hint for an unknown name: the nearest known one, or all of them when none is near."""
    known = list(known)
    close = get_close_matches(name, known, n=1)
    if close:
        return f"did you mean {close[0]}"
    return f"known are {', '.join(known)}" if known else "none are known"


def in_short(value: object) -> str:
    """A value for an error sentence, on one line and not too long."""
    text = " ".join(repr(value).split())
    return text if len(text) <= _LONGEST_VALUE else text[: _LONGEST_VALUE - 1] + "…"


_TEXT_AND_NUMBERS = ': put text in quotes, as in up = "z"; decimals take a point, not a comma'


def load_toml(path: Path, error: type[UserError]) -> dict[str, Any]:
    """The file's tables and values; raises `error` when it is missing, unreadable or not TOML."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        raise error(f"{path}: is missing: expected a TOML file of that name") from None
    except UnicodeDecodeError:
        raise error(f"{path}: expected text in UTF-8: save it again in that encoding") from None
    except tomllib.TOMLDecodeError as problem:
        reason = str(problem).strip()
        hint = _TEXT_AND_NUMBERS if reason.startswith("Invalid value") else ""
        raise error(f"{path}: not valid TOML: {reason[:1].lower()}{reason[1:]}{hint}") from None
    except OSError as problem:
        raise error(f"{path}: cannot be read ({problem.strerror}): expected a TOML file") from None


def validated(model: type[Model], data: dict[str, Any], where: str, error: type[UserError]) -> Model:
    """The model made from data.

    where: the file and the table in it, for the start of the sentence. Raises `error` for the first invalid
    field; its description in the model states the valid values.
    """
    try:
        return model.model_validate(data)
    except ValidationError as problem:
        errors = problem.errors(include_url=False)  # a misspelt field explains a missing one
        first = next((error for error in errors if error["type"] == "extra_forbidden"), errors[0])
        raise error(f"{where}{_complaint(model, data, first)}") from None


def _complaint(model: type[BaseModel], data: dict[str, Any], first: Any) -> str:
    """`field: what is wrong`, from pydantic's first error."""
    if not first["loc"]:  # a validator of the whole model names its fields itself
        return str(first["ctx"]["error"])
    field = str(first["loc"][0])
    if first["type"] == "extra_forbidden":
        return f"{field}: unknown field: {nearest(field, model.model_fields)}"
    expected = model.model_fields[field].description
    if first["type"] == "missing" and field not in data:
        return f"{field}: is missing: expected {expected}"
    if first["type"] == "value_error":
        return f"{field}: {first['ctx']['error']}"
    readings = _in_metres(model, data, field) if first["type"] in _TOO_LARGE else []
    hint = f": {', '.join(readings)}" if readings else ""
    return f"{field}: expected {expected}, found {in_short(data[field])}{hint}"


def _in_metres(model: type[BaseModel], data: dict[str, Any], field: str) -> list[str]:
    """What a length too large in metres would be if another unit was meant, where that is valid."""
    length = data[field]
    if not isinstance(length, (int, float)) or "metres" not in (model.model_fields[field].description or ""):
        return []
    return [
        f"{length:g} {unit} is {length / per_m:g}"
        for unit, per_m in (("mm", 1000), ("cm", 100))
        if _is_accepted(model, data, field, length / per_m)
    ]


def _is_accepted(model: type[BaseModel], data: dict[str, Any], field: str, value: float) -> bool:
    try:
        model.model_validate(data | {field: value})
    except ValidationError as problem:
        return all(error["loc"][:1] != (field,) for error in problem.errors())
    return True
