"""Is the actor alone? Two people who stand close look like one in space, but one body does not cover both."""

import numpy as np

from services.mocap.energy.bitplanes import unpack
from services.mocap.energy.picture import Picture
from services.mocap.search.chains import ALL_SEGMENTS
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.types import Floats

MOST_UNCOVERED = 0.25
"""Of the silhouettes. Stout people in the pose that was found leave up to 0.15 to the generic body of their
height, two people 0.4 m apart 0.27 and more."""
NOT_ALONE = (
    "silhouettes: one body covers only {covered:.0%} of them in the first frame: two people close together, "
    "or the actor and something large, are to be seen, or the pose was not found: choose a first frame "
    "without the other one or mask it out, or give initial_pose in take.toml"
)
"""What to tell then; covered: a share."""


def uncovered_share(model: Model, picture: Picture, pose: Floats, settings: SearchSettings) -> float:
    """How much of the silhouettes of a whole frame a body in a pose (D,) leaves uncovered.

    On average over the cameras that show anybody and have a weight. Unsure pixels that the body covers belong
    to the silhouettes, so that little of it that is surely seen elsewhere does not seem to be much.
    """
    covered = model.backend.coverage(pose[None], ALL_SEGMENTS, picture.region)[0]
    seen = picture.likely(covered)
    all_px, left_px = (
        unpack(planes, model.rig.n_cameras).sum(axis=(1, 2)) for planes in (seen, seen & ~covered)
    )
    counts = (all_px > 0) & (settings.weights(model.rig.n_cameras) > 0)
    return float(np.mean(left_px[counts] / all_px[counts])) if counts.any() else 0.0
