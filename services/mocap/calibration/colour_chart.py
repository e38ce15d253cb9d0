"""Calibrates a camera's colours with a picture of a ColorChecker Classic, the chart of 24 patches."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from services.mocap.camera.colour import ColourCorrection, encoded_of, linear_of
from services.mocap.errors import CalibrationError
from services.mocap.types import Bytes, Floats

N_PATCHES = 24
_MEAN = 1
"""Which of the statistics that OpenCV gives of a patch."""
_OVEREXPOSED_LEVEL, _FEWEST_PATCHES = 250, 18
_DARKEST_WHITE_LEVEL = 40
_LARGEST_ERROR = 8.0
"""Mean colour error after correction above which it is not such a chart, or not evenly lit."""


@dataclass(frozen=True, eq=False)
class ColourFit:
    """The colour fit of a camera; colour errors are distances in CIE L*a*b* (delta E 1976)."""

    correction: ColourCorrection
    before: Floats
    """(24,) colour errors of the patches as photographed."""
    after: Floats
    """(24,) colour errors of the patches after correction."""


def reference_levels() -> Floats:
    """(24, 3) red, green, blue of the chart's patches, 0 to 255, as OpenCV has them."""
    return np.asarray(_detector().getRefColors(), np.float64).reshape(N_PATCHES, 3)[:, ::-1]


def fit_colours(picture_bgr: Bytes, path: Path) -> ColourFit:
    """The correction that brings a chart's colours nearest to what they should be.

    path: of the picture (H, W, 3), for messages. Raises CalibrationError if there is no chart in it, or the
    chart is too dark, overexposed or unevenly lit.
    """
    seen = _patches(picture_bgr, path)
    usable = seen.max(axis=1) < _OVEREXPOSED_LEVEL
    if usable.sum() < _FEWEST_PATCHES:
        raise CalibrationError(
            f"{path}: {N_PATCHES - int(usable.sum())} of the chart's {N_PATCHES} patches are overexposed: "
            "expose so that its white patch stays below 250 of 255"
        )
    if seen.max() < _DARKEST_WHITE_LEVEL:
        raise CalibrationError(
            f"{path}: the chart is too dark, its white patch has {seen.max():.0f} of 255: light it as the "
            "actor is lit"
        )
    true = reference_levels()
    matrix = _fitted(linear_of(seen[usable] / 255), linear_of(true[usable] / 255))
    corrected = linear_of(seen / 255) @ matrix[:, :3].T + matrix[:, 3]
    after = _errors(255 * encoded_of(corrected.clip(0, 1)), true)
    if after[usable].mean() > _LARGEST_ERROR:
        raise CalibrationError(
            f"{path}: the chart's colours stay {after[usable].mean():.1f} off (delta E) after correction: "
            "expected a ColorChecker Classic in even light, without glare or shadow on it"
        )
    return ColourFit(ColourCorrection(matrix), _errors(seen, true), after)


def _detector() -> cv2.mcc.CCheckerDetector:
    detector = cv2.mcc.CCheckerDetector.create()
    detector.setColorChartType(cv2.mcc.MCC24)
    return detector


def _patches(picture_bgr: Bytes, path: Path) -> Floats:
    """(24, 3) mean red, green, blue of the patches, 0 to 255."""
    detector = _detector()
    if not detector.process(picture_bgr, 1):
        raise CalibrationError(
            f"{path}: no colour chart was found in it: expected a ColorChecker Classic (24 patches), "
            "whole, facing the camera and at least a fifth of the picture wide"
        )
    statistics = np.asarray(detector.getBestColorChecker().getChartsRGB(), np.float64)
    return statistics.reshape(N_PATCHES, 3, -1)[:, :, _MEAN]


def _fitted(seen: Floats, true: Floats) -> Floats:
    """(3, 4) least squares between linear colours (n, 3), each patch weighed by how well eyes see it."""
    terms = np.column_stack([seen, np.ones(len(seen))])
    rows = []
    for channel in true.T:
        weight = (channel + 0.02) ** (1 / 2.4 - 1)  # the slope of the curve by which pictures are encoded
        rows.append(np.linalg.lstsq(terms * weight[:, None], channel * weight, rcond=None)[0])
    return np.array(rows)


def _errors(levels: Floats, true_levels: Floats) -> Floats:
    """(24,) distances in L*a*b* between red, green, blue (24, 3), 0 to 255."""
    one, other = (
        cv2.cvtColor((rgb[None] / 255).astype(np.float32), cv2.COLOR_RGB2Lab)[0]
        for rgb in (levels, true_levels)
    )
    off: Floats = np.linalg.norm(np.asarray(one, np.float64) - other, axis=1)
    return off
