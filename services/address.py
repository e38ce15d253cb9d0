"""Where a service listens or sends: a host and a port."""

import re
from dataclasses import dataclass
from typing import Self

from services.mocap.errors import UserError

LOOPBACK = "127.0.0.1"
_ADDRESS = re.compile(r"(?P<host>\[[0-9A-Fa-f:.]+(%[\w.-]+)?\]|[\w.-]+):(?P<port>[0-9]{1,5})")
_LAST_PORT = 65535


@dataclass(frozen=True)
class Address:
    """A host's name or number, and a port; 0 for any that is free."""

    host: str
    port: int

    @classmethod
    def of(
        cls, text: str, option: str, expected: str, *, default_host: str | None = None, lowest_port: int = 1
    ) -> Self:
        """Parse HOST:PORT, [HOST]:PORT for IPv6, or, where there is a default host, PORT.

        Raises UserError, which names the option and what was expected, if the text is malformed.
        """
        is_port = default_host is not None and text.isdecimal()
        parts = _ADDRESS.fullmatch(f"{default_host}:{text}" if is_port else text)
        if parts is None or not lowest_port <= int(parts["port"]) <= _LAST_PORT:
            raise UserError(f"{option} {text}: expected {expected}")
        return cls(parts["host"].strip("[]"), int(parts["port"]))
