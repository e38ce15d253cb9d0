"""What table 1 measures, and how it is told."""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

from bench.__main__ import app
from bench.candidates import Candidates, Name
from bench.problems import LARGEST_BATCH, Scene, Setup
from bench.rates import Runner, median_rates, with_best_batch
from bench.table1 import Row, as_table
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.engine import Engine
from services.mocap.energy.settings import EngineSettings
from services.mocap.errors import UserError
from services.mocap.search.model import Model
from services.mocap.search.stages import energy_of
from services.mocap.types import Floats


def test_the_papers_windows_beside_the_papers_figures() -> None:
    cases = Scene(Setup(320, 240, 8)).cases()
    assert [(case.name, case.paper) for case in cases] == [
        ("320x240 (full) XOR", 95.9),
        ("320x240 (full) XORPR", 95.5),
        ("160x120 (half-res) XOR", 131.1),
        ("160x120 (half-res) XORPR", 131.2),
        ("128x128 (arm) XOR", 133.7),
        ("128x128 (arm) XORPR", 433.1),
        ("64x64 (head) XOR", 144.9),
        ("64x64 (head) XORPR", 855.4),
        ("64x64 (hand) XOR", None),
        ("64x64 (hand) XORPR", None),
        ("320x240 (full) XORPR, colours", None),
        ("128x128 (arm) XORPR, colours", None),
        ("64x64 (hand) XORPR, colours", None),
    ]


def test_larger_pictures_have_larger_windows_and_no_figures_of_the_paper() -> None:
    cases = Scene(Setup.of("640x480", 4)).cases()
    plain = [case.name for case in cases if case.method == "XOR"]
    sizes = ["640x480 (full)", "320x240 (half-res)", "256x256 (arm)", "128x128 (head)", "128x128 (hand)"]
    assert plain == [f"{size} XOR" for size in sizes]
    assert {case.paper for case in cases} == {None}


def test_both_methods_differ_by_a_constant() -> None:
    """They evaluate one thing: the pre-rendered parts cost the same whatever moves."""
    scene = Scene(Setup(320, 240, 4))
    backend, cases = CpuBackend(scene.body, scene.rig), scene.cases()
    cases = [case for case in cases if case.problem.picture.classes is None]
    for plain, pre_rendered in zip(cases[::2], cases[1::2], strict=True):
        assert len(plain.values) == LARGEST_BATCH
        assert plain.is_plain_whole == (plain.window == "full")
        assert not pre_rendered.is_plain_whole
        values = plain.values[:10]
        for problems in ((plain.problem, pre_rendered.problem), (plain.thinned, pre_rendered.thinned)):
            energies = [backend.energy(problem)(values) for problem in problems]
            assert len(np.unique(energies[0])) > 5
            np.testing.assert_array_equal(energies[0] - energies[1], energies[0][0] - energies[1][0])


def test_rows_with_colours_count_them() -> None:
    scene = Scene(Setup(320, 240, 4))
    backend = CpuBackend(scene.body, scene.rig)
    model = Model(scene.body, scene.rig, backend)
    for case in [case for case in scene.cases() if case.method.endswith("colours")]:
        values = case.values[:10] + np.linspace(0.0, 1.0, 10)[:, None]  # far, for a hand to hide another part
        more_px = energy_of(model, case.problem)(values) - backend.energy(case.problem)(values)
        assert (more_px >= 0).all()
        assert more_px.any()


def test_only_cpu_lod_draws_thinned_meshes() -> None:
    scene, candidates = Scene(Setup(320, 240, 4)), Candidates([Name.CPU, Name.CPU_LOD])
    candidates.enter(scene)
    backend, first = CpuBackend(scene.body, scene.rig), scene.cases()[0]
    case = replace(first, values=first.values[:32])
    expected = {
        Name.CPU: backend.energy(case.problem)(case.values).tolist(),
        Name.CPU_LOD: backend.energy(case.thinned)(case.values).tolist(),
    }
    assert expected[Name.CPU] != expected[Name.CPU_LOD]
    runners = candidates.runners(case)
    assert {runner.backend for runner in runners} == set(expected)
    for runner in runners:
        assert runner.energy(case.values).tolist() == expected[Name(runner.backend)]
    candidates.close()


class Clock:
    """Stands in for time.perf_counter: it goes on only when something says that it took time."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr("bench.rates.time.perf_counter", clock)
    return clock


def test_a_rate_counts_poses_and_goes_round_all_of_them(clock: Clock) -> None:
    seen: list[int] = []

    def energy(values: Floats) -> Floats:
        clock.now_s += 0.25
        seen.extend(values[:, 0].astype(int))
        return values[:, 0]

    runner = Runner("mine", energy, np.arange(32.0)[:, None], batch=8)
    assert runner.rate(1.5) == 32.0
    assert seen == [*range(32), *range(16)]
    assert runner.rate(0.0) == 32.0
    assert len(seen) == 56


def test_a_larger_batch_is_taken_only_where_it_is_quicker(clock: Clock) -> None:
    def taking(seconds: Callable[[int], float]) -> Runner:
        def energy(values: Floats) -> Floats:
            clock.now_s += seconds(len(values))
            return values[:, 0]

        return Runner("mine", energy, np.zeros((LARGEST_BATCH, 1)))

    def batches(runner: Runner) -> list[int]:
        return [found.batch for found in with_best_batch(runner)]

    assert batches(taking(lambda n: 1e-3 + 1e-4 * n)) == [1, 512]
    assert batches(taking(lambda n: 1e-3 + 1e-7 * n)) == [1, 8192]
    assert batches(taking(lambda n: 1e-3 * n**1.5)) == [1]
    assert batches(taking(lambda n: 1.0 + n)) == [1]


def test_medians_are_taken_in_turns(clock: Clock) -> None:
    turns: list[str] = []

    def noting(name: str) -> Runner:
        def energy(values: Floats) -> Floats:
            clock.now_s += 0.01
            if turns[-1:] != [name]:
                turns.append(name)
            return values[:, 0]

        return Runner(name, energy, np.zeros((1, 1)))

    assert all(rate > 0 for rate in median_rates([noting("a"), noting("b")], repeats=3))
    assert turns == ["a", "b"] * 3


def test_whoever_cannot_run_here_is_left_out_with_a_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_egl(settings: EngineSettings) -> Engine:
        if settings.backend == "cpu":
            return Engine(settings, "cpu", "asked for")
        raise UserError(f"--backend {settings.backend}: no EGL; run apt-get install libegl1")

    def no_pyrender() -> None:
        raise UserError("pyrender: cannot be imported: No module named 'pyrender'")

    monkeypatch.setattr("bench.candidates.open_engine", no_egl)
    monkeypatch.setattr("bench.alternatives._import_pyrender", no_pyrender)
    candidates = Candidates(list(Name))
    candidates.enter(Scene(Setup(320, 240, 4)))
    assert candidates.names == [Name.CPU, Name.CPU_LOD, Name.OPENCV]
    assert candidates.reasons == [
        "gl is left out: --backend gl: no EGL; run apt-get install libegl1",
        "paper is left out: --backend paper: no EGL; run apt-get install libegl1",
        "pyrender is left out: pyrender: cannot be imported: No module named 'pyrender'",
    ]
    candidates.close()


def test_whoever_falls_back_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures of cpu are none of gl."""
    fallen = Engine(EngineSettings(backend="gl"), "cpu", "gl failed: the GPU is lost")
    monkeypatch.setattr("bench.candidates.open_engine", lambda _: fallen)
    candidates = Candidates([Name.GL])
    candidates.enter(Scene(Setup(320, 240, 4)))
    candidates.drop_fallen()
    assert candidates.names == []
    assert candidates.reasons == ["gl is left out: gl failed: the GPU is lost"]


def _row(backend: str, value: float, batch: int = 1, case: str = "320x240 (full) XOR") -> Row:
    return Row(f"{case} by {batch}", case, backend, value, "evaluations/s", batch, 8, (320, 240), 95.9)


def test_the_table_has_the_best_batch_and_the_ratio_to_pyrender() -> None:
    console = Console(width=120, record=True)
    rows = [_row("cpu", 1000.0), _row("cpu", 1500.0, 32), _row("pyrender", 20.0), _row("opencv", 10.0)]
    rows.append(_row("cpu", 2000.0, case="64x64 (head) XOR"))
    console.print(as_table(Setup(320, 240, 8), rows))
    text = console.export_text()
    lines = [re.findall(r"[\w.,]+(?: by \d+)?", line) for line in text.splitlines()]
    assert ["1,500 by 32"] in lines
    assert ["times pyrender", "75", "1", "0.5"] in [[" ".join(line[:2]), *line[2:]] for line in lines]
    assert text.count("times pyrender:") == 1  # the caption
    assert "2,000" in text


def test_the_command_writes_what_it_measured(tmp_path: Path) -> None:
    path = tmp_path / "table1.json"
    arguments = ["table1", "--backend", "cpu", "--backend", "opencv", "--size", "320x240", "--cameras", "4"]
    result = CliRunner().invoke(app, [*arguments, "--repeats", "1", "--json", str(path)])
    assert result.exit_code == 0, result.output
    assert "128x128 (arm) XORPR" in result.output
    content = json.loads(path.read_text())
    assert {"cores", "cpu", "python", "gl_renderer", "versions"} <= set(content["machine"])
    assert {row["backend"] for row in content["rows"]} == {"cpu", "opencv"}
    assert len({(row["name"], row["backend"]) for row in content["rows"]}) == len(content["rows"])
    assert len({row["case"] for row in content["rows"]}) == 13
    for row in content["rows"]:
        assert row["value"] > 0
        assert (row["unit"], row["cameras"], row["size_px"]) == ("evaluations/s", 4, [320, 240])
        assert row["paper"] is None
        by = f", batches of {row['batch']}" if row["batch"] > 1 else ""
        assert row["name"] == f"{row['case']}, 4 cameras{by}"
        assert row["batch"] in (1, 8, 32, 128, 512, 2048, 8192)


@pytest.mark.parametrize("name", ["missing/table1.json", "."])
def test_a_file_that_cannot_be_written_is_found_out_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setattr("bench.__main__.this_machine", lambda: pytest.fail("measured"))
    result = CliRunner().invoke(app, ["table1", "--json", str(tmp_path / name)])
    assert result.exit_code == 2, result.output
    assert "--json" in result.output
