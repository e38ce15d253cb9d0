"""Where edges cross pixel rows, and what that covers, against exact whole-number arithmetic."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from services.mocap.energy.cpu.collecting import collect_bits, collect_gain, empty_canvas, summed_gain
from services.mocap.energy.cpu.crossing import wind
from services.mocap.energy.snapping import LIMIT_STEPS, SUBPIXEL
from services.mocap.types import Ints, Mask

HEIGHT_PX = 9
STEPS = st.one_of(
    st.integers(-int(LIMIT_STEPS), int(LIMIT_STEPS)), st.integers(-20 * SUBPIXEL, 20 * SUBPIXEL)
)
WIDTHS = st.sampled_from([1, 3, 4, 64, 319, 4096, 30000])


def _rows(top: int, bottom: int) -> tuple[int, int]:
    """The pixel rows whose centres lie from top up to but not including bottom, in steps."""
    return max(-(-top // SUBPIXEL), 0), min(-(-bottom // SUBPIXEL), HEIGHT_PX)


@given(STEPS, STEPS, STEPS, STEPS, WIDTHS, st.sampled_from([-1, 1]))
def test_a_crossing_counts_from_the_first_centre_that_is_not_left_of_it(
    x0: int, y0: int, x1: int, y1: int, width_px: int, sign: int
) -> None:
    (y0, x0), (y1, x1) = sorted([(y0, x0), (y1, x1)])
    first, last = _rows(y0, y1)
    crossings: Ints = np.array([[x0, y0, x1 - x0, y1 - y0, first, last, sign]], np.int32)
    canvas = empty_canvas(HEIGHT_PX, width_px)
    wind(crossings, int(first < last), canvas)
    expected = np.zeros_like(canvas[0])
    for row in range(first, last):
        exact = -(-(x0 * (y1 - y0) + (row * SUBPIXEL - y0) * (x1 - x0)) // ((y1 - y0) * SUBPIXEL))
        if exact < width_px:
            expected[row, max(exact, 0)] = sign
    np.testing.assert_array_equal(canvas[0], expected)
    crossed = np.unpackbits(canvas[1].view(np.uint8), axis=1, bitorder="little")[:, :width_px]
    np.testing.assert_array_equal(crossed, expected != 0)
    assert list(canvas[2]) == ([first, last] if first < last else [HEIGHT_PX, 0])


@given(st.integers(0, 10**6), st.integers(0, 12), st.sampled_from([1, 5, 64, 100]))
def test_what_is_covered_is_collected_and_the_canvas_left_empty(
    seed: int, n_outlines: int, width_px: int
) -> None:
    """Vertical edges in pairs, as of so many rectangles, that may overlap and reach over the picture."""
    rng = np.random.default_rng(seed)
    gain = rng.integers(-1000, 1000, (1, HEIGHT_PX, width_px)).astype(np.int32)
    covered: Mask = np.zeros((HEIGHT_PX, width_px), bool)
    edges = []
    for _ in range(n_outlines):
        left, right = np.sort(rng.integers(-3, width_px + 4, 2))
        first, last = np.sort(rng.integers(0, HEIGHT_PX + 1, 2))
        covered[first:last, max(left, 0) : max(right, 0)] = True
        for column, sign in ((left, 1), (right, -1)):
            top = first * SUBPIXEL
            edges.append([column * SUBPIXEL, top, 0, last * SUBPIXEL - top, first, last, sign])
    crossings: Ints = np.array(edges, np.int32).reshape(-1, 7)
    crossings = crossings[crossings[:, 4] < crossings[:, 5]]
    canvas = empty_canvas(HEIGHT_PX, width_px)
    for collect_twice in range(2):  # the second time on the canvas that the first one left
        wind(crossings, len(crossings), canvas)
        if collect_twice:
            plane = np.zeros((HEIGHT_PX, width_px), np.uint8)
            collect_bits(canvas, plane, np.uint8(4))
            np.testing.assert_array_equal(plane, 4 * covered)
        else:
            total = collect_gain(canvas, summed_gain(gain)[0])
            assert total == gain[0][covered].sum()
        everything_but_room = slice(3)
        emptied = empty_canvas(HEIGHT_PX, width_px)[everything_but_room]
        for left_behind, empty in zip(canvas[everything_but_room], emptied, strict=True):
            np.testing.assert_array_equal(left_behind, empty)
