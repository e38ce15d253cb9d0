"""The pixels by which model and input differ near each part of the body, and how many of them are usual.

A model that fits differs from the input only along the rim, by about a pixel. A larger difference means that
a limb is elsewhere, or that something that is not part of the body is in the picture.
"""

from collections import Counter, deque
from collections.abc import Iterable, Mapping

import numba
import numpy as np

from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import CAMERAS_PER_PLANE, count_bits
from services.mocap.energy.picture import Picture
from services.mocap.search.chains import pixel_scale, window_origins_px, window_size_px
from services.mocap.search.error_by_part import PART_STAGES, pixels_by_part
from services.mocap.search.found import Differences, FrameSolution
from services.mocap.search.model import Model
from services.mocap.search.part_confidence import doubtful
from services.mocap.take.marks import PARTS, Part
from services.mocap.types import Bytes, Floats, Ints

_REMEMBERED = 15
"""Frames from which the usual difference is estimated."""
_OVER_USUAL = 1.5
_LEARNT = 3.0
"""Differences above this multiple of the allowed one do not enter the usual difference."""
_LONGEST_REST = 8
"""Frames between two searches of a part at most."""
_LOST_SHARE, _LOST_OVER_USUAL, _MOST_LOST_SHARE = 0.1, 0.06, 0.25
"""The torso is in doubt when more pixels differ than the first share of the input's, and more than usual by
the second; more than the third always. What the body lacks, a coat's tails say, differs in every frame."""


def differences(model: Model, whole: Picture, pose: Floats, covered: Bytes) -> Differences:
    """Compare whole pictures with what the model covers there (P, H, W) in a pose (D,)."""
    counted = ~whole.ignored
    missing, surplus = whole.silhouettes & ~covered & counted, covered & ~whole.silhouettes & counted
    thick = inner(missing) | inner(surplus)
    px: dict[Part, int] = dict.fromkeys(PARTS, 0)
    px["torso"] = count_bits(thick)
    share = px["torso"] / max(count_bits(whole.likely(covered)), 1)
    if not ((covered | whole.silhouettes) & counted).any():  # nothing tells where the body is
        share = 1.0
    if not px["torso"]:
        return Differences(px, px.copy(), share)
    px |= within_windows(thick, model, pose)
    return Differences(px, pixels_by_part(thick, model, pose), share)


def inner(planes: Bytes) -> Bytes:
    """The pixels of planes (P, H, W) all of whose eight neighbours are set too."""
    inner = np.zeros_like(planes)
    rows = planes[:, :-2] & planes[:, 1:-1] & planes[:, 2:]
    inner[:, 1:-1, 1:-1] = rows[:, :, :-2] & rows[:, :, 1:-1] & rows[:, :, 2:]
    return inner


def within_windows(planes: Bytes, model: Model, pose: Floats) -> dict[Part, int]:
    """Set bits of planes (P, H, W) in the windows of each limb and the head, about a pose (D,)."""
    stages, rig = tuple(PART_STAGES.values()), model.rig
    sizes_px = np.array([window_size_px(stage, rig) for stage in stages], np.int32)
    counts: Ints = np.zeros(len(stages), np.int32)
    _count_within(planes, window_origins_px(stages, pose, model.body, rig), sizes_px, counts)
    return dict(zip(PART_STAGES, counts.tolist(), strict=True))


@numba.njit(cache=True, nogil=True)
def _count_within(planes: Bytes, origins_px: Ints, sizes_px: Ints, counts: Ints) -> None:
    """Add to counts (N,) the set bits of planes (P, H, W) in squares of N sizes at origins (N, C, 2)."""
    for n in range(len(sizes_px)):
        total = 0
        for c in range(origins_px.shape[1]):
            left, top = origins_px[n, c]
            square = planes[c // CAMERAS_PER_PLANE, top : top + sizes_px[n], left : left + sizes_px[n]]
            for row in square:
                for bits in row:
                    total += bits >> c % CAMERAS_PER_PLANE & 1
        counts[n] += total


class UsualDifferences:
    """Estimates the usual differences, and tells which parts to search, and which to mark as doubtful.

    Clothes and hair that the model lacks differ in every frame; a lost limb differs suddenly.
    """

    def __init__(self, rig: Rig, doubt_px: float) -> None:
        """doubt_px: allowed pixels beyond the usual difference, in pictures 320 wide in eight cameras."""
        self._doubt_px = doubt_px * pixel_scale(rig)
        self._usual: dict[Part, deque[int]] = {}
        """Of limbs and head, pixels; of the torso, thousandths of the input's pixels."""
        self._fruitless: Counter[Part] = Counter()
        self._rest: Counter[Part] = Counter()

    def as_lists(self) -> dict[str, list[int]]:
        """Its state, for `recall`."""
        return {f"usual.{part}": list(seen) for part, seen in self._usual.items()} | {
            "fruitless": [self._fruitless[part] for part in PART_STAGES],
            "rest": [self._rest[part] for part in PART_STAGES],
        }

    def recall(self, lists: Mapping[str, list[int]]) -> None:
        """Continue from another one's state (as_lists); unknown names are ignored."""
        self._usual = {
            part: deque(lists[f"usual.{part}"], maxlen=_REMEMBERED)
            for part in PARTS
            if f"usual.{part}" in lists
        }
        self._fruitless = Counter(dict(zip(PART_STAGES, lists.get("fruitless", []), strict=False)))
        self._rest = Counter(dict(zip(PART_STAGES, lists.get("rest", []), strict=False)))

    def _allowed_share(self) -> float:
        usual = self._usual.get("torso")
        if not usual:
            return _LOST_SHARE
        return min(max(_LOST_SHARE, float(np.median(usual)) / 1000 + _LOST_OVER_USUAL), _MOST_LOST_SHARE)

    def distrusted(self, found: Differences, confidence: Mapping[Part, float]) -> list[Part]:
        """Limbs and head whose confidence is too low, and the torso if the whole body is doubtful."""
        low = doubtful(PART_STAGES, confidence)
        return ["torso", *low] if found.share > self._allowed_share() else low

    def _allowed_px(self, part: Part) -> float:
        usual = self._usual.get(part)
        return self._doubt_px + (_OVER_USUAL * float(np.median(usual)) if usual else 0.0)

    def to_search(self, found: Differences) -> list[Part]:
        """Limbs and head that differ by more than usual, except those that were just searched in vain."""
        return [p for p in PART_STAGES if self._rest[p] == 0 and found.px[p] > self._allowed_px(p)]

    def note_search(self, parts: Iterable[Part], *, gained: bool) -> None:
        """Note a search of parts; after a search in vain they pause for some frames, and longer each time."""
        for part in parts:
            self._fruitless[part] = 0 if gained else self._fruitless[part] + 1
            self._rest[part] = min(2 ** self._fruitless[part], _LONGEST_REST) if self._fruitless[part] else 0

    def judge(self, solution: FrameSolution) -> None:
        """Mark the doubtful parts of a solution that contours gave, and add the frame to the estimate."""
        if solution.differences is not None:
            solution.distrusted = self.distrusted(solution.differences, solution.confidence)
            self.remember(solution.differences)

    def remember(self, found: Differences) -> None:
        """Add a solved frame to the estimate; parts that differ by far more than usual are left out, except
        in the first frame.

        So the estimate can follow the folds of clothes, but a lost limb does not become usual.
        """
        if "torso" not in self._usual or found.share <= self._allowed_share():
            self._usual.setdefault("torso", deque(maxlen=_REMEMBERED)).append(round(1000 * found.share))
        for part in PART_STAGES:
            self._rest[part] = max(self._rest[part] - 1, 0)
            if part not in self._usual or found.px[part] <= _LEARNT * self._allowed_px(part):
                self._usual.setdefault(part, deque(maxlen=_REMEMBERED)).append(found.px[part])
