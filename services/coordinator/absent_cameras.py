"""Cameras without a picture of a frame, which must not count as cameras that see nobody."""

from collections.abc import Collection

import numpy as np

from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import pack
from services.mocap.energy.picture import Picture
from services.mocap.search.settings import SearchSettings


def without_cameras(picture: Picture, absent: Collection[int], rig: Rig) -> Picture:
    """A whole picture in which nothing counts of cameras that are absent, by their place in the rig."""
    if not absent:
        return picture
    ignored = np.zeros((rig.n_cameras, *rig.shape_px), bool)
    ignored[list(absent)] = True
    return picture.ignoring(pack(ignored))


def without_weight(settings: SearchSettings, absent: Collection[int], rig: Rig) -> SearchSettings:
    """The settings with a weight of 0 for cameras that are absent, for those who see windows only."""
    if not absent:
        return settings
    given = settings.camera_weights or (1.0,) * rig.n_cameras
    weights = tuple(0.0 if c in absent else weight for c, weight in enumerate(given))
    return settings.model_copy(update={"camera_weights": weights})
