"""When a run may go on from another: only where nothing that poses depend on has changed."""

import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path

import numpy as np
import pytest

from services.coordinator.plan import Plan
from services.mocap.search.settings import SearchSettings
from services.mocap.take import segmenter_name
from services.mocap.take.fit_record import COLOUR_BINS
from services.mocap.take.folder import open_take

SmallTake = Callable[..., Path]


def name_of(folder: Path, segmenter: str = "auto") -> str:
    take = open_take(folder)
    return Plan(take, range(take.settings.frames), SearchSettings(), segmenter, None).name


def write_anew(path: Path, content: bytes) -> None:
    """With the same size and a later time of writing, at least."""
    before_ns = path.stat().st_mtime_ns
    path.write_bytes(content)
    os.utime(path, ns=(before_ns + 10**9, before_ns + 10**9))


def test_a_plan_keeps_its_name_until_a_recording_changes(small_take: SmallTake) -> None:
    folder = small_take()
    before = name_of(folder)
    assert name_of(folder) == before != name_of(folder, "mog2")
    video = folder / "videos/cam02.mp4"
    write_anew(video, video.read_bytes())
    assert name_of(folder) != before


def test_another_network_is_another_plan(small_take: SmallTake, tmp_path: Path) -> None:
    network = tmp_path / "net.onnx"
    network.write_bytes(b"one network")
    folder = small_take()
    before = name_of(folder, f"onnx:{network}")
    assert name_of(folder, f"onnx:{network}") == before
    write_anew(network, b"two network")
    assert name_of(folder, f"onnx:{network}") != before
    network.unlink()
    assert name_of(folder, f"onnx:{network}") != before  # as on a host without it


@pytest.mark.parametrize("is_package", [True, False])
def test_a_plug_in_that_changes_is_another_plan(
    small_take: SmallTake, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_package: bool
) -> None:
    module = f"plugged_{is_package}".lower()
    code = tmp_path / (f"{module}/inner.py" if is_package else f"{module}.py")
    code.parent.mkdir(exist_ok=True)
    code.write_text("raise AssertionError('nothing of it is imported')")
    if is_package:
        code.with_name("__init__.py").write_text("raise AssertionError('nothing of it is imported')")
    monkeypatch.syspath_prepend(tmp_path)
    value = f"{module}.inner:Mine" if is_package else f"{module}:Mine"
    installed = EntryPoints([EntryPoint("mine", value, segmenter_name.GROUP)])
    monkeypatch.setattr(segmenter_name, "entry_points", lambda **asked: installed.select(**asked))
    folder = small_take()
    before, other = name_of(folder, "mine"), name_of(folder, "clean-plate")
    assert name_of(folder, "mine") == before
    write_anew(code, code.read_bytes())
    assert name_of(folder, "mine") != before
    assert name_of(folder, "clean-plate") == other


def test_videos_count_where_they_are_looked_at_beside_silhouettes(small_take: SmallTake) -> None:
    folder = small_take("both", source="silhouettes")
    shutil.copytree(small_take("filmed") / "videos", folder / "videos")
    own, made = name_of(folder), name_of(folder, "mog2")
    video = next((folder / "videos").glob("*.mp4"))
    write_anew(video, video.read_bytes())
    assert name_of(folder) == own
    assert name_of(folder, "mog2") != made


def test_what_hides_the_actor_is_part_of_the_plan(small_take: SmallTake) -> None:
    take = open_take(small_take())
    mask = np.zeros((240, 320), bool)
    plan = Plan(take, range(take.settings.frames), SearchSettings(), "auto", None)
    hidden = [replace(plan, occluded={"cam01": mask}).name]
    mask[100, 100] = True
    hidden += [replace(plan, occluded={name: mask}).name for name in ("cam01", "cam02")]
    assert len({plan.name, *hidden}) == 4
    assert replace(plan, occluded={"cam02": mask.copy()}).name == hidden[-1]


def test_what_colours_look_like_is_part_of_the_plan(small_take: SmallTake) -> None:
    take = open_take(small_take())
    plan = Plan(take, range(take.settings.frames), SearchSettings(), "auto", None)
    tables = [np.full(COLOUR_BINS, k, np.uint8) for k in (0, 1)]
    names = {plan.name, *(replace(plan, colour_tables={"cam01": table}).name for table in tables)}
    assert len(names) == 3
