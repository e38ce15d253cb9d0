"""All steps of a command share what is learnt of a take."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from exact_take import write_exact_take
from services.mocap.body.actor import Actor
from services.mocap.energy.bitplanes import TriPlanes, pack, unpack
from services.mocap.take.folder import open_take
from services.runs import take_silhouettes
from services.runs.take_silhouettes import TakeSilhouettes, seen_of
from services.segmentation.segmenters import make_segmenter

SmallTake = Callable[..., Path]


def test_a_take_is_learnt_once_and_its_remarks_stay(
    small_take: SmallTake, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, made = small_take(n_cameras=3, frames=4), list[object]()
    shutil.rmtree(folder / "background")

    def counted(*arguments: Any) -> Any:
        made.append(make_segmenter(*arguments))
        return made[-1]

    monkeypatch.setattr(take_silhouettes, "make_segmenter", counted)
    silhouettes = TakeSilhouettes(open_take(folder), kept=tmp_path)
    assert not silhouettes.has_stage
    assert not made
    (remark,) = silhouettes.remarks
    assert "the empty scene was estimated from the videos" in remark
    list(silhouettes.segmenter.trimaps(0, 4))
    assert silhouettes.kept is not None
    assert silhouettes.kept.has_all(4)
    assert TakeSilhouettes(open_take(folder)).kept is None
    assert silhouettes.remarks == silhouettes.said == [remark]
    assert made == [silhouettes.segmenter]
    assert not TakeSilhouettes(open_take(folder), kept=tmp_path).remarks, "all is kept, so nothing is learnt"


def test_a_camera_from_which_somebody_hides_the_actor_at_first_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    write_exact_take(tmp_path / "walk", n_frames=2, n_cameras=4)
    take, frames = open_take(tmp_path / "walk"), list[int]()
    hidden = pack(np.arange(4)[:, None, None] * np.ones((4, 240, 320)) == 2)

    def without_others(_: object, seen: TriPlanes, *__: object) -> TriPlanes:
        frames.append(len(frames))
        return seen.doubting(seen.silhouettes & hidden) if len(frames) == 1 else seen

    monkeypatch.setattr(take_silhouettes, "without_others", without_others)
    actor, segmenter = Actor(height=1.8), TakeSilhouettes(take).segmenter
    cameras, seen = seen_of(take, range(2), segmenter, lambda _: None, (actor, np.zeros((2, 38))))
    assert cameras == take.cameras
    shown = [unpack(planes, 4).any(axis=(1, 2)).tolist() for planes in seen.silhouettes]
    assert shown == [[True, True, False, True], [True] * 4]
    (warning,) = [record.getMessage() for record in caplog.records]
    assert warning == "silhouettes: somebody else hides the actor from cam03 in the first frame"
