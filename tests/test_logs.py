"""Lines of a log say what they are about."""

import json
import logging
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from services.logs import SparingLog

ROOT = Path(__file__).resolve().parents[1]
_PROGRAM = """
import logging
from services import logs
logs.begin("limb_worker")
logging.warning("before")
logs.about(take="walk", frame=3, **{"pass": 1, "limb": "left_arm"})
logging.warning("within %d", 1)
logs.about(frame=None, limb=None, **{"pass": None})
logging.warning("after")
"""


def said(kind: str) -> list[str]:
    environment = {**os.environ, "XORMOCAP_LOG": kind}
    done = subprocess.run(
        [sys.executable, "-c", _PROGRAM],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stderr.splitlines()


def test_in_words() -> None:
    before, within, after = (line.partition(" limb_worker ")[2] for line in said("text"))
    assert before == "WARNING before"
    assert within == "[take=walk frame=3 pass=1 limb=left_arm] WARNING within 1"
    assert after == "[take=walk] WARNING after"


def test_as_json() -> None:
    within = json.loads(said("json")[1])
    assert within.pop("time")
    assert within.pop("pid") > 0
    facts = {"take": "walk", "frame": 3, "pass": 1, "limb": "left_arm"}
    assert within == {"service": "limb_worker", "level": "WARNING", **facts, "message": "within 1"}


def test_a_log_is_not_filled_by_one_line_of_the_program(caplog: pytest.LogCaptureFixture) -> None:
    caplog.handler.addFilter(sparing := SparingLog(most=3, period_s=0.05))
    log = logging.getLogger("test")
    for _ in range(2):
        for k in range(1000):
            log.warning("dropped %d", k)
        log.warning("something else")
        time.sleep(0.06)
    caplog.handler.removeFilter(sparing)
    assert caplog.messages.count("something else") == 2
    shown = [message for message in caplog.messages if message.startswith("dropped")]
    assert 6 <= len(shown) < 100
    assert any("were not logged)" in message for message in shown)
