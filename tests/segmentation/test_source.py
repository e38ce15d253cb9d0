"""A camera's silhouettes, frame by frame, wherever reading starts."""

from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from services.mocap.camera.camera import Camera
from services.mocap.energy.bitplanes import pack
from services.mocap.take.folder import Take, open_take
from services.segmentation.cleanup import SegmentationSettings
from services.segmentation.segmenters import make_segmenters
from services.segmentation.source import Segmenter, in_common_size, packed


@pytest.mark.parametrize("n_cameras", [1, 8, 11])
def test_packing_one_by_one_is_packing(n_cameras: int) -> None:
    rng = np.random.default_rng(0)
    masks = [rng.random((48 - c, 64 - 2 * c)) < 0.5 for c in range(n_cameras)]
    stacked = np.array([in_common_size(mask, 64, 48) for mask in masks])
    assert np.array_equal(packed(masks, 64, 48), pack(stacked))


def segmenter(take: Take, camera: Camera, name: str) -> Segmenter:
    (made,) = make_segmenters(take, [camera], SegmentationSettings(), name)
    return made


def test_a_frame_is_the_same_wherever_reading_starts(shared_takes: Path) -> None:
    take = open_take(shared_takes / "studio-a")
    camera = take.cameras[3]
    for name in ("clean-plate", "mog2", "bgsegm"):
        through = list(segmenter(take, camera, name).silhouettes(0, 30))
        for start in (7, 29):
            late = segmenter(take, camera, name).silhouettes(start, 30)
            for frame, mask in islice(enumerate(late, start), 3):
                assert np.array_equal(mask, through[frame])
