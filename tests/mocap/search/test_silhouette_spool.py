"""What was put in comes out again, in any order."""

import os
from contextlib import closing
from errno import ENOSPC
from unittest.mock import Mock

import numpy as np
import pytest
from numpy.random import default_rng

from services.mocap.energy.bitplanes import CLASS_BITS, TriPlanes
from services.mocap.errors import UserError
from services.mocap.search.silhouette_spool import SilhouetteSpool


def test_silhouettes_come_out_as_they_went_in() -> None:
    random = default_rng(5)
    frames = [
        TriPlanes(*(random.integers(0, 256, (2, 7, 9), np.uint8) * np.uint8(k % 2) for k in (1, frame)))
        for frame in range(5)
    ]
    spool = SilhouetteSpool()
    for k, frame in enumerate(frames):
        spool.append(frame)
        assert len(spool) == k + 1
        for j in (k, 0, k // 2):
            found = spool[j]
            np.testing.assert_array_equal(found.silhouettes, frames[j].silhouettes)
            np.testing.assert_array_equal(found.unsure, frames[j].unsure)
            assert found.silhouettes.flags.writeable  # compiled code takes no others
    spool.close()


def test_a_full_disk_is_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    """What does not fit stays in the file's buffer, so that closing it fails as well."""
    nothing, no_room = np.zeros((1, 7, 9), np.uint8), Mock(side_effect=OSError(ENOSPC, os.strerror(ENOSPC)))
    with (
        pytest.raises(UserError, match=r"cannot be kept there \(No space left on device\): make room"),
        closing(SilhouetteSpool()) as spool,
    ):
        full = Mock(wraps=spool._file, flush=no_room, close=no_room)
        monkeypatch.setattr(spool, "_file", full)
        spool.append(TriPlanes.sure(nothing))


def test_colour_classes_are_kept_with_them() -> None:
    random, spool = default_rng(6), SilhouetteSpool()
    silhouettes, unsure, *classes = random.integers(0, 256, (2 + CLASS_BITS, 2, 7, 9), np.uint8)
    spool.append(TriPlanes(silhouettes, unsure, np.array(classes)))
    found = spool[0].classes
    assert found is not None
    np.testing.assert_array_equal(found, classes)
    spool.append(TriPlanes(silhouettes, unsure))  # of a segmentation that knows no classes
    assert spool[1].classes is None
    assert spool[0].classes is not None
    spool.close()
