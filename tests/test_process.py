"""The options of the energy: the same words from the command to its processes, and what they refuse."""

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer import Typer
from typer.testing import CliRunner

from services.mocap.energy.settings import MOST_THREADS, EngineSettings
from services.mocap.errors import UserError
from services.process import (
    DEFAULT_ENGINE,
    BackendOption,
    DetailOption,
    ThreadsOption,
    engine_arguments,
    engine_settings,
)

app = Typer()
seen: list[EngineSettings] = []


@app.command()
def take(
    backend: BackendOption = DEFAULT_ENGINE.backend,
    threads: ThreadsOption = DEFAULT_ENGINE.threads,
    detail_px: DetailOption = DEFAULT_ENGINE.detail_px,
) -> None:
    seen.append(engine_settings(backend, threads, detail_px))


def read(*arguments: str, env: dict[str, str] | None = None) -> EngineSettings:
    done = CliRunner().invoke(app, list(arguments), env=env or {}, catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return seen.pop()


@given(
    st.builds(
        EngineSettings,
        backend=st.sampled_from(["auto", "gl", "cpu", "paper"]),
        threads=st.integers(0, MOST_THREADS),
        detail_px=st.floats(0, 1e6),
    )
)
def test_what_is_handed_on_arrives(settings: EngineSettings) -> None:
    assert read(*engine_arguments(settings)) == settings


def test_nothing_said_is_the_default() -> None:
    assert read() == EngineSettings()


def test_the_environment_speaks_where_no_option_does() -> None:
    env = {"XORMOCAP_BACKEND": "cpu", "XORMOCAP_THREADS": "0", "XORMOCAP_DETAIL_PX": "0"}
    assert read(env=env) == EngineSettings(backend="cpu", threads=0, detail_px=0)
    assert read("--threads", "2", env=env).threads == 2


@pytest.mark.parametrize(
    "wrong", [("--backend", "vulkan"), ("--threads", "-1"), ("--threads", "1025"), ("--detail-px", "-0.5")]
)
def test_options_that_cannot_be_are_refused(wrong: tuple[str, str]) -> None:
    done = CliRunner().invoke(app, list(wrong))
    assert done.exit_code == 2
    assert wrong[0] in done.output


@pytest.mark.parametrize("detail_px", [math.nan, math.inf])
def test_numbers_that_are_none_are_refused(detail_px: Any) -> None:
    with pytest.raises(
        UserError, match=r"^options of the energy: detail_px: expected pixels, 0 or more, found"
    ):
        engine_settings("cpu", 1, detail_px)
