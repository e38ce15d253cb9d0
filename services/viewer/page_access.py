"""The page's server, with a proxy before it where an address or a token asks for one."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from services.viewer.address import LOOPBACK, Address
from services.viewer.auth_proxy import AuthProxy
from services.viewer.server import PageServer


@contextmanager
def open_page(address: Address, token: str | None) -> Iterator[tuple[PageServer, str]]:
    """The server, and what to type into a browser on this machine.

    Without a token the page is served on this machine's loopback at once. Raises UserError where the port is
    taken or the address is not this machine's.
    """
    with ExitStack() as stack:
        if token is None:
            server = stack.enter_context(PageServer(address.port))
            yield server, f"http://{LOOPBACK}:{server.port}"
            return
        server = stack.enter_context(PageServer(0))
        proxy = stack.enter_context(AuthProxy(address, token, server.port))
        host = LOOPBACK if address.host in ("0.0.0.0", "::") else address.host  # noqa: S104  (read, not bound)
        yield server, f"http://{f'[{host}]' if ':' in host else host}:{proxy.port}/?token={token}"
