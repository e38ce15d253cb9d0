"""Fitting the actor once more where furniture may hide limbs that the fitted body leaves unexplained."""

import logging
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from services.mocap.body.actor import build_body
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import unpack
from services.mocap.errors import TakeError
from services.mocap.fit.fitting import Fit
from services.mocap.fit.quality import quality_of
from services.mocap.search.hidden_space import hidden_space
from services.mocap.search.model import model_on_cpu
from services.mocap.search.occlusion import PosedFrame, find_occluded, grown
from services.mocap.types import Mask
from services.runs.reporting import Show
from services.runs.take_fit import TakeFit, occluded_by_camera

log = logging.getLogger(__name__)

_ROUNDS = 2
"""Fits past furniture: the first one only knows where some may be."""
_CLEARLY_LESS = 0.75
"""A body that goes on behind furniture leaves at most this share of what another leaves unexplained."""
_GOOD_IOU = 0.88
"""Mean overlap from which on a fit needs no search for furniture; people in coats usually have 0.85."""


FitTo: TypeAlias = Callable[[Mapping[str, Mask], Show], TakeFit]
"""Fits without further pixels (h, w), by camera, in which something may hide the actor."""


def fit_past_furniture(fit_to: FitTo, blind: Callable[[], Mapping[str, Mask]], show: Show) -> TakeFit:
    """A fit to silhouettes, or a better one in which something hides the actor from some cameras.

    The first fit is without further pixels, the next without those in which something may hide what the
    first one leaves unexplained. If that is no better, and the first fit is poor, another body is fitted
    without the pixels of SilhouetteSource.blind. It counts for nothing itself, but tells where something
    hides it, which a further fit leaves out. Raises TakeError as fit_to does: where nobody can be fitted at
    all, a wrong calibration is likelier than furniture, and makes cameras seem blind as well.
    """
    found = fit_to({}, show)
    fits = _FitsPastFurniture(found, fit_to, show)
    with model_on_cpu(found.fit.actor, Rig.of(found.cameras)) as model:
        hidden = occluded_by_camera(found.cameras, hidden_space(model, found.seen, found.fit.poses))
    best = fits.best(hidden)
    if best is found and found.iou < _GOOD_IOU:
        rough = fits.without(blind())
        if rough is not None:
            best = fits.best(_occluded(rough.fit, found))
    return replace(best, seconds=dict(fits.seconds))


class _FitsPastFurniture:
    """Fits that are compared with a first one, to which nothing was hidden."""

    def __init__(self, found: TakeFit, fit_to: FitTo, show: Show) -> None:
        self._found, self._fit_to, self._show = found, fit_to, show
        self.seconds = Counter(found.seconds)
        """Wall time of each stage of all fits together."""

    def without(self, hidden: Mapping[str, Mask]) -> TakeFit | None:
        """A fit of the same cameras without hidden pixels; None if there is none."""
        if not hidden:
            return None
        try:
            again = self._fit_to(hidden, lambda stage, share: self._show(f"{stage}, past furniture", share))
        except TakeError as error:
            log.info("without what furniture may hide: %s", error)
            return None
        self.seconds.update(again.seconds)
        return again if again.cameras == self._found.cameras else None

    def best(self, hidden: Mapping[str, Mask]) -> TakeFit:
        """The first fit, or one without hidden pixels, and then without those that hide its body.

        These count if they explain clearly more than the first, and not less than each other.
        """
        best = self._found
        for _ in range(_ROUNDS):
            again = self.without(hidden)
            if again is None or _unexplained_px(again) > _unexplained_px(best):
                break
            if not _explains_more(again, self._found):
                break
            hidden = _occluded(again.fit, self._found)
            best = replace(again, occluded=hidden)
        return best


def _occluded(fit: Fit, found: TakeFit) -> dict[str, Mask]:
    """By camera the pixels (h, w) in which something hides the body of a fit from what another one saw."""
    rig, ever_seen = Rig.of(found.cameras), np.bitwise_or.reduce(found.seen.possible, axis=0)
    posed = (PosedFrame(found.seen[f], pose, is_lost=False) for f, pose in enumerate(fit.poses))
    with model_on_cpu(fit.actor, rig) as model:
        masks = grown(find_occluded(model, posed), rig)
    return occluded_by_camera(found.cameras, masks & ~unpack(ever_seen, rig.n_cameras))


def _explains_more(again: TakeFit, found: TakeFit) -> bool:
    """Whether a fit without the pixels in which furniture may hide the actor is clearly better."""
    body, rig = build_body(found.fit.actor), Rig.of(found.cameras)
    there = quality_of(body, found.fit.poses, rig, again.seen)
    is_better = bool(again.fit.after.energy_px.sum() < there.energy_px.sum())
    return is_better and _unexplained_px(again) < _CLEARLY_LESS * _unexplained_px(found)


def _unexplained_px(found: TakeFit) -> float:
    return float(found.fit.after.unexplained_px.sum())
