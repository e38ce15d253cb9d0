"""Fitting the actor once more where furniture may hide limbs that the fitted body leaves unexplained."""

import logging
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace

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


def fit_past_furniture(fit_to: Callable[[Mapping[str, Mask], Show], TakeFit], show: Show) -> TakeFit:
    """A fit to silhouettes, or a better one in which something hides the actor from some cameras.

    fit_to takes by camera further pixels (h, w) that count for nothing: after none, those in which something
    may hide what the first fit leaves unexplained, then those in which it hides the body so found. The later
    fits count if they explain clearly more than the first, and not less than each other.
    """

    def show_again(stage: str, share: float) -> None:
        show(f"{stage}, past furniture", share)

    found = best = fit_to({}, show)
    with model_on_cpu(found.fit.actor, Rig.of(found.cameras)) as model:
        hidden = occluded_by_camera(found.cameras, hidden_space(model, found.seen, found.fit.poses))
    seconds = Counter(found.seconds)
    for _ in range(_ROUNDS):
        if not hidden:
            break
        try:
            again = fit_to(hidden, show_again)
        except TakeError as error:
            log.info("without what furniture may hide: %s", error)
            break
        seconds.update(again.seconds)
        is_comparable = again.cameras == found.cameras and _unexplained_px(again) <= _unexplained_px(best)
        if not (is_comparable and _explains_more(again, found)):
            break
        hidden = _occluded(again.fit, found)
        best = replace(again, occluded=hidden)
    return replace(best, seconds=dict(seconds))


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
