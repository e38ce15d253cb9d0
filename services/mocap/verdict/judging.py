"""Judges a result by what its folder holds."""

from collections.abc import Mapping

import numpy as np

from services.mocap.result.result import Result
from services.mocap.take.marks import PARTS
from services.mocap.types import Floats, Mask
from services.mocap.verdict.causes import causes_of
from services.mocap.verdict.verdict import LEVELS, WHOLE_BODY, Doubt, Level, Verdict, spans_of

_MOST_LOST, _MOST_DOUBTFUL = 0.2, 0.5
"""Shares of frames with a doubtful body, and with any doubtful part, above which a result is not usable."""
LEAST_IOU = 0.6
"""Typical overlap with the silhouettes below which a result is not usable."""


def verdict_of(result: Result) -> Verdict:
    """The verdict on a result, by its files alone. Raises TakeError if one cannot be read."""
    iou = {camera: values for camera, values in result.quantities.get("iou", {}).items() if len(values)}
    causes = causes_of(result, iou)
    levels = [level_of(result.distrusted, iou), *(cause.level for cause in causes)]
    whole = PARTS.index(WHOLE_BODY)
    named = result.distrusted & ~result.distrusted[:, [whole]]  # a limb is not named beside the whole body
    named[:, whole] = result.distrusted[:, whole]
    return Verdict(
        level=max(levels, key=LEVELS.index),
        frames=len(result.frames),
        doubtful_frames=int(result.distrusted.any(axis=1).sum()),
        lost_frames=int(result.distrusted[:, whole].sum()),
        doubts=tuple(
            Doubt(part=part, frames=int(chosen.sum()), spans=spans_of(chosen, int(result.frames[0])))
            for part, chosen in zip(PARTS, named.T, strict=True)
            if chosen.any()
        ),
        iou={camera: round(float(np.nanmedian(values)), 3) for camera, values in iou.items()},
        causes=causes,
    )


def level_of(distrusted: Mask, iou: Mapping[str, Floats]) -> Level:
    """The level by the doubtful parts (N, 6) and the overlaps (N,) of the cameras."""
    lost = distrusted[:, PARTS.index(WHOLE_BODY)].mean()
    doubtful = distrusted.any(axis=1).mean()
    overlap = float(np.median([np.nanmedian(values) for values in iou.values()])) if iou else 1.0
    if lost > _MOST_LOST or doubtful > _MOST_DOUBTFUL or overlap < LEAST_IOU:
        return "not usable"
    return "usable with gaps" if doubtful > 0 else "good"
