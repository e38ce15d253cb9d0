"""Learns an actor's colour classes from the pictures of a take and the poses of an earlier run."""

from collections.abc import Sequence

import numpy as np

from services.mocap.camera.camera import Camera
from services.mocap.camera.undistort import Undistorter
from services.mocap.energy.picture import Region
from services.mocap.search.error_by_part import PART_SEGMENTS
from services.mocap.search.model import Model
from services.mocap.take.marks import PARTS
from services.mocap.types import ACTOR, Floats, Mask
from services.segmentation.colour_classes import PIECES, ColourClasses, ColourLearner
from services.segmentation.silhouettes import Moment

_TORSO = PARTS.index("torso")


class ColourLesson:
    """Shows a learner what each piece of a tracked body looks like."""

    def __init__(self, model: Model, cameras: Sequence[Camera]) -> None:
        self._model, self._region = model, Region.whole(model.rig)
        self._undistorters = [Undistorter(camera) for camera in cameras]
        self._learner = ColourLearner(len(cameras))

    def add(self, moment: Moment, pose: Floats, distrusted: Mask) -> None:
        """Add a moment, undistorted, with its pose (D,); parts that are distrusted (6,) teach nothing, and
        nothing does if that is the torso."""
        if moment.images_bgr is None or distrusted[_TORSO]:
            return
        pieces = self._model.colours.painted(pose, self._region, PIECES)
        marked = [s for part in np.array(PARTS)[distrusted] for s in PART_SEGMENTS[part]]
        pieces[np.isin(pieces, PIECES[marked])] = 0
        for c, (undistorter, trimap) in enumerate(zip(self._undistorters, moment.trimaps, strict=True)):
            height, width = trimap.shape
            image = undistorter.image(moment.images_bgr[c])
            self._learner.add(c, image, pieces[c, :height, :width], trimap == ACTOR)

    def conclude(self) -> ColourClasses | None:
        """The classes; None if the actor shows one colour only, or there were no pictures."""
        return self._learner.conclude()
