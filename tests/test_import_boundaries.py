"""The arrows of the design as a test: who may import whom, read from the source without running it."""

import ast
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SHARED = (
    *("services.process", "services.options", "services.health", "services.logs", "services.metrics"),
    *("services.listener", "services.follower", "services.blob_store", "services.pose_size"),
    "services.address",
)
"""What services share: the entry of all, and what those share that listen to a coordinator or follow it;
beside the services, not in one."""
NO_SERVICES = ("commands", "runs")
COMMAND = ("services.cli", "services.library", *(f"services.{folder}" for folder in NO_SERVICES))
"""The command starts the services and may use what they are made of."""
WORLDLY = {
    *("zmq", "socket", "socketserver", "ssl", "http", "urllib.request", "asyncio"),
    *("subprocess", "multiprocessing", "concurrent.futures.ProcessPoolExecutor", "signal"),
}
"""Sockets, processes and what acts on a whole process: not in the library."""


def imports_of(source: str, module: str, is_package: bool) -> set[str]:
    """The absolute names of all modules that a source text imports, wherever in it they stand."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            up = module.split(".")[: len(module.split(".")) - node.level + is_package] if node.level else []
            base = ".".join([*up, *([node.module] if node.module else [])])
            found.update(f"{base}.{alias.name}" for alias in node.names)
    return found


def read_modules(package: str) -> Iterator[tuple[str, set[str]]]:
    """The package's modules and what each imports."""
    for path in sorted((ROOT / package).rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        is_package = parts[-1] == "__init__"
        module = ".".join(parts[:-1] if is_package else parts)
        yield module, imports_of(path.read_text(encoding="utf-8"), module, is_package)


IMPORTS: dict[str, set[str]] = {**dict(read_modules("services")), **dict(read_modules("proto"))}
SERVICES = sorted(
    f"services.{folder.name}"
    for folder in (ROOT / "services").iterdir()
    if (folder / "__init__.py").is_file() and folder.name not in ("mocap", *NO_SERVICES)
)


def belongs(module: str, package: str) -> bool:
    return module == package or module.startswith(f"{package}.")


def breaches(importer: str, *imported: str) -> list[str]:
    """`a imports b` for every module of one package that imports one of some others."""
    return [
        f"{module} imports {target}"
        for module, targets in IMPORTS.items()
        if belongs(module, importer)
        for target in sorted(targets)
        if any(belongs(target, package) for package in imported)
    ]


def test_reading_imports() -> None:
    source = """
import zmq.utils, numpy as np
from proto import sockets
from proto.sockets import bind as b
from . import sibling
from ..body.actor import Actor
def late():
    import socket
"""
    common = {"zmq.utils", "numpy", "proto.sockets", "proto.sockets.bind", "socket"}
    relative = {"services.mocap.camera.sibling", "services.mocap.body.actor.Actor"}
    assert imports_of(source, "services.mocap.camera.rig", False) == common | relative
    assert imports_of(source, "services.mocap.camera", True) == common | relative


def test_there_is_something_to_hold() -> None:
    assert {"services.coordinator", "services.limb_worker", "services.recorder"} <= set(SERVICES)
    assert {*SHARED, *COMMAND, "services.mocap.search.frame", "proto.messages"} <= set(IMPORTS)


def test_the_library_imports_no_service_and_no_protocol() -> None:
    assert breaches("services.mocap", "proto") == []
    others = [module for module in IMPORTS if not belongs(module, "services.mocap") and module != "services"]
    assert breaches("services.mocap", *others) == []


def test_the_protocol_imports_no_service() -> None:
    assert breaches("proto", "services") == []


@pytest.mark.parametrize("service", SERVICES)
def test_no_service_imports_another_one_or_the_command(service: str) -> None:
    others = [other for other in SERVICES if other != service]
    assert breaches(service, *others, *COMMAND) == []


@pytest.mark.parametrize("service", SERVICES)
def test_a_service_imports_the_library_the_protocol_and_what_is_shared(service: str) -> None:
    allowed = (service, "services.mocap", *SHARED)
    for module, targets in IMPORTS.items():
        if belongs(module, service):
            ours = {target for target in targets if belongs(target, "services")}
            assert {target for target in ours if not any(belongs(target, a) for a in allowed)} == set(), (
                module
            )


@pytest.mark.parametrize("shared", SHARED)
def test_what_is_shared_imports_no_service(shared: str) -> None:
    assert breaches(shared, *SERVICES, *COMMAND) == []


@pytest.mark.parametrize("outside", sorted(WORLDLY))
def test_the_library_opens_no_socket_and_starts_no_process(outside: str) -> None:
    assert breaches("services.mocap", outside) == []


def test_the_live_page_stays_in_the_viewer() -> None:
    assert [b for b in breaches("services", "viser") if not b.startswith("services.viewer")] == []


def part_of_library(module: str) -> str | None:
    """services.mocap.<part>, for its modules and whatever is in them."""
    return ".".join(module.split(".")[:3]) if module.startswith("services.mocap.") else None


def test_parts_of_the_library_depend_on_each_other_one_way() -> None:
    """No part of services.mocap needs, even by way of others, a part that needs it."""
    needs: dict[str, set[str]] = {}
    for module, targets in IMPORTS.items():
        if part := part_of_library(module):
            needs.setdefault(part, set()).update(
                other for target in targets if (other := part_of_library(target)) and other != part
            )
    try:
        TopologicalSorter(needs).prepare()
    except CycleError as error:
        links = list(zip(error.args[1][1:], error.args[1], strict=False))  # each part needs the one before it
        lines = [line for importer, imported in links for line in breaches(importer, imported)]
        pytest.fail("these imports go round in a circle:\n" + "\n".join(lines), pytrace=False)
