"""Compiled: how much more likely a pixel is the actor's than the empty stage's, in light or in shadow."""

from math import log

import numba
import numpy as np

from services.mocap.types import Bytes
from services.segmentation.colours import BIN_SHIFT
from services.segmentation.deviation import LEAST_RATIO, MOST_RATIO
from services.segmentation.pixels import MEAN_STEPS, Levels, Steps

_IN_PLACE, _OFF_PLACE = np.float32(log(0.8)), np.float32(log(0.2))
"""How often the plate lies just where the pictures do, and how often a part of a pixel off."""
_NEVER = np.float32(-60.0)
RATIO_SPAN = float(MOST_RATIO - LEAST_RATIO)
_SQUARE_SHARE = np.float32(0.12)
"""What a square of five pixels has in common, its darkness in shadow or the colour of its cloth, costs each
of its pixels so much of what it would cost one alone."""
_CLOTH_SHARE = np.float32(0.25)
"""The same for an even cloth, whose colour was seen or not."""
_OTHER_LIGHT = np.float32(-1.0)
"""Logarithm of the odds of light that is a few per cent off to light as in the rest of the picture."""
_LIGHT_REACH = np.float32(0.05)
_CLOTH_NOISE2 = np.float32(1.3)
"""Noise of an even cloth, squared, over that of the stage: it has folds and a weave."""
_CLOTH_COST = np.float32(-1.5 * log(1.3))
_TEMPER = np.float32(0.8)
"""Of each pixel's evidence: neighbours' noise is not independent once a codec has been at it."""
_MOST = np.float32(4.0)
_HALF, _TWO, _ONE = np.float32(0.5), np.float32(2.0), np.float32(1.0)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def actor_evidence(
    channels: Bytes, even: Bytes, expected: Steps, deviation2: Levels, ratio: Levels, turn_noise: Levels,
    slack: Levels, log_slack: Levels, log_peak: Levels, log_span: Levels, colours: Levels,
    shadow_prior: Levels, corner_px: tuple[int, int], evidence: Levels,
) -> None:  # fmt: skip
    """Write the evidence (h, w) for the actor against the empty stage: a tempered log-likelihood ratio.

    The stage's likelihood is that of its best explanation: as the plate, as the plate a part of a pixel off,
    in shadow as dark as the square about it, or, at a shadow's edge, of a darkness of its own. Planes (H, W):
    see Plate and the passes of deviation. even (3, h, w): the part of the picture that evidence covers, each
    pixel as its square is on average; corner_px: its row and column. colours (B, B, B): ActorColours'
    log_density. shadow_prior (H, W): logarithm of the odds of shadow to light.
    """
    top, left = corner_px
    scale = np.float32(1 / MEAN_STEPS)
    for i in range(evidence.shape[0]):
        for k in range(evidence.shape[1]):
            y, x = top + i, left + k
            d2 = _HALF * deviation2[y, x]
            stage = _larger(_IN_PLACE - d2, _OFF_PLACE + log_slack[y, x] - slack[y, x] * d2)
            weight = _HALF / (turn_noise[y, x] * turn_noise[y, x])
            b, g, r = channels[0, y, x], channels[1, y, x], channels[2, y, x]
            actor = colours[b >> BIN_SHIFT, g >> BIN_SHIFT, r >> BIN_SHIFT] - log_peak[y, x]
            b5, g5, r5 = even[0, i, k], even[1, i, k], even[2, i, k]
            usual = colours[b5 >> BIN_SHIFT, g5 >> BIN_SHIFT, r5 >> BIN_SHIFT] - log_peak[y, x]
            blue, green, red = np.float32(b), np.float32(g), np.float32(r)
            off_b, off_g, off_r = blue - np.float32(b5), green - np.float32(g5), red - np.float32(r5)
            off2 = off_b * off_b + off_g * off_g + off_r * off_r
            actor = _larger(actor, _CLOTH_SHARE * usual + _CLOTH_COST - weight / _CLOTH_NOISE2 * off2)
            if _TEMPER * (actor - stage) <= -_MOST:
                evidence[i, k] = -_MOST  # no other explanation of the stage can make it less
                continue
            m0, m1 = scale * np.float32(expected[0, y, x]), scale * np.float32(expected[1, y, x])
            m2 = scale * np.float32(expected[2, y, x])
            seen, both = blue * blue + green * green + red * red, blue * m0 + green * m1 + red * m2
            known = m0 * m0 + m1 * m1 + m2 * m2 + _ONE
            own, square = both / known, ratio[y, x]
            at_edge = log_span[y, x] - weight * (seen - own * both)
            in_square = _SQUARE_SHARE * log_span[y, x]
            in_square -= weight * (seen - _TWO * square * both + square * square * known)
            at_edge = at_edge if (own > LEAST_RATIO) & (own < np.float32(1.02)) else _NEVER
            in_square = in_square if (square > LEAST_RATIO) & (square < _ONE + _LIGHT_REACH) else _NEVER
            in_light = in_square + _OTHER_LIGHT if square > _ONE - _LIGHT_REACH else _NEVER
            stage = _larger(_larger(stage, in_light), _larger(at_edge, in_square) + shadow_prior[y, x])
            own_evidence = _larger(_TEMPER * (actor - stage), -_MOST)
            evidence[i, k] = own_evidence if own_evidence < _MOST else _MOST


@numba.njit(cache=True, nogil=True, inline="always")
def _larger(a: np.float32, b: np.float32) -> np.float32:
    """As max, which Numba makes slower for the sake of NaN."""
    return a if a > b else b
