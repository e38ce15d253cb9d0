"""The probability that a part of the body is lost: that one of its joints is more than 15 cm off.

A logistic regression on what a solved frame shows of the part. Its weights come from takes of people of known
motion, who are not the body model; `scripts/bench confidence` fits such weights and tests these.
"""

from collections.abc import Mapping

import numpy as np

from services.mocap.body.skeleton import bare
from services.mocap.search.alignment.aligner import SeenRim
from services.mocap.search.alignment.matching import KNOWN, UNSURE
from services.mocap.search.chains import LIMBS
from services.mocap.search.error_by_part import PART_SEGMENTS
from services.mocap.search.pose_prior import surprises
from services.mocap.take.marks import PARTS, Part
from services.mocap.types import Floats

LOST_M = 0.15
"""A joint farther off than this is lost, as confidences count. Reports count from 20 cm
(run_report.LOST_LIMB_MM), by a reference whose body differs."""
EVIDENCE = ("outline_matched", "place_told", "pixels_near", "unusual", "is_limb", "is_leg", "is_head")
"""What is known of a part, in the order of its evidence.

Outlines are visible ones, of the part's JUDGED_SEGMENTS. outline_matched: the share that lies on a contour; 0
without an outline. place_told: log(1 + 1000 n), where n is the least eigenvalue of these segments' normal
matrix over the trace of the whole body's: how well the matched outline tells where they are, in the direction
that it tells least. A leg inside a coat shows little outline, and cameras that face each other do not tell
how far away a hand is. pixels_near: log(1 + 10 n / visible outline of the whole body), where n pixels that
differ by more than the rim are nearer to this part than to any other. unusual: log(1 + surprise) of a limb's
pose (pose_prior); 0 of trunk and head. The last three are 1 or 0."""
WEIGHTS: Floats = np.array([4.294, -8.583, -2.308, 0.365, 1.4, 1.372, 1.619, -0.692])
"""The bias, and the weights of the evidence. Those of all but `unusual` were fitted to 24 takes with 3 to 8
cameras (seeds below 100); `unusual`, the bias, and one factor (0.943) for all others, to 36 takes of the
present search. Fitting all anew to the latter is worse on takes that are left out, because few
limbs are lost there."""
_BIAS_IN_TIME, _OWN, _NEAR, _AROUND = 0.31, 0.26, 0.38, 0.48
"""The bias, and the weights of the log odds of a frame itself, of the worst frame near by, and of the mean of
the frames around it. Two thirds of the limbs that were lost but not marked were within 0.2 s of a frame in
which they were marked. Fitted to 77 takes of people (32,600 limbs in frames, 294 of them lost); left out an
eighth at a time, these had 0.23 % lost unmarked and 2.4 % marked although right, where each frame for itself
has 0.26 and 3.4 %. The bias is 0.55 more than the fit's, so that LEAST_CONFIDENCE suits both."""
_NEAR_S, _AROUND_S = 0.1, 0.25
_LEAST_PROBABILITY = 1e-4
"""Of a frame and of its opposite, so that no frame decides for all around it."""
_RIVAL_FROM_M, _RIVAL_M = 0.12, 0.15
"""Two tracks that have a part within the first distance agree; from the second on they differ wholly."""
_RIVAL_LOST, _RIVAL_FALL_PX = 0.25, 400.0
"""Of arms and legs that two tracks had more than 15 cm apart, 21 % were lost where the other choice cost up
to 400 pixels more, and 13 % above; of those that they had 12 to 15 cm apart, 6 %: 325 such limbs in 20 takes
with 3 to 16 cameras."""
_AT_PRICE, _PRICES = (0.17, 0.60, -1.12), 20.0
"""The bias, and the weights of the log odds and of log(1 + 20 price). Fitted to 24 takes of people (10,188
limbs in frames, 205 of them lost); the bias is 0.17 less than the fit's, to suit LEAST_CONFIDENCE."""
JUDGED_SEGMENTS: dict[Part, list[int]] = {
    part: list(segments[1:] if part in LIMBS else segments) for part, segments in PART_SEGMENTS.items()
}
"""The segments whose outline tells whether a part is lost: of limbs all but the first."""


def evidence_of(rim: SeenRim, nearest_px: Mapping[Part, int], pose: Floats) -> Floats:
    """(6, len(EVIDENCE)) of the parts (PARTS) in a pose (D,); nearest_px as in Differences.

    Outline that unsure pixels hide counts like the rest of the part's.
    """
    whole_px = max(float(rim.lengths_px[:, [KNOWN, UNSURE]].sum()), 1.0)
    whole_trace = max(float(np.trace(rim.place_normals.sum(axis=0))), 1e-9)
    surprise = dict(zip(LIMBS, surprises(pose[None])[0], strict=True))
    evidence = np.zeros((len(PARTS), len(EVIDENCE)))
    for row, part in zip(evidence, PARTS, strict=True):
        segments = JUDGED_SEGMENTS[part]
        known_px, on_px, unsure_px = rim.lengths_px[segments].sum(axis=0)
        known_px = max(known_px, 1.0)
        least = max(np.linalg.eigvalsh(rim.place_normals[segments].sum(axis=0))[0], 0.0)
        row[:] = (
            on_px / known_px,
            np.log1p(1000.0 * least * (1.0 + unsure_px / known_px) / whole_trace),
            np.log1p(10.0 * nearest_px[part] / whole_px),
            np.log1p(surprise.get(part, 0.0)),
            part in LIMBS,
            bare(part) == "leg",
            part == "head",
        )
    return evidence


def lost_probabilities(evidence: Floats) -> Floats:
    """(6,) of the parts (PARTS) with some evidence (6, len(EVIDENCE))."""
    probabilities: Floats = 1.0 / (1.0 + np.exp(-(evidence @ WEIGHTS[1:] + WEIGHTS[0])))
    return probabilities


def lost_at_price(probability: float, price: float) -> float:
    """The probability that a limb is lost, in view of what it would cost elsewhere (price_elsewhere)."""
    bias, own, elsewhere = _AT_PRICE
    likely = np.clip(probability, _LEAST_PROBABILITY, 1.0 - _LEAST_PROBABILITY)
    log_price = np.log1p(_PRICES * max(price, 0.0))
    odds = bias + own * np.log(likely / (1.0 - likely)) + elsewhere * log_price
    return float(1.0 / (1.0 + np.exp(-odds)))


def rival_probabilities(apart_m: Floats, margin_px: Floats) -> Floats:
    """(6,) the probability that a part is lost because two tracks have it in different places, and the chosen
    one is wrong.

    apart_m, margin_px: (6,) as best_path.Chosen has them.
    """
    differing = np.clip((apart_m - _RIVAL_FROM_M) / (_RIVAL_M - _RIVAL_FROM_M), 0.0, 1.0)
    return np.asarray(_RIVAL_LOST * differing * np.exp(-np.maximum(margin_px, 0.0) / _RIVAL_FALL_PX))


def frames_around(fps: float) -> int:
    """How many frames before and after a frame tell whether limbs are lost in it (lost_in_time)."""
    return max(1, round(_AROUND_S * fps))


def lost_in_time(lost: Floats, at: int, fps: float) -> Floats:
    """(L,) the probabilities that limbs are lost in a frame, in view of the frames around it: what is lost
    was in most cases lost in the frame before.

    lost: (N, L) of successive frames, each by itself; nan where nothing is known of a limb, which stays so.
    at: which of them.
    """
    likely = np.clip(lost, _LEAST_PROBABILITY, 1.0 - _LEAST_PROBABILITY)
    odds = np.log(likely / (1.0 - likely))
    known = np.where(np.isnan(odds[at]), 0.0, odds)  # of nothing but nan there is no mean
    near, around = (
        known[max(at - reach, 0) : at + reach + 1]
        for reach in (max(1, round(_NEAR_S * fps)), frames_around(fps))
    )
    worst, mean = np.nanmax(near, axis=0), np.nanmean(around, axis=0)
    steadied = _BIAS_IN_TIME + _OWN * odds[at] + _NEAR * worst + _AROUND * mean
    return np.asarray(1.0 / (1.0 + np.exp(-steadied)))
