"""The table of segmenters: what a name means, what each makes of a small take, and what is refused."""

import logging
import shutil
import sys
from collections.abc import Callable
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar
from unittest.mock import Mock

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from services import cli
from services.commands import consoles
from services.mocap.camera.camera import Camera
from services.mocap.energy.bitplanes import trimap_of
from services.mocap.errors import UserError
from services.mocap.take.folder import Take, open_take
from services.mocap.take.pictures import read_silhouette
from services.mocap.take.segmenter_name import GROUP, KINDS, USUAL, check_segmenter, meanings
from services.mocap.take.writer import video_writer
from services.mocap.types import ACTOR, UNSURE, Bytes, Mask
from services.options import SegmenterOption
from services.segmentation import segmenters
from services.segmentation.segmenters import make_segmenter

SmallTake = Callable[..., Path]
Ball = Callable[[Camera, int], Mask]


def overlap(take: Take, ball: Ball, name: str) -> float:
    """The worst IoU over all cameras and frames."""
    made = make_segmenter(take, take.cameras, name)
    frames = take.settings.frames
    return min(
        float(((trimap == ACTOR) & ball(camera, f)).sum() / ((trimap == ACTOR) | ball(camera, f)).sum())
        for f, of_frame in zip(range(frames), made.trimaps(0, frames), strict=True)
        for camera, trimap in zip(take.cameras, of_frame, strict=True)
    )


def test_every_segmenter_can_be_made_and_the_help_and_the_page_say_what_it_is() -> None:
    assert {USUAL, *segmenters._MATTES} == set(KINDS)
    (option,) = SegmenterOption.__metadata__
    rows = ["| name | method |", "| --- | --- |"]
    for names, meaning in meanings().items():
        assert f"{' or '.join(names)}: {meaning};" in option.help
        rows.append(f"| {', '.join(f'`{name}`' for name in names)} | {meaning} |")
    page = (Path(segmenters.__file__).parent / "README.md").read_text()
    table = "\n".join([*rows, ""])
    assert table in page, f"the page should read:\n\n{table}"


@pytest.mark.parametrize("name", ["auto", "clean-plate", "paper", "mog2", "bgsegm"])
@pytest.mark.parametrize("plate", ["video", "picture"])
def test_the_ball_is_found(small_take: SmallTake, ball_silhouette: Ball, name: str, plate: str) -> None:
    assert overlap(open_take(small_take(clean_plate=plate)), ball_silhouette, name) > 0.6


@pytest.mark.parametrize("name", ["auto", "paper", "mog2", "bgsegm"])
def test_without_a_clean_plate_the_take_tells_and_one_warning_says_so(
    small_take: SmallTake, ball_silhouette: Ball, name: str, caplog: pytest.LogCaptureFixture
) -> None:
    folder = small_take(frames=18)
    shutil.rmtree(folder / "background")
    with caplog.at_level(logging.WARNING):
        assert overlap(open_take(folder), ball_silhouette, name) > 0.6
    (record,) = caplog.records
    sentence = record.getMessage()
    assert sentence.startswith(f"{folder}/background: is missing: ")
    assert "fewer than half of 18 frames" in sentence
    assert "\n" not in sentence


def green_take(folder: Path, ball: Ball) -> Take:
    """The small take, its grey wall painted green, unevenly lit; without clean plates."""
    shutil.rmtree(folder / "background")
    light = np.linspace(0.5, 1, 64)[None, :, None]
    for camera in open_take(folder).cameras:
        with video_writer(folder / f"videos/{camera.name}.mp4", 64, 48, 10.0) as video:
            for frame in range(4):
                picture = (np.full((48, 64, 3), (70, 175, 40)) * light).astype(np.uint8)
                picture[ball(camera, frame)] = (60, 70, 200)
                video.write(picture)
    return open_take(folder)


@pytest.mark.parametrize("name", ["chroma", "chroma:28af46"])
def test_a_green_screen(small_take: SmallTake, ball_silhouette: Ball, name: str) -> None:
    take = green_take(small_take(), ball_silhouette)
    assert overlap(take, ball_silhouette, name) > 0.6
    with pytest.raises(UserError, match="grey"):
        make_segmenter(take, take.cameras, "chroma:808080")


def test_a_grey_wall_is_no_screen(small_take: SmallTake) -> None:
    take = open_take(small_take())
    with pytest.raises(UserError, match=r"cam01: the edges .* no screen of one colour .* chroma:RRGGBB"):
        make_segmenter(take, take.cameras, "chroma")


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("mog3", "there is no such segmenter: did you mean mog2"),
        ("mog2:7", "mog2 takes nothing after its name: leave out :7"),
        ("onnx", "expected onnx:FILE"),
        ("onnx:", "expected onnx:FILE"),
        ("chroma:green", "expected chroma:RRGGBB in hexadecimal, such as chroma:00b140"),
    ],
)
def test_names_that_mean_nothing(name: str, sentence: str) -> None:
    with pytest.raises(UserError) as refused:
        check_segmenter(name)
    assert str(refused.value) == f"--segmenter {name}: {sentence}"


def test_what_a_take_lacks_is_said(small_take: SmallTake) -> None:
    videos, ready = open_take(small_take("a")), open_take(small_take("b", source="silhouettes"))
    with pytest.raises(UserError, match="expected silhouettes/ beside"):
        make_segmenter(videos, videos.cameras, "silhouettes")
    with pytest.raises(UserError, match="has no video of cam01"):
        make_segmenter(ready, ready.cameras, "mog2")


class Stencil:
    """A plug-in that calls a fixed part of the picture the actor."""

    given: ClassVar[list[tuple[str, Bytes | None]]] = []

    def __init__(self, camera: Camera, plate_bgr: Bytes | None) -> None:
        self.given.append((camera.name, plate_bgr))
        self._shape = camera.shape_px

    def silhouette(self, image_bgr: Bytes) -> Any:
        assert image_bgr.shape == (*self._shape, 3)
        mask = np.zeros(self._shape, bool)
        mask[10:20, 30:40] = True
        return mask


class Doubtful(Stencil):
    def silhouette(self, image_bgr: Bytes) -> Any:
        trimap = trimap_of(super().silhouette(image_bgr))
        trimap[20:22] = self.doubt
        return trimap

    doubt: ClassVar[int] = UNSURE


class Failing(Stencil):
    def silhouette(self, image_bgr: Bytes) -> Any:
        raise ValueError(f"no memory for {image_bgr.shape}")


class Wrong(Stencil):
    def silhouette(self, image_bgr: Bytes) -> Any:
        return super().silhouette(image_bgr).astype(np.float32)


@pytest.fixture
def plug_ins(monkeypatch: pytest.MonkeyPatch) -> None:
    """Entry points stencil, doubtful, wrong and failing, as installed packages would have them."""
    installed = EntryPoints(
        EntryPoint(name, f"{__name__}:{name.title()}", GROUP)
        for name in ("stencil", "doubtful", "wrong", "failing")
    )
    for module in ("mocap.take.segmenter_name", "segmentation.external"):
        monkeypatch.setattr(f"services.{module}.entry_points", lambda **asked: installed.select(**asked))


@pytest.mark.usefixtures("plug_ins")
@pytest.mark.parametrize("has_plate", [True, False])
def test_a_plug_in(small_take: SmallTake, has_plate: bool) -> None:
    folder = small_take()
    if not has_plate:
        shutil.rmtree(folder / "background")
    take = open_take(folder)
    Stencil.given.clear()
    made = make_segmenter(take, take.cameras, "stencil")
    assert [name for name, _ in Stencil.given] == ["cam01", "cam02"]
    for _, plate in Stencil.given:
        assert (plate is not None) == has_plate
        assert plate is None or (plate.shape == (48, 64, 3) and plate.dtype == np.uint8)
    assert [np.count_nonzero(trimap == ACTOR) for trimap in next(made.trimaps(0, 1))] == [100, 100]


@pytest.mark.usefixtures("plug_ins")
@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("wrong", r"expected masks of .* got .* of float32"),
        ("failing", r"failed on a picture \(ValueError: no memory for"),
    ],
)
def test_a_plug_in_that_fails_or_answers_nonsense(small_take: SmallTake, name: str, said: str) -> None:
    take = open_take(small_take())
    made = make_segmenter(take, take.cameras, name)
    with pytest.raises(UserError, match=f"--segmenter {name}: {said}"):
        next(made.trimaps(0, 1))


@pytest.mark.usefixtures("plug_ins")
def test_a_plug_in_may_be_unsure(small_take: SmallTake, monkeypatch: pytest.MonkeyPatch) -> None:
    take = open_take(small_take())
    (trimaps,) = make_segmenter(take, take.cameras, "doubtful").trimaps(0, 1)
    assert [np.count_nonzero(trimap == ACTOR) for trimap in trimaps] == [100, 100]
    assert [np.count_nonzero(trimap == UNSURE) for trimap in trimaps] == [2 * 64, 2 * 64]
    monkeypatch.setattr(Doubtful, "doubt", 7)
    with pytest.raises(UserError, match=r"--segmenter doubtful: expected 0 .* 128 .* 255 .* got 7: ask"):
        next(make_segmenter(take, take.cameras, "doubtful").trimaps(0, 1))


class RedNetwork:
    """Stands in for a session of onnxruntime: what is redder than its second input, at half the size."""

    n_inputs, kind = 2, "tensor(float)"
    doubt = 0.0
    """Opacity of the upper four rows."""

    def __init__(self, path: str, providers: list[str]) -> None:
        assert providers == ["CPU"]
        if Path(path).read_bytes() != b"network":
            raise ValueError("not a network\nmore")

    def get_inputs(self) -> list[SimpleNamespace]:
        names = ("picture", "plate", "state")[: self.n_inputs]
        return [SimpleNamespace(name=name, shape=[1, 3, 24, "w"], type=self.kind) for name in names]

    def run(self, outputs: None, feeds: dict[str, Any]) -> list[Any]:
        assert outputs is None
        assert all(feed.shape == (1, 3, 24, 64) and feed.dtype == np.float32 for feed in feeds.values())
        opacity = (feeds["picture"][:, :1] - feeds["plate"][:, :1] > 0.2).astype(np.float32)
        opacity[..., :4, :] = self.doubt
        return [feeds["picture"], opacity]


@pytest.fixture
def network(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    runtime = SimpleNamespace(InferenceSession=RedNetwork, get_available_providers=lambda: ["CPU"])
    monkeypatch.setitem(sys.modules, "onnxruntime", runtime)
    (tmp_path / "red.onnx").write_bytes(b"network")
    return tmp_path / "red.onnx"


def test_a_network(small_take: SmallTake, ball_silhouette: Ball, network: Path) -> None:
    assert overlap(open_take(small_take()), ball_silhouette, f"onnx:{network}") > 0.6


@pytest.mark.parametrize(("opacity", "unsure"), [(0.1, False), (0.4, True), (0.6, True), (0.9, False)])
def test_what_a_network_does_not_know_is_unsure(
    small_take: SmallTake, network: Path, monkeypatch: pytest.MonkeyPatch, opacity: float, unsure: bool
) -> None:
    monkeypatch.setattr(RedNetwork, "doubt", opacity)
    take = open_take(small_take())
    made = make_segmenter(take, take.cameras, f"onnx:{network}")
    trimap = next(made.source.raw_moments(0, 1)).trimaps[0]
    assert (trimap[:7] == UNSURE).all() == unsure
    assert not (trimap[10:] == UNSURE).any()


def test_a_network_that_fails_on_a_picture(
    small_take: SmallTake, network: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(RedNetwork, "run", Mock(side_effect=RuntimeError("wrong shape\nmore")))
    take = open_take(small_take())
    made = make_segmenter(take, take.cameras, f"onnx:{network}")
    with pytest.raises(UserError, match=r"red\.onnx: failed on a picture \(wrong shape\): export it again"):
        next(made.source.raw_moments(0, 1))


def test_a_network_that_wants_a_plate_or_something_else(
    small_take: SmallTake, network: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = small_take()
    take = open_take(folder)
    with pytest.raises(UserError, match=r"bad\.onnx: is missing"):
        make_segmenter(take, take.cameras, f"onnx:{network.with_name('bad.onnx')}")
    network.with_name("bad.onnx").write_bytes(b"no network")
    with pytest.raises(UserError, match=r"bad\.onnx: cannot be loaded as a network \(not a network\): "):
        make_segmenter(take, take.cameras, f"onnx:{network.with_name('bad.onnx')}")
    monkeypatch.setattr(RedNetwork, "n_inputs", 3)
    with pytest.raises(UserError, match=r"found picture: tensor\(float\), plate: .*, state: "):
        make_segmenter(take, take.cameras, f"onnx:{network}")
    monkeypatch.setattr(RedNetwork, "n_inputs", 2)
    shutil.rmtree(folder / "background")
    take = open_take(folder)
    with pytest.raises(UserError, match=r"its second input is for the clean plate, but .* no background/"):
        make_segmenter(take, take.cameras, f"onnx:{network}")


def test_no_onnxruntime_is_one_sentence(small_take: SmallTake, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    take = open_take(small_take())
    with pytest.raises(UserError) as refused:
        make_segmenter(take, take.cameras, "onnx:net.onnx")
    assert str(refused.value) == (
        "--segmenter onnx:net.onnx: needs the package onnxruntime, which is not installed: "
        "pip install 'xormocap[onnx]'"
    )


def test_segment_takes_the_option_and_warns(
    small_take: SmallTake, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, shown = small_take(frames=18), list[str]()
    shutil.rmtree(folder / "background")
    monkeypatch.setattr(consoles.stderr, "print", lambda text="", **_: shown.append(str(text)))
    monkeypatch.setenv("XORMOCAP_SEGMENTER", "mog2")
    result = CliRunner().invoke(cli.app, ["segment", str(folder), "--out", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    assert next(text for text in shown if text.startswith("warning: ")).endswith("record the empty stage")
    mask = read_silhouette(tmp_path / "out/silhouettes/cam02/000011.png")
    assert cv2.connectedComponents(mask.astype(np.uint8))[0] == 2
