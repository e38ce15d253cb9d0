"""Whether one body explains what the cameras see: two people close together look like one in space."""

import logging
from collections.abc import Sequence

import numpy as np

from services.mocap.energy.bitplanes import unpack
from services.mocap.energy.picture import Picture
from services.mocap.errors import TakeError
from services.mocap.search.chains import ALL_SURFACES
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.search.unsure_shares import UnsureShares
from services.mocap.types import Floats

log = logging.getLogger(__name__)

_MOST_UNCOVERED = 0.25
"""Share of the silhouettes. The generic body of the right height leaves up to 0.15 of a stout person
uncovered, and 0.27 and more of two people 0.4 m apart."""
_NOT_ALONE = (
    "silhouettes: one body covers only {covered:.0%} of them in the first frame: two people close together, "
    "or the actor and something large, are visible, or the pose was not found: choose a first frame "
    "without the other one or mask it out, or give initial_pose in take.toml"
)
"""The message; covered: a share."""


def check_alone(
    model: Model,
    picture: Picture,
    pose: Floats,
    settings: SearchSettings,
    names: Sequence[str],
    *,
    is_told: bool,
) -> None:
    """Raise TakeError if a body in a pose (D,) covers too little of a whole frame; warn if the actor is told,
    as that may be wrong as well.

    names: of the cameras.
    """
    uncovered = uncovered_share(model, picture, pose, settings)
    if uncovered > _MOST_UNCOVERED:
        unsure = UnsureShares.of_picture(picture, model.rig, names)
        sentence = unsure.before(_NOT_ALONE.format(covered=1.0 - uncovered))
        if not is_told:
            raise TakeError(sentence)
        log.warning("%s", sentence)


def uncovered_share(model: Model, picture: Picture, pose: Floats, settings: SearchSettings) -> float:
    """How much of the silhouettes of a whole frame a body in a pose (D,) leaves uncovered.

    It is averaged over the cameras that show a person and have a weight. Unsure pixels that the body covers
    count as silhouette; otherwise a few certain pixels elsewhere would seem to be a large share.
    """
    covered = model.backend.coverage(pose[None], ALL_SURFACES, picture.region)[0]
    seen = picture.likely(covered)
    all_px, left_px = (
        unpack(planes, model.rig.n_cameras).sum(axis=(1, 2)) for planes in (seen, seen & ~covered)
    )
    counts = (all_px > 0) & (settings.cost.weights(model.rig.n_cameras) > 0)
    return float(np.mean(left_px[counts] / all_px[counts])) if counts.any() else 0.0
