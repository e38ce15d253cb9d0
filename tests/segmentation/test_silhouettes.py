"""Silhouettes of cameras, packed, and frame by frame wherever reading starts."""

from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from services.mocap.energy.bitplanes import in_common_size, pack_trimaps, unpack_classes
from services.mocap.take.fit_record import COLOUR_BINS
from services.mocap.take.folder import open_take
from services.mocap.types import ACTOR, BACKGROUND, UNSURE
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
    through = list(make_segmenter(take, cameras, name).trimaps(0, 12))
    assert all((trimap == ACTOR).any() for trimaps in through for trimap in trimaps)
    another = make_segmenter(take, cameras, name)
    for start in (11, 5):
        for frame, trimaps in islice(enumerate(another.trimaps(start, 12), start), 3):
            for trimap, expected in zip(trimaps, through[frame], strict=True):
                np.testing.assert_array_equal(trimap, expected)


def test_actor_pixels_get_the_class_of_their_colour(shared_takes: Path) -> None:
    take = open_take(shared_takes / "studio-a")
    cameras = take.cameras[2:4]
    made = make_segmenter(take, cameras)
    tables = {cameras[1].name: np.full(COLOUR_BINS, 5, np.uint8)}
    (plain,), (known,) = list(made.moments(3, 4)), list(made.knowing({}, tables).moments(3, 4))
    assert plain.classes is None
    assert known.classes is not None
    assert not known.classes[0].any(), "no table, no class"
    np.testing.assert_array_equal(known.classes[1], np.where(known.trimaps[1] == ACTOR, 5, 0))
    sent = packed(known.trimaps, 320, 240, known.classes).classes
    assert sent is not None
    np.testing.assert_array_equal(unpack_classes(sent, 2), known.classes)
