"""What Prometheus gets, and where it may ask."""

import socket
from urllib.request import urlopen

import pytest
from prometheus_client import Counter

from services.metrics import offering
from services.mocap.errors import UserError

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
    with pytest.raises(UserError, match="expected a port"), offering(address):
        pass


def test_a_port_that_is_taken() -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(UserError, match="cannot listen there"), offering(str(port)):
            pass
