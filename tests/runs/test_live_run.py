"""What a live run without a pose tells."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast
from unittest.mock import Mock

import pytest

from services.mocap.errors import UserError
from services.mocap.result.layout import LOGS, RUN_JSON, partial_of
from services.runs import live as module


def test_results_of_a_run_that_was_cut_off_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out, part, logs = tmp_path / "out", partial_of(tmp_path / "out"), tmp_path / "logs"
    out.mkdir()
    (out / RUN_JSON).write_text("{}")

    def cut_off(*_: object) -> tuple[Path, bool, None]:
        part.mkdir()
        (part / RUN_JSON).write_text("{}")
        logs.mkdir()
        return logs, True, None

    monkeypatch.setattr(module, "run_services", cut_off)
    take = SimpleNamespace(live=SimpleNamespace(endpoint=None), groups_here=[])
    job: Any = SimpleNamespace(out=out, take=take, config="live.toml", record=None)
    with pytest.raises(
        UserError, match=f"^{part}: has the results of this run, which was cut off: move them "
    ):
        module.live(cast(module.LiveJob, job), show=Mock())
    assert (part / LOGS).is_dir()


@pytest.mark.parametrize(
    ("logged", "said"),
    [
        ("INFO first pose: not yet: nobody is visible\nINFO end\n", "nobody is visible"),
        ("INFO first pose: not yet: one\nINFO first pose: not yet: another\n", "another"),
        ("INFO end\n", "the logs are in LOGS"),
    ],
)
def test_why_nobody_was_tracked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, logged: str, said: str
) -> None:
    logs = tmp_path / "logs"
    logs.mkdir()
    (logs / "coordinator-0.log").write_text(logged)
    monkeypatch.setattr(module, "run_services", Mock(return_value=(logs, False, None)))
    take = SimpleNamespace(live=SimpleNamespace(endpoint=None), groups_here=[])
    job: Any = SimpleNamespace(out=tmp_path / "out", take=take, config="live.toml", record=None)
    with pytest.raises(UserError) as failure:
        module.live(cast(module.LiveJob, job), show=Mock())
    assert str(failure.value) == f"live.toml: nobody was tracked: {said.replace('LOGS', str(logs))}"
    assert logs.exists() == (said == "the logs are in LOGS")
