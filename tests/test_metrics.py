"""What Prometheus gets, and where it may ask."""

import importlib
import re
import socket
from pathlib import Path
from urllib.request import urlopen

import pytest
from prometheus_client import REGISTRY, Counter

from bench.soak.sample_messages import sample_messages
from proto.framing import decode
from proto.messages import Telemetry
from services.metrics import offering
from services.mocap.errors import UserError

_ROOT = Path(__file__).resolve().parents[1]

_ANSWERS = Counter("xormocap_test_answers", "For this test.")


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port


@pytest.mark.parametrize("host", ["", "127.0.0.1:", "localhost:"])
def test_figures_are_told_within_the_block_only(host: str) -> None:
    port = free_port()
    with offering(f"{host}{port}"):
        _ANSWERS.inc()
        with urlopen(f"http://127.0.0.1:{port}/metrics") as answer:
            told = answer.read().decode()
    assert "xormocap_test_answers_total" in told
    assert "process_resident_memory_bytes" in told
    with pytest.raises(OSError, match="refused"):
        urlopen(f"http://127.0.0.1:{port}/metrics")


def test_nothing_listens_unless_asked_to() -> None:
    with offering(None), offering(""):
        pass


@pytest.mark.parametrize("address", ["x", "0", "70000", "host:", ":80", "a b:80", "1.2.3.4:0", "-1"])
def test_what_is_no_address(address: str) -> None:
    with (
        pytest.raises(UserError, match=r"^--metrics .*: expected a port from 1 to 65535, or HOST:PORT$"),
        offering(address),
    ):
        pass


def test_a_port_that_is_taken() -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(UserError, match="cannot listen there"), offering(str(port)):
            pass


def test_all_services_fit_into_one_process_and_the_table_tells_of_every_figure() -> None:
    modules = {path.parent.name: path for path in (_ROOT / "services").glob("*/metrics.py")}
    assert sorted(modules) == ["coordinator", "limb_worker", "recorder", "segmentation", "viewer"]
    loaded = {name: importlib.import_module(f"services.{name}.metrics") for name in modules}
    gauges = loaded["coordinator"].Gauges()
    gauges.latest = decode(sample_messages("walk", 3)["telemetry"])
    try:
        assert isinstance(gauges.latest, Telemetry)
        found = {
            f"{family.name}_total" if family.type == "counter" else family.name
            for family in REGISTRY.collect()
            if family.name.startswith("xormocap_") and not family.name.startswith("xormocap_test")
        }
    finally:
        REGISTRY.unregister(gauges)
    table = (_ROOT / "docker" / "README.md").read_text()
    told = [
        name
        for line in re.findall(r"^\| (`xormocap_.*?) \|", table, re.MULTILINE)
        for name in re.findall(r"`(.*?)`", line)
    ]
    assert sorted(told) == sorted(found)
