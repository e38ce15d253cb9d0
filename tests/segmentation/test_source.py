"""A camera's silhouettes, frame by frame, wherever reading starts."""

from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from services.mocap.camera.camera import Camera
from services.mocap.energy.bitplanes import pack_trimaps
from services.mocap.take.folder import Take, open_take
from services.mocap.types import ACTOR, BACKGROUND, UNSURE
from services.segmentation.cleanup import SegmentationSettings
from services.segmentation.segmenters import make_segmenters
from services.segmentation.source import Segmenter, in_common_size, packed


@pytest.mark.parametrize("n_cameras", [1, 8, 11])
def test_packing_one_by_one_is_packing(n_cameras: int) -> None:
    rng = np.random.default_rng(0)
    states = np.array([BACKGROUND, UNSURE, ACTOR], np.uint8)
    trimaps = [rng.choice(states, (48 - c, 64 - 2 * c)) for c in range(n_cameras)]
    found, whole = packed(trimaps, 64, 48), pack_trimaps([in_common_size(t, 64, 48) for t in trimaps])
    assert np.array_equal(found.silhouettes, whole.silhouettes)
    assert np.array_equal(found.unsure, whole.unsure)


def segmenter(take: Take, camera: Camera, name: str) -> Segmenter:
    (made,) = make_segmenters(take, [camera], SegmentationSettings(), name)
    return made


def test_a_frame_is_the_same_wherever_reading_starts(shared_takes: Path) -> None:
    take = open_take(shared_takes / "studio-a")
    camera = take.cameras[3]
    for name in ("clean-plate", "mog2", "bgsegm"):
        through = list(segmenter(take, camera, name).trimaps(0, 30))
        for start in (7, 29):
            late = segmenter(take, camera, name).trimaps(start, 30)
            for frame, mask in islice(enumerate(late, start), 3):
                assert np.array_equal(mask, through[frame])
