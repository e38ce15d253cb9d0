"""Options that the command hands on to its processes in the same words, and what they refuse."""

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer import Typer
from typer.testing import CliRunner

from services.mocap.energy.settings import MOST_THREADS, EngineSettings
from services.mocap.errors import UserError
from services.mocap.search.overrides import search_settings
from services.mocap.search.settings import SearchSettings
from services.options import (
    DEFAULT_ENGINE,
    BackendOption,
    BodyOption,
    SearchOption,
    SetOption,
    SettingsOption,
    ThreadsOption,
    engine_arguments,
    engine_settings,
    search_arguments,
)

app = Typer()
seen: list[tuple[EngineSettings, SearchSettings]] = []
CAMERAS = 3


@app.command()
def take(
    backend: BackendOption = DEFAULT_ENGINE.backend,
    threads: ThreadsOption = DEFAULT_ENGINE.threads,
    changes: SetOption = None,
    settings: SettingsOption = None,
    preset: SearchOption = "default",
    body: BodyOption = None,
) -> None:
    search = search_settings(changes or [], settings, CAMERAS, preset, body)
    seen.append((engine_settings(backend, threads), search))


def read(*arguments: str, env: dict[str, str] | None = None) -> tuple[EngineSettings, SearchSettings]:
    done = CliRunner().invoke(app, list(arguments), env=env or {}, catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return seen.pop()


@given(
    st.builds(
        EngineSettings,
        backend=st.sampled_from(["auto", "gl", "cpu", "paper"]),
        threads=st.integers(0, MOST_THREADS),
    ),
    st.builds(
        SearchSettings,
        body=st.sampled_from(["anatomical", "paper"]),
        max_passes=st.integers(1, 20),
        detail_px=st.floats(0, 100),
        leg_grid=st.tuples(*[st.integers(1, 15)] * 4),
        camera_weights=st.just(()) | st.tuples(*[st.floats(0, 1000)] * CAMERAS).filter(any),
    ),
)
def test_what_is_handed_on_arrives(engine: EngineSettings, search: SearchSettings) -> None:
    assert read(*engine_arguments(engine), *search_arguments(search)) == (engine, search)


def test_nothing_said_is_the_default() -> None:
    assert read() == (EngineSettings(), SearchSettings())
    assert search_arguments(SearchSettings()) == ()


def test_the_environment_speaks_where_no_option_does() -> None:
    env = {"XORMOCAP_BACKEND": "cpu", "XORMOCAP_THREADS": "0"}
    assert read(env=env)[0] == EngineSettings(backend="cpu", threads=0)
    assert read("--threads", "2", env=env)[0].threads == 2


def test_settings_of_a_file_and_beside_it(tmp_path: Path) -> None:
    file = tmp_path / "quick.toml"
    file.write_text("max_passes = 1\ndetail_px = 2\n")
    said = read("--settings", str(file), "--set", "detail_px=1", "--set", "arm_grid=[3, 3, 1, 3]")[1]
    assert said == SearchSettings(max_passes=1, detail_px=1, arm_grid=(3, 3, 1, 3))


@pytest.mark.parametrize("search", ["paper", "plain"])
def test_the_searches_of_the_paper_have_its_body_unless_another_is_chosen(search: str) -> None:
    assert read()[1].body == "anatomical"
    assert read("--body", "paper")[1] == SearchSettings(body="paper")
    assert read("--search", search)[1].body == "paper"
    assert read("--search", search, "--body", "anatomical")[1].body == "anatomical"
    assert read("--search", search, "--set", 'body="anatomical"')[1].body == "anatomical"


def test_the_body_goes_before_that_of_a_file(tmp_path: Path) -> None:
    file = tmp_path / "rigid.toml"
    file.write_text('body = "paper"\n')
    assert read("--settings", str(file))[1].body == "paper"
    assert read("--settings", str(file), "--body", "anatomical")[1].body == "anatomical"


@pytest.mark.parametrize(
    "wrong", [("--body", "whole"), ("--backend", "vulkan"), ("--threads", "-1"), ("--threads", "1025")]
)
def test_options_that_cannot_be_are_refused(wrong: tuple[str, str]) -> None:
    done = CliRunner().invoke(app, list(wrong))
    assert done.exit_code == 2
    assert wrong[0] in done.output


@pytest.mark.parametrize("threads", [-1, 0.5, "many"])
def test_numbers_that_are_none_are_refused(threads: Any) -> None:
    with pytest.raises(
        UserError, match=r"^options of the energy: threads: expected a number of 0 to 1024, found"
    ):
        engine_settings("cpu", threads)
