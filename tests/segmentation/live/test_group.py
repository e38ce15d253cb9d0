"""A group's silhouettes of a shot are those that the same pictures get in a recorded take."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from services.mocap.camera.colour import ColourCorrection, write_colours
from services.mocap.energy.bitplanes import unpack
from services.mocap.take.folder import Take, open_take
from services.mocap.take.live import open_live
from services.mocap.types import Bytes
from services.segmentation.__main__ import Feed
from services.segmentation.cleanup import SegmentationSettings
from services.segmentation.live.group import Silhouetter
from services.segmentation.live.shots import Shot, Taken

_NO_RED = ColourCorrection(np.diag([0.0, 1.0, 1.0, 0.0])[:3])
"""Before a grey wall a red ball can hardly be seen without it."""


@pytest.fixture
def folder(small_take: Callable[..., Path]) -> Path:
    folder = small_take("stage", n_cameras=3)
    cameras = "".join(f'[cameras.cam0{c}]\nsource = "videos/cam0{c}.mp4"\n' for c in (1, 2, 3))
    (folder / "live.toml").write_text(
        'name = "stage"\nfps = 10.0\nup = "z"\ncalibration = "calibration.toml"\nbackground = "background"\n'
        + cameras
    )
    return folder


def _live(folder: Path, raw: Take) -> Bytes:
    silhouetter = Silhouetter(open_live(folder / "live.toml"), range(3), "auto")
    taken = {c: Taken(next(iter(raw.video(camera))), 0.0) for c, camera in enumerate(raw.cameras)}
    there, planes = silhouetter.planes(Shot(0, 0.0, taken))
    assert there == [0, 1, 2]
    assert not planes.unsure.any()
    return planes.silhouettes


def _recorded(folder: Path) -> Bytes:
    return next(Feed(open_take(folder), [0, 1, 2], SegmentationSettings(), "auto").planes(0)).silhouettes


def test_silhouettes_are_those_of_a_recorded_take(folder: Path) -> None:
    planes = _live(folder, open_take(folder))
    assert unpack(planes, 3).any(axis=(1, 2)).all()
    np.testing.assert_array_equal(planes, _recorded(folder))


def test_colours_are_corrected_before_silhouettes_are_made(folder: Path) -> None:
    raw = open_take(folder)
    plain = _live(folder, raw)
    write_colours(folder / "colour.toml", {f"cam0{c}": (_NO_RED, 9.0, 1.0) for c in (1, 2)})
    planes = _live(folder, raw)
    np.testing.assert_array_equal(planes, _recorded(folder))
    changed = (unpack(planes, 3) != unpack(plain, 3)).any(axis=(1, 2))
    assert changed.tolist() == [True, True, False]
