"""Where streams listen, and that the table of streams carries every message."""

import pytest
from protocol_tables import carried_by

from proto.messages import MESSAGES
from proto.streams import DEFAULT_ENDPOINT, STREAMS, StreamName, stream_endpoint


@pytest.mark.parametrize(
    ("endpoint", "stream", "expected"),
    [
        (DEFAULT_ENDPOINT, "tasks", "tcp://127.0.0.1:5550"),
        (DEFAULT_ENDPOINT, "silhouettes", "tcp://127.0.0.1:5551"),
        (DEFAULT_ENDPOINT, "poses", "tcp://127.0.0.1:5552"),
        ("tcp://[::1]:6000", "poses", "tcp://[::1]:6002"),
        ("tcp://coordinator:5550", "silhouettes", "tcp://coordinator:5551"),
        ("tcp://stage-2.lab_a.example:1", "tasks", "tcp://stage-2.lab_a.example:1"),
        ("tcp://*:5550", "tasks", "tcp://*:5550"),
        ("tcp://10.0.0.7:65533", "poses", "tcp://10.0.0.7:65535"),
    ],
)
def test_good_addresses(endpoint: str, stream: StreamName, expected: str) -> None:
    assert stream_endpoint(endpoint, stream) == expected


@pytest.mark.parametrize(
    "endpoint",
    [
        "", "5550", "localhost:5550", "tcp://", "tcp://127.0.0.1", "tcp://127.0.0.1:", "tcp://:5550",
        "tcp://127.0.0.1:0", "tcp://127.0.0.1:65534", "tcp://127.0.0.1:99999", "tcp://127.0.0.1:-1",
        "tcp://127.0.0.1:5550/", "tcp://127.0.0.1:5550/poses", "tcp://127.0.0.1:5550?x", "tcp://127.0.0.1:5550#x",
        "tcp://me@127.0.0.1:5550", "tcp://127.0.0.1 :5550", "tcp://::1:5550", "tcp://[::1:5550", "tcp://[::1]",
        "tcp://127.0.0.1:٥٥٥٠", "tcp://127.0.0.1:5550\n", "udp://127.0.0.1:5550", "ipc:///tmp/a", "inproc://a",
    ],
)  # fmt: skip
def test_bad_addresses_are_told_in_one_sentence(endpoint: str) -> None:
    with pytest.raises(ValueError, match=r"expected an address such as tcp://127\.0\.0\.1:5550") as refused:
        stream_endpoint(endpoint, "tasks")
    assert str(refused.value).startswith(f"{endpoint}: ")


def test_streams_listen_on_ports_in_a_row() -> None:
    assert sorted(stream.port_offset for stream in STREAMS.values()) == list(range(len(STREAMS)))


def test_the_streams_carry_all_messages_and_no_others() -> None:
    assert set().union(*map(carried_by, STREAMS.values())) == set(MESSAGES)
