"""Whether live sources are there, before a run starts; later they may come and go."""

import os
import socket
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from urllib.parse import urlsplit

from services.mocap.errors import UserError
from services.mocap.take.live import LiveTake
from services.segmentation.live.sources import check_file, place_of

_ANSWERS_S = 1.0
"""How long a network camera may take to accept a connection before a warning."""
_PORTS = {"rtsp": 554, "rtsps": 322, "http": 80, "https": 443}
_DEVICES = Path("/dev")


def check_sources(take: LiveTake, cameras: Sequence[int]) -> list[str]:
    """Warnings about network cameras among these that do not answer: a run tries to reach them until they do.

    Raises UserError for the first of these cameras whose file or device is missing, or whose address cannot
    be one.
    """
    addresses: list[tuple[str, str, str, int]] = []
    for c in cameras:
        source = take.sources[c]
        where = f"[cameras.{take.calibrated[c].name}] source: "
        if source.is_file:
            check_file(source, take.calibrated[c])
        elif isinstance(source.source, int):
            _check_device(_DEVICES / f"video{source.source}", where)
        else:
            addresses.append((where, source.source, *_host_and_port(source.source, where)))
    with ThreadPoolExecutor(max_workers=len(addresses) or 1) as pool:
        return [warning for warning in pool.map(lambda address: _silence(*address), addresses) if warning]


def _check_device(path: Path, where: str) -> None:
    """Raise UserError if a V4L2 device is missing, or this user may not open it."""
    if not path.exists():
        others = ", ".join(sorted(other.name.removeprefix("video") for other in path.parent.glob("video*")))
        raise UserError(
            f"{where}{path} is missing: connect the camera, or give the number of another device (this "
            f"machine has {others or 'none'})"
        )
    if not os.access(path, os.R_OK | os.W_OK):
        raise UserError(f"{where}{path} may not be opened: add your user to the group that owns it (video)")


def _host_and_port(address: str, where: str) -> tuple[str, int]:
    """The host and the port of a network address; raises UserError if it has none that can be."""
    try:
        parts = urlsplit(address)
        host, port = parts.hostname, parts.port or _PORTS[parts.scheme]
        if host is not None:
            host.encode("idna")  # as a connection does
            return host, port
    except ValueError:
        pass
    raise UserError(f"{where}{place_of(address)}: expected an address such as rtsp://HOST:PORT/PATH")


def _silence(where: str, address: str, host: str, port: int) -> str:
    """What to say if nobody accepts a TCP connection at a network address; empty if somebody does."""
    try:
        socket.create_connection((host, port), timeout=_ANSWERS_S).close()
    except OSError as problem:
        reason = (problem.strerror or str(problem)).lower()
        return (
            f"{where}{place_of(address)} does not answer: {reason} (host {host}, port {port}): connect and "
            "switch on the camera, or correct the address; until then xormocap goes on trying to reach it"
        )
    return ""
