"""A real browser for measurements: chromium without a window, which draws by the processor if need be."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from services.mocap.errors import UserError

if TYPE_CHECKING:
    from playwright.sync_api import Browser

VARIABLE = "XORMOCAP_CHROMIUM"
FLAGS = (
    *("--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    *("--ignore-gpu-blocklist", "--disable-quic", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync"),
)


def chromium_path() -> str | None:
    """Where the browser is: as the environment says, or on the path; None: there is none."""
    return os.environ.get(VARIABLE) or shutil.which("chromium") or shutil.which("chromium-browser")


@contextmanager
def open_chromium() -> "Iterator[Browser]":
    """A browser that runs; raises UserError where there is none, or nothing to drive it with."""
    path = chromium_path()
    if path is None:
        raise UserError(f"there is no chromium: install it, or name it by {VARIABLE}")
    try:
        from playwright.sync_api import Error, sync_playwright
    except ImportError:
        raise UserError("there is no playwright, which drives the browser: run scripts/test once") from None
    with sync_playwright() as playwright:
        try:
            browser = playwright.chromium.launch(executable_path=path, args=list(FLAGS))
        except Error as error:
            why = error.message.splitlines()[0]
            raise UserError(
                f"{path}: does not start as chromium ({why}): name another by {VARIABLE}"
            ) from None
        try:
            yield browser
        finally:
            browser.close()
