"""Who may open the page: browsers on this machine, or those that give a token."""

import os
import re
from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from proto.streams import is_loopback
from services.address import LOOPBACK, Address
from services.mocap.errors import UserError

DEFAULT_ADDRESS = f"{LOOPBACK}:8080"
TOKEN_VARIABLE = "XORMOCAP_VIEWER_TOKEN"  # noqa: S105  (the variable's name)
SHORTEST_TOKEN = 8
TokenOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--token-file",
        help=f"A file with the token that browsers must give; {TOKEN_VARIABLE} may hold the token itself.",
    ),
]
_TOKEN = re.compile(r"[A-Za-z0-9_.~-]+", re.ASCII)


def token_of(file: Path | None, address: Address) -> str | None:
    """The token that browsers must give, from a file or the environment; None: none is required.

    Raises UserError for a token that is too short or that a URL cannot contain, and if an address beyond this
    machine has none.
    """
    token, where = os.environ.get(TOKEN_VARIABLE) or None, TOKEN_VARIABLE
    if file is not None:
        where = str(file)
        try:
            token = file.read_text(encoding="utf-8").strip()
        except (OSError, UnicodeDecodeError):
            raise UserError(f"{file}: cannot be read: expected the token that browsers must give") from None
    if token is None:
        if is_loopback(address.host):
            return None
        raise UserError(
            f"--bind {address.host}:{address.port}: everybody could open the page there: give a token that "
            f"browsers must give, by --token-file FILE or {TOKEN_VARIABLE}, or bind to {DEFAULT_ADDRESS}"
        )
    if len(token) < SHORTEST_TOKEN or _TOKEN.fullmatch(token) is None:
        raise UserError(
            f"{where}: expected a token of at least {SHORTEST_TOKEN} letters, digits and -._~, such as "
            "python3 -c 'import secrets; print(secrets.token_urlsafe())' makes"
        )
    return token
