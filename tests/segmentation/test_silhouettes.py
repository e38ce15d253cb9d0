"""Silhouettes of cameras, packed, and frame by frame wherever reading starts."""

from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from services.mocap.energy.bitplanes import in_common_size, pack_trimaps
from services.mocap.take.folder import open_take
from services.mocap.types import ACTOR, BACKGROUND, UNSURE
from services.segmentation.cleanup import SegmentationSettings
from services.segmentation.segmenters import make_segmenter
from services.segmentation.silhouettes import packed


@pytest.mark.parametrize("n_cameras", [1, 8, 11])
def test_packing_one_by_one_is_packing(n_cameras: int) -> None:
    rng = np.random.default_rng(0)
    states = np.array([BACKGROUND, UNSURE, ACTOR], np.uint8)
    trimaps = [rng.choice(states, (48 - c, 64 - 2 * c)) for c in range(n_cameras)]
    found, whole = packed(trimaps, 64, 48), pack_trimaps([in_common_size(t, 64, 48) for t in trimaps])
    assert np.array_equal(found.silhouettes, whole.silhouettes)
    assert np.array_equal(found.unsure, whole.unsure)


@pytest.mark.parametrize("name", ["clean-plate", "paper", "mog2", "bgsegm"])
def test_a_frame_is_the_same_wherever_reading_starts(shared_takes: Path, name: str) -> None:
    take = open_take(shared_takes / "studio-a")
    cameras = take.cameras[2:5]
    through = list(make_segmenter(take, cameras, SegmentationSettings(), name).trimaps(0, 30))
    assert all((trimap == ACTOR).any() for trimaps in through for trimap in trimaps)
    for start in (7, 29):
        late = make_segmenter(take, cameras, SegmentationSettings(), name).trimaps(start, 30)
        for frame, trimaps in islice(enumerate(late, start), 3):
            for trimap, expected in zip(trimaps, through[frame], strict=True):
                np.testing.assert_array_equal(trimap, expected)
