"""A synthetic take that all integration tests track, and the `xormocap` command as a user runs it."""

import io
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import closing, redirect_stderr, redirect_stdout
from pathlib import Path

import pytest
from busy import BUSY
from lasting_servers import LastingServers
from one_process import tracked_here

from exact_take import in_place_of_videos
from first_pose import say_first_pose
from known_actor import write_take_of_known_actor
from services.cli import main
from services.mocap.search.settings import SearchSettings
from services.runs.fork_server import ForkServer

Command = Callable[..., "subprocess.CompletedProcess[str]"]
FRAMES = "14:20"
"""The actor is under way by then."""


@pytest.fixture(scope="session")
def lasting_servers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LastingServers]:
    with closing(LastingServers(tmp_path_factory.mktemp("servers"))) as servers:
        yield servers


@pytest.fixture(scope="module", autouse=True)
def shared_imports(lasting_servers: LastingServers) -> Iterator[None]:
    """Runs in this process share what has imported the services; those of commands that are processes do
    not. Not for the session: other folders' tests may follow in this process."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("services.runs.launcher.ForkServer", lasting_servers)
        yield


@pytest.fixture
def own_imports(monkeypatch: pytest.MonkeyPatch) -> None:
    """A run that imports the services itself, as any outside of tests, and ends what has imported them."""
    monkeypatch.setattr("services.runs.launcher.ForkServer", ForkServer)


@pytest.fixture(scope="session")
def synthetic_take(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its actor.toml holds the very body that it shows, so that nothing is fitted before it is tracked."""
    folder = tmp_path_factory.mktemp("synthetic") / "walk"
    write_take_of_known_actor(folder, n_frames=24, n_cameras=5)
    return folder


@pytest.fixture(scope="session")
def known_take(synthetic_take: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same with its first pose said, so that its first frame takes no longer than another."""
    folder = tmp_path_factory.mktemp("known") / "walk"
    shutil.copytree(synthetic_take, folder)
    say_first_pose(folder)
    return folder


@pytest.fixture(scope="session")
def exact_take(known_take: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same with exact silhouettes in place of videos, whose background takes seconds to learn."""
    folder = tmp_path_factory.mktemp("exact") / "walk"
    shutil.copytree(known_take, folder, ignore=shutil.ignore_patterns("videos", "background"))
    in_place_of_videos(folder)
    return folder


@pytest.fixture(scope="session")
def xormocap() -> Command:
    """`xormocap(*arguments)` runs the command to its end, in this process: importing it takes seconds.

    The services that it starts are processes of their own, as ever.
    """

    def run(*arguments: object) -> "subprocess.CompletedProcess[str]":
        out, err, at_sigterm = io.StringIO(), io.StringIO(), signal.getsignal(signal.SIGTERM)
        with pytest.MonkeyPatch.context() as patched, redirect_stdout(out), redirect_stderr(err):
            patched.setattr(sys, "argv", ["xormocap", *map(str, arguments)])
            with pytest.raises(SystemExit) as ended:
                main()
        signal.signal(signal.SIGTERM, at_sigterm)
        return subprocess.CompletedProcess(arguments, ended.value.code or 0, out.getvalue(), err.getvalue())

    return run


@pytest.fixture(scope="session")
def refused(xormocap: Command) -> Callable[..., str]:
    """`refused(*arguments)`: what the command prints when it refuses them as a user's error."""

    def run(*arguments: object) -> str:
        done = xormocap(*arguments)
        assert done.returncode == 2, done.stderr
        return done.stderr.strip()

    return run


@pytest.fixture
def no_report(monkeypatch: pytest.MonkeyPatch) -> None:
    """No report, which takes seconds and is written once all processes have ended."""
    monkeypatch.setattr("services.runs.track.write_defaults", lambda *_: None)


@pytest.fixture(scope="session")
def tracked(synthetic_take: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of an undisturbed run both ways with four limb workers, by a command that is a process."""
    out = tmp_path_factory.mktemp("tracked") / "result"
    command = [sys.executable, "-m", "services.cli", "track", synthetic_take, "--out", out]
    done = subprocess.run(
        [*command, "--frames", FRAMES, *BUSY], capture_output=True, text=True, timeout=240, check=False
    )
    assert done.returncode == 0, done.stderr
    return out


@pytest.fixture(scope="session")
def one_way(synthetic_take: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of the same frames tracked only forwards, in this process: services find the same."""
    search = SearchSettings(search_limbs="always", both_ways=False)
    return tracked_here(synthetic_take, tmp_path_factory.mktemp("one-way") / "result", FRAMES, search)
