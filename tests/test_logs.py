"""Lines of a log say what they are about."""

import json
import os
import subprocess
import sys
from pathlib import Path

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
