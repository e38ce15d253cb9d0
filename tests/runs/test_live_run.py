"""What a live run without a pose tells."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast
from unittest.mock import Mock

import pytest

from services.mocap.errors import UserError
from services.runs import live as module


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
