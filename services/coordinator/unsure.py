"""Warnings about parts of the actor that cannot be told from the background."""

import logging

import numpy as np

from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.search.model import Model
from services.mocap.search.unsure_parts import part_pixels, untold_parts
from services.mocap.search.unsure_shares import REMEDY, UNTOLD
from services.mocap.take.marks import PARTS
from services.mocap.types import Floats, Ints

log = logging.getLogger(__name__)

_EVERY_FRAMES = 20
"""A check takes eight milliseconds, a frame about twenty."""
_WHERE = "check the poses there in overlay.mp4"
_WORTH_SAYING = 0.05
"""Of the frames that were looked at."""


class UnsureParts:
    """Checks the first frame and every twentieth frame of a take."""

    def __init__(self, model: Model, names: list[str]) -> None:
        """names: of the cameras."""
        self._model, self._names = model, names
        self._looks = self._frames = 0
        self._untold: Ints = np.zeros(len(PARTS), np.int32)

    def tell_first(self, seen: TriPlanes, pose: Floats) -> None:
        """Warn of what is unsure in the first frame (P, H, W) with its pose (D,)."""
        frames, when = TriPlanes.of_frames([seen]), "the first frame"
        sentence = untold_parts(self._model, frames, pose[None], self._names, when, _WHERE)
        if sentence:
            log.warning("%s", sentence)

    def note(self, seen: TriPlanes, pose: Floats) -> None:
        """Count the parts that are unsure in a frame (P, H, W) with its pose (D,), if it is its turn."""
        self._frames += 1
        if (self._frames - 1) % _EVERY_FRAMES:
            return
        self._looks += 1
        if seen.unsure.any():
            self._untold += part_pixels(self._model, TriPlanes.of_frames([seen]), pose[None]).mostly_untold

    def conclude(self) -> None:
        """Warn of the parts that were unsure in more than half of the cameras in many frames, at the end."""
        least = max(1.0, _WORTH_SAYING * self._looks)
        counts = zip(PARTS, self._untold, strict=True)
        found = [f"{part.replace('_', ' ')} in {n}" for part, n in counts if n >= least]
        if found:
            log.warning(
                "silhouettes: of %d frames that were checked, parts of the actor %s in more than half of "
                "the cameras (%s): %s; %s",
                *(self._looks, UNTOLD, ", ".join(found), REMEDY, _WHERE),
            )
