"""The token that browsers must give beyond this machine."""

from pathlib import Path

import pytest

from services.address import Address
from services.mocap.errors import UserError
from services.viewer.__main__ import TOKEN_VARIABLE, token_of

_HERE, _EVERYWHERE = Address("127.0.0.1", 8080), Address("0.0.0.0", 8080)  # noqa: S104


def test_this_machine_needs_no_token(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(TOKEN_VARIABLE, raising=False)
    assert token_of(None, _HERE) is None


def test_beyond_it_one_is_asked_for_with_the_way_to_give_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(TOKEN_VARIABLE, raising=False)
    with pytest.raises(UserError, match=r"--token-file FILE or XORMOCAP_VIEWER_TOKEN.*127\.0\.0\.1:8080"):
        token_of(None, _EVERYWHERE)


def test_a_file_outweighs_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(TOKEN_VARIABLE, "from-the-environment")
    address = _EVERYWHERE
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
        token_of(file, _HERE)
