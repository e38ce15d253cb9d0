"""Where silhouettes of whole takes leave the actor open: in the upper, middle or lower third, by camera."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from services.mocap.search.unsure_shares import REMEDY, UNTOLD, may_be_actor, without_rims
from services.mocap.types import ACTOR, BACKGROUND, UNSURE, Floats, Ints, Trimap

_THIRDS = ("upper", "middle", "lower")
_UNTOLD_SHARE = 0.4
"""Of what may be the actor in a third: as much as both shanks and feet are of the lower one."""
_MANY_FRAMES = 0.25
"""Of those that show somebody; for less than that somebody may walk by a dark door."""


@dataclass(eq=False)
class UnsureThirds:
    """What one camera's silhouettes leave open, frame by frame."""

    frames: int = 0
    """That show somebody."""
    untold: Ints = field(default_factory=lambda: np.zeros(3, np.int32))
    """(3,) in how many of them most of the upper, middle and lower third is unsure."""
    worst_frame: int = 0
    worst_trimap: Trimap | None = None
    """(H, W) of that frame; None where there is none."""
    _worst_px: int = 0

    def add(self, frame: int, trimap: Trimap) -> None:
        """Take in the trimap (H, W) of a frame."""
        counts_px = _thirds_of(trimap)
        if counts_px is None:
            return
        self.frames += 1
        unsure_px, all_px = counts_px
        is_untold = unsure_px > _UNTOLD_SHARE * all_px
        self.untold += is_untold
        untold_px = int(unsure_px[is_untold].sum())
        if untold_px > self._worst_px:
            self._worst_px, self.worst_frame, self.worst_trimap = untold_px, frame, trimap.copy()

    @property
    def named(self) -> list[str]:
        """The thirds that are so in many frames."""
        many = max(_MANY_FRAMES * self.frames, 0.5)
        return [third for third, untold in zip(_THIRDS, self.untold, strict=True) if untold > many]


def _thirds_of(trimap: Trimap) -> tuple[Floats, Floats] | None:
    """Unsure pixels (3,), and all, of what may be the actor, by third of its height; None for nobody."""
    actor = may_be_actor(trimap == ACTOR, trimap != BACKGROUND)
    if not actor.any():
        return None
    blobs = actor & without_rims(trimap == UNSURE)
    rows = np.flatnonzero(actor.any(axis=1))
    edges = np.linspace(rows[0], rows[-1] + 1, 4).round().astype(np.int64)
    unsure_px, all_px = (np.add.reduceat(mask.sum(axis=1), edges[:3]) for mask in (blobs, actor))
    return unsure_px.astype(np.float64), all_px.astype(np.float64)


def thirds_in_words(names: Sequence[str], thirds: Sequence[UnsureThirds]) -> str:
    """The sentence for the user, by the cameras' names; "" where all can be told."""
    found = {
        third: [name for name, of_camera in zip(names, thirds, strict=True) if third in of_camera.named]
        for third in _THIRDS
    }
    parts = [
        f"the {third} third of the actor in {', '.join(where)}" for third, where in found.items() if where
    ]
    return f"silhouettes: {'; '.join(parts)} {UNTOLD}: {REMEDY}" if parts else ""
