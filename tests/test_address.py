"""Where a service listens or sends."""

import pytest

from proto import streams
from services.address import Address
from services.mocap.errors import UserError


@pytest.mark.parametrize(
    ("text", "host", "port", "is_loopback"),
    [
        ("127.0.0.1:8080", "127.0.0.1", 8080, True),
        ("localhost:0", "localhost", 0, True),
        ("[::1]:80", "::1", 80, True),
        ("[fe80::1%eth0]:80", "fe80::1%eth0", 80, False),
        ("müller.local:80", "müller.local", 80, False),
        ("0.0.0.0:8080", "0.0.0.0", 8080, False),  # noqa: S104
        ("studio-2.local:65535", "studio-2.local", 65535, False),
    ],
)
def test_addresses(text: str, host: str, port: int, is_loopback: bool) -> None:
    address = Address.of(text, "--bind", "HOST:PORT", lowest_port=0)
    assert (address.host, address.port, streams.is_loopback(address.host)) == (host, port, is_loopback)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "8080",
        ":8080",
        "host",
        "host:",
        "host:0",
        "host:65536",
        "http://host:80",
        "a b:80",
        "a:1/b",
        "u@a:1",
    ],
)
def test_what_is_no_address_is_said(text: str) -> None:
    with pytest.raises(UserError) as problem:
        Address.of(text, "--vmc", "HOST:PORT, such as there:80")
    assert str(problem.value) == f"--vmc {text}: expected HOST:PORT, such as there:80"
