"""Cheap random choices: many small ones, drawn in blocks, that repeat with their seed."""

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

T = TypeVar("T")
_BLOCK = 65_536
_RANGE = 2**32


class Dice:
    """Random choices that are the same for the same seed."""

    def __init__(self, *seed: int) -> None:
        self._rng = np.random.default_rng(seed)
        self._drawn: list[int] = []

    def below(self, end: int) -> int:
        """A whole number from 0 up to but not including end, at most 2**32; nearly even."""
        if not self._drawn:
            self._drawn = self._rng.integers(0, _RANGE, _BLOCK, np.uint64).tolist()
        return self._drawn.pop() * end // _RANGE

    def pick(self, choices: Sequence[T]) -> T:
        """One of several."""
        return choices[self.below(len(choices))]

    def bytes(self, length: int) -> bytes:
        """Random bytes."""
        return b"".join(self.below(_RANGE).to_bytes(4, "little") for _ in range((length + 3) // 4))[:length]
