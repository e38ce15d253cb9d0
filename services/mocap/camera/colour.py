"""Colour correction of cameras, and its file: colour.toml, one table per camera.

A table holds `matrix`, 3 rows of 4 numbers: from linear red, green, blue (0 to 1) and one to corrected ones.
Pictures are assumed to be sRGB: the curves of video cameras differ by less than the residuals of a fit.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import tomli_w
from numpy.typing import NDArray
from pydantic import Field

from services.mocap.atomic import write_file
from services.mocap.errors import CalibrationError, StrictModel, in_short, load_toml, nearest, validated
from services.mocap.types import Bytes, Floats

_MOST = 65535
"""The value of 1 in pictures of linear light."""


def linear_of(encoded: Floats) -> Floats:
    """sRGB values, 0 to 1, in linear light."""
    bright = ((np.maximum(encoded, 0.0) + 0.055) / 1.055) ** 2.4
    return np.where(encoded <= 0.04045, encoded / 12.92, bright)


def encoded_of(linear: Floats) -> Floats:
    """Linear light, 0 to 1, in sRGB values."""
    bright = 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055
    return np.where(linear <= 0.0031308, 12.92 * linear, bright)


_LINEAR: NDArray[np.uint16] = np.rint(_MOST * linear_of(np.arange(256) / 255)).astype(np.uint16)
_LEVELS: Bytes = np.rint(255 * encoded_of(np.arange(_MOST + 1) / _MOST)).astype(np.uint8)


@dataclass(frozen=True, eq=False)
class ColourCorrection:
    """The colour correction of one camera."""

    matrix: Floats
    """(3, 4) from linear red, green, blue and one to linear red, green, blue."""

    def apply(self, picture_bgr: Bytes) -> Bytes:
        """A picture (H, W, 3) with corrected colours."""
        # The same for blue, green, red from 0 to 65535.
        steps_bgr = np.column_stack([self.matrix[::-1, 2::-1], self.matrix[::-1, 3] * _MOST])
        mixed = cv2.transform(cv2.LUT(picture_bgr, _LINEAR), steps_bgr)
        corrected: Bytes = _LEVELS[mixed]
        return corrected


_Four = Annotated[list[float], Field(min_length=4, max_length=4)]


class _Table(StrictModel):
    matrix: list[_Four] = Field(
        min_length=3, max_length=3, description="3 rows of 4 finite numbers, to linear red, green and blue"
    )
    delta_e_before: float | None = Field(default=None, description="a number: the chart's mean colour error")
    delta_e: float | None = Field(default=None, description="a number: the same after correction")


def read_colours(path: Path, cameras: Iterable[str]) -> dict[str, ColourCorrection]:
    """Corrections by camera; empty if there is no file. Raises CalibrationError for an invalid file."""
    if not path.exists():
        return {}
    known, found = list(cameras), {}
    for name, fields in load_toml(path, CalibrationError).items():
        if name not in known:
            raise CalibrationError(f"{path}: {name}: is no camera of the take: {nearest(name, known)}")
        if not isinstance(fields, dict):
            raise CalibrationError(f"{path}: {name}: expected a table per camera, found {in_short(fields)}")
        table = validated(_Table, fields, f"{path}: [{name}] ", CalibrationError)
        found[name] = ColourCorrection(np.array(table.matrix))
    return found


def write_colours(path: Path, found: Mapping[str, tuple[ColourCorrection, float, float]]) -> None:
    """Write colour.toml: by camera the correction, and the chart's mean colour error before and after it."""
    tables = {
        name: _Table(
            matrix=correction.matrix.tolist(), delta_e_before=round(before, 2), delta_e=round(after, 2)
        ).model_dump()
        for name, (correction, before, after) in found.items()
    }
    write_file(path, tomli_w.dumps(tables))
