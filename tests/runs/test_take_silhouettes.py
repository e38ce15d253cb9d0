"""All steps of a command share what is learnt of a take."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from services.mocap.take.folder import open_take
from services.runs import take_silhouettes
from services.runs.take_silhouettes import TakeSilhouettes
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
