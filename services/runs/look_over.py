"""What the poses of a result tell of its take: where something hides the actor, and the actor's colours."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

from services.mocap.camera.camera import Camera
from services.mocap.camera.rig import Rig
from services.mocap.camera.undistort import Undistorter
from services.mocap.energy.bitplanes import TriPlanes, camera_bit
from services.mocap.energy.picture import Region
from services.mocap.result.result import Result
from services.mocap.sampling import evenly
from services.mocap.search.error_by_part import PART_SEGMENTS
from services.mocap.search.model import Model, model_on_cpu
from services.mocap.search.occlusion import PosedFrame, find_occluded
from services.mocap.search.other_people import without_others
from services.mocap.take.folder import Take
from services.mocap.take.marks import PARTS
from services.mocap.types import Bytes, Floats, Mask
from services.runs.take_fit import occluded_by_camera
from services.runs.take_silhouettes import read_moments
from services.segmentation.background import CameraBackground
from services.segmentation.colour_classes import PIECES, ColourClasses, ColourLearner
from services.segmentation.silhouettes import Moment, Segmenter, packed

_MOST_READ, _LOOKED_AT = 120, 60
"""All frames of shorter takes are looked at for what furniture hides, and so many of longer ones."""
_TAUGHT = 48
"""Of these so many at least teach what colours the actor has."""
_TORSO = PARTS.index("torso")


def look_over(
    take: Take,
    found: Result,
    segmenter: Segmenter,
    progress: Callable[[float], None],
    *,
    learns_colours: bool,
) -> tuple[dict[str, Mask], ColourClasses | None]:
    """What the poses of a result tell: by camera the pixels (h, w) in which something hides the actor, and
    the actor's colour classes, None without pictures or if there is one colour only."""
    rig, n_frames = Rig.of(take.cameras), len(found.tracked.frames)
    rows = evenly(n_frames, n_frames if n_frames <= _MOST_READ else _LOOKED_AT)
    frames: Sequence[int] = found.tracked.frames[rows].tolist()
    if len(rows) == n_frames:
        frames = range(frames[0], frames[-1] + 1)
    height_px, width_px = rig.shape_px

    def posed() -> Iterator[PosedFrame]:
        moments = read_moments(frames, segmenter, with_pictures=learns_colours)
        for k, (row, moment) in enumerate(zip(rows, moments, strict=True)):
            pose, distrusted = found.tracked.poses[row], found.distrusted[row]
            seen = without_others(model, packed(moment.trimaps, width_px, height_px), pose)
            if learns_colours and k % max(1, len(rows) // _TAUGHT) == 0:
                lesson.add(moment, seen, pose, distrusted)
            yield PosedFrame(seen, pose, bool(distrusted[_TORSO]))
            progress((k + 1) / len(rows))

    with model_on_cpu(found.actor, rig) as model:
        lesson = _ColourLesson(model, take.cameras)
        masks = find_occluded(model, posed(), partial(_empty_stage, take))
    return occluded_by_camera(take.cameras, masks), lesson.learner.conclude()


def _empty_stage(take: Take, camera: int) -> Bytes | None:
    """A camera's recorded clean plate (h, w, 3), undistorted; None without one."""
    picture = CameraBackground(take, take.cameras[camera]).mean_picture()
    return None if picture is None else Undistorter(take.cameras[camera]).image(picture)


class _ColourLesson:
    """Shows a learner what each piece of a tracked body looks like."""

    def __init__(self, model: Model, cameras: Sequence[Camera]) -> None:
        self._model, self._region = model, Region.whole(model.rig)
        self._undistorters = [Undistorter(camera) for camera in cameras]
        self.learner = ColourLearner(len(cameras))

    def add(self, moment: Moment, seen: TriPlanes, pose: Floats, distrusted: Mask) -> None:
        """Add a moment, undistorted, with its silhouettes (P, H, W) and its pose (D,); parts that are
        distrusted (6,) teach nothing, and nothing does if that is the torso."""
        if moment.images_bgr is None or distrusted[_TORSO]:
            return
        pieces = self._model.colours.painted(pose, self._region, PIECES)
        marked = [s for part in np.array(PARTS)[distrusted] for s in PART_SEGMENTS[part]]
        pieces[np.isin(pieces, PIECES[marked])] = 0
        for c, undistorter in enumerate(self._undistorters):
            image = undistorter.image(moment.images_bgr[c])
            part = np.s_[: image.shape[0], : image.shape[1]]
            self.learner.add(c, image, pieces[c][part], camera_bit(seen.silhouettes, c)[part])
