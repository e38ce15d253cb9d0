"""Where the page is, and the token that it wants beyond this machine."""

from pathlib import Path

import pytest

from proto import streams
from services.mocap.errors import UserError
from services.viewer.address import TOKEN_VARIABLE, Address, token_of


@pytest.mark.parametrize(
    ("text", "host", "port", "is_loopback"),
    [
        ("127.0.0.1:8080", "127.0.0.1", 8080, True),
        ("localhost:0", "localhost", 0, True),
        ("[::1]:80", "::1", 80, True),
        ("0.0.0.0:8080", "0.0.0.0", 8080, False),  # noqa: S104
        ("studio-2.local:65535", "studio-2.local", 65535, False),
    ],
)
def test_addresses(text: str, host: str, port: int, is_loopback: bool) -> None:
    address = Address.of(text)
    assert (address.host, address.port, streams.is_loopback(address.host)) == (host, port, is_loopback)


@pytest.mark.parametrize("text", ["8080", ":8080", "host", "host:", "host:65536", "http://host:80", "a b:80"])
def test_what_is_no_address_is_said(text: str) -> None:
    with pytest.raises(UserError, match="expected HOST:PORT"):
        Address.of(text)


def test_this_machine_needs_no_token(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(TOKEN_VARIABLE, raising=False)
    assert token_of(None, Address.of("127.0.0.1:8080")) is None


def test_beyond_it_one_is_asked_for_with_the_way_to_give_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(TOKEN_VARIABLE, raising=False)
    with pytest.raises(UserError, match=r"--token-file FILE or XORMOCAP_VIEWER_TOKEN.*127\.0\.0\.1:8080"):
        token_of(None, Address.of("0.0.0.0:8080"))


def test_a_file_outweighs_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(TOKEN_VARIABLE, "from-the-environment")
    address = Address.of("0.0.0.0:8080")
    assert token_of(None, address) == "from-the-environment"
    file = tmp_path / "token"
    file.write_text("from-a-file\n")
    assert token_of(file, address) == "from-a-file"
    with pytest.raises(UserError, match="cannot be read"):
        token_of(tmp_path / "missing", address)


@pytest.mark.parametrize("token", ["short", "with a space", "with/slash/es", "ümläuted"])
def test_bad_tokens_are_refused(token: str, tmp_path: Path) -> None:
    file = tmp_path / "token"
    file.write_text(token)
    with pytest.raises(UserError, match="at least 8 letters"):
        token_of(file, Address.of("127.0.0.1:8080"))
