"""Compiled: whether a pixel is the actor's or the empty stage's, by its own colour and by its neighbours.

**Evidence** of a pixel of colour z: the logarithm of how much more likely it is the actor's than the stage's,
by the best explanation of each. All densities are over the plate's peak. With μ the colour that the plate
should have, d² the squared deviation (see comparison), s its slack, σ the noise across the direction of the
colour, w = 1 / 2σ², ℓ the cost of one darkness among all that shadows have (log_span), ρ the brightness of
the pixel and ρ' that of the square about it over the expected, and p the density of the actor's colours:

    actor            A = max(log p(z), β' log p(z') - 3/2 log κ - w/κ |z - z'|²)   z': the square's average
    stage, in place  L = max(log 0.8 - d²/2, log 0.2 + 3/2 log s - s d²/2)         or a part of a pixel off
    in shadow        D = max(ℓ - w |z - ρ μ|², β ℓ - w |z - ρ' μ|²) + log odds of shadow
    in other light   O = β ℓ - w |z - ρ' μ|² + log odds of other light             if ρ' is near 1
    evidence           = T (A - max(L, D, O)), within ±4

**Neighbours**: min-sum belief propagation on a grid of two labels, with a price c for neighbours of unlike
labels. With energies' differences between the labels as messages, the one from a pixel to its neighbour is

    message = clamp(evidence + all messages to the pixel but the neighbour's, -c, c)

and a pixel believes its evidence plus all messages to it (Pearl, Probabilistic Reasoning in Intelligent
Systems, 1988; Felzenszwalb, Huttenlocher, Efficient Belief Propagation for Early Vision, IJCV 70, 2006).
A sweep carries messages through a whole row, so a few rounds are enough.
"""

from math import log

import numba
import numpy as np

from services.mocap.types import Bytes
from services.segmentation.learnt import BIN_SHIFT
from services.segmentation.pixels import MEAN_STEPS, Levels, Steps
from services.segmentation.plate import LEAST_RATIO, MOST_EDGE_RATIO

_IN_PLACE, _OFF_PLACE = np.float32(log(0.8)), np.float32(log(0.2))
"""Log probability that the plate is exactly aligned with the pictures, and that it is off by a fraction of a
pixel."""
_NEVER = np.float32(-60.0)
_SQUARE_SHARE = np.float32(0.12)
"""β: what a square of five pixels has in common, its darkness in shadow or the colour of its cloth, costs
each of its pixels so much of what it would cost one alone."""
_CLOTH_SHARE = np.float32(0.25)
"""β': the same for an even cloth, whose colour was seen or not."""
_OTHER_LIGHT = np.float32(-1.0)
"""Log odds of light that differs by a few per cent against light as in the rest of the picture."""
_LIGHT_REACH = np.float32(0.05)
_CLOTH_NOISE2 = np.float32(1.3)
"""κ: noise of an even cloth, squared, over that of the stage: it has folds and a weave."""
_CLOTH_COST = np.float32(-1.5 * log(1.3))
_TEMPER = np.float32(0.8)
"""T: a codec makes neighbours' noise alike, so that each pixel's evidence counts less."""
_MOST = np.float32(4.0)
_HALF, _TWO, _ONE = np.float32(0.5), np.float32(2.0), np.float32(1.0)
_PRICE = 3.0
"""c, for two neighbours of unlike labels where the picture shows no edge."""
_LEAST_SHARE = 0.15
"""Share of that price that is left where it shows one."""
_EDGE_SIGMAS2 = 8.0


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def actor_evidence(
    channels: Bytes, even: Bytes, expected: Steps, deviation2: Levels, ratio: Levels, turn_noise: Levels,
    slack: Levels, log_slack: Levels, log_peak: Levels, log_span: Levels, colours: Levels,
    shadow_prior: Levels, corner_px: tuple[int, int], evidence: Levels,
) -> None:  # fmt: skip
    """Write the evidence (h, w) for the actor against the empty stage: a tempered log-likelihood ratio.

    Planes (H, W): see Plate and Comparison. even (3, h, w): the part of the picture that evidence covers,
    each pixel as its square is on average; corner_px: its row and column. colours (B, B, B): ActorColours'
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
            at_edge = at_edge if (own > LEAST_RATIO) & (own < MOST_EDGE_RATIO) else _NEVER
            in_square = in_square if (square > LEAST_RATIO) & (square < _ONE + _LIGHT_REACH) else _NEVER
            in_light = in_square + _OTHER_LIGHT if square > _ONE - _LIGHT_REACH else _NEVER
            stage = _larger(_larger(stage, in_light), _larger(at_edge, in_square) + shadow_prior[y, x])
            own_evidence = _larger(_TEMPER * (actor - stage), -_MOST)
            evidence[i, k] = own_evidence if own_evidence < _MOST else _MOST


@numba.njit(cache=True, nogil=True, inline="always")
def _larger(a: np.float32, b: np.float32) -> np.float32:
    """Like max, which is slower in Numba because of NaN."""
    return a if a > b else b


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def prices(
    channels: Bytes, expected: Steps, noise2: float, corner_px: tuple[int, int], across: Levels, down: Levels
) -> None:
    """Write the price (h, w) between each pixel and the next in its row, and the next in its column.

    An edge is a jump in the difference from the plate, so outlines of the stage itself do not count.
    """
    height, width = across.shape
    top, left = corner_px
    rate = np.float32(1.0 / (_EDGE_SIGMAS2 * noise2))
    scale = np.float32(1 / MEAN_STEPS)
    across[:], down[:] = 0, 0
    here, above = np.empty(width, np.float32), np.empty(width, np.float32)
    for c in range(3):
        for i in range(height):
            seen, plate = channels[c, top + i], expected[c, top + i]
            for k in range(width):
                here[k] = np.float32(seen[left + k]) - scale * np.float32(plate[left + k])
            for k in range(width - 1):
                across[i, k] += (here[k + 1] - here[k]) ** 2
            if i > 0:
                for k in range(width):
                    down[i - 1, k] += (here[k] - above[k]) ** 2
            here, above = above, here
    one = np.float32(1)
    floor, price = np.float32(_LEAST_SHARE * _PRICE), np.float32((1 - _LEAST_SHARE) * _PRICE)
    for i in range(height):
        for k in range(width):
            across[i, k] = floor + price / (one + rate * across[i, k])
            down[i, k] = floor + price / (one + rate * down[i, k])


@numba.njit(cache=True, nogil=True, error_model="numpy")
def beliefs(evidence: Levels, across: Levels, down: Levels, rounds: int) -> Levels:
    """What each pixel believes (h, w) after some rounds: positive for the actor, the surer the larger.

    evidence (h, w); prices across and down as `prices` writes them.
    """
    height, width = evidence.shape
    from_left, from_right = np.zeros_like(evidence), np.zeros_like(evidence)
    from_above, from_below = np.zeros_like(evidence), np.zeros_like(evidence)
    held = np.empty(width, np.float32)
    for _ in range(rounds):
        for y in range(height):
            for x in range(width):
                held[x] = evidence[y, x] + from_above[y, x] + from_below[y, x]
            # Both directions in one loop: each step depends on the previous one of its own direction only.
            to_right = to_left = np.float32(0)
            for x in range(width - 1):
                back = width - 1 - x
                to_right = _clamped(held[x] + to_right, across[y, x])
                to_left = _clamped(held[back] + to_left, across[y, back - 1])
                from_left[y, x + 1], from_right[y, back - 1] = to_right, to_left
        for y in range(height - 1):
            for x in range(width):
                believed = evidence[y, x] + from_left[y, x] + from_right[y, x] + from_above[y, x]
                from_above[y + 1, x] = _clamped(believed, down[y, x])
        for y in range(height - 1, 0, -1):
            for x in range(width):
                believed = evidence[y, x] + from_left[y, x] + from_right[y, x] + from_below[y, x]
                from_below[y - 1, x] = _clamped(believed, down[y - 1, x])
    return evidence + from_left + from_right + from_above + from_below


@numba.njit(cache=True, nogil=True, inline="always")
def _clamped(value: np.float32, most: np.float32) -> np.float32:
    low = value if value > -most else -most
    return low if low < most else most
