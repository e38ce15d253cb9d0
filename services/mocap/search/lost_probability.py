"""The probability that a part of the body is lost: that one of its joints is more than 15 cm off.

A logistic regression on what a solved frame shows of the part. Its weights are fitted by
`scripts/bench confidence` to takes of people of known motion, who are not the body model.
"""

from collections.abc import Mapping

import numpy as np

from services.mocap.search.alignment.matching import KNOWN, LOST, ON, UNSURE
from services.mocap.search.error_by_part import PART_SEGMENTS
from services.mocap.take.marks import PARTS, Part
from services.mocap.types import Floats

LOST_M = 0.15
"""A joint farther off than this is lost."""
EVIDENCE = (
    "outline_matched",
    "outline_visible",
    "outline_missed",
    "pixels_near",
    "pixels_share",
    "pixels_usual",
    "is_limb",
    "is_head",
)
"""What is known of a part, in the order of its evidence.

Outlines are visible ones, of forearm and hand, of shank and foot, or of all of torso or head: the share that
lies on a contour, and the share of the whole body's outline (both 0 for torso and head), and the share with
no contour in reach. Pixels are those that differ by more than the rim: n nearest to the part, and n that are
allowed in its window (0 for the torso), as log(1 + 10 n / whole outline); and their share of the input's. The
last two are 1 or 0."""
WEIGHTS: Floats = np.array([-5.596, -2.401, -34.771, 3.854, 0.929, 20.572, -0.807, 6.244, -0.268])
"""The bias, and the weights of the evidence: from 17 takes with 3 to 16 cameras, seeds below 100."""
_USUAL_SHARES = (0.8, 0.07)
"""Of limbs' outlines, on a contour and with no contour in reach, in those takes."""
_RIVAL_FROM_M, _RIVAL_M = 0.12, 0.15
"""Two tracks that have a part within the first distance agree; from the second on they differ wholly."""
_RIVAL_LOST, _RIVAL_FALL_PX = 0.25, 400.0
"""Of arms and legs that two tracks had more than 15 cm apart, 21 % were lost where the other choice cost up
to 400 pixels more, and 13 % above; of those that they had 12 to 15 cm apart, 6 %: 325 such limbs in 20 takes
with 3 to 16 cameras."""
_TRUNK: tuple[Part, ...] = ("torso", "head")


def evidence_of(
    rim_px: Floats, nearest_px: Mapping[Part, int], usual_px: Mapping[Part, float], share: float
) -> Floats:
    """(6, len(EVIDENCE)) of the parts (PARTS).

    rim_px (S, SHARES) as in Aligned; nearest_px and share as in Differences; usual_px: how many pixels may
    differ near limbs and head, as they usually do.
    """
    outlines_px = rim_px.copy()  # what unsure pixels hide counts as it usually is
    outlines_px[:, [KNOWN, ON, LOST]] += rim_px[:, UNSURE, None] * [1.0, *_USUAL_SHARES]
    whole_px = max(float(outlines_px[:, KNOWN].sum()), 1.0)
    evidence = np.zeros((len(PARTS), len(EVIDENCE)))
    for row, part in zip(evidence, PARTS, strict=True):
        is_limb = part not in _TRUNK
        outline_px = outlines_px[list(PART_SEGMENTS[part][1 if is_limb else 0 :])].sum(axis=0)
        all_px = max(float(outline_px[KNOWN]), 1.0)
        row[:] = (
            is_limb * outline_px[ON] / all_px,
            is_limb * outline_px[KNOWN] / whole_px,
            outline_px[LOST] / all_px,
            np.log1p(10.0 * nearest_px[part] / whole_px),
            share,
            np.log1p(10.0 * usual_px.get(part, 0.0) / whole_px),
            is_limb,
            part == "head",
        )
    return evidence


def lost_probabilities(evidence: Floats) -> Floats:
    """(6,) of the parts (PARTS) with some evidence (6, len(EVIDENCE))."""
    probabilities: Floats = 1.0 / (1.0 + np.exp(-(evidence @ WEIGHTS[1:] + WEIGHTS[0])))
    return probabilities


def rival_probabilities(apart_m: Floats, margin_px: Floats) -> Floats:
    """(6,) the probability that a part is lost because two tracks have it in different places, and the chosen
    one is wrong.

    apart_m, margin_px: (6,) as best_path.Chosen has them.
    """
    differing = np.clip((apart_m - _RIVAL_FROM_M) / (_RIVAL_M - _RIVAL_FROM_M), 0.0, 1.0)
    return np.asarray(_RIVAL_LOST * differing * np.exp(-np.maximum(margin_px, 0.0) / _RIVAL_FALL_PX))
