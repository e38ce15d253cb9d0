"""What every service process needs: logging, an orderly stop, and errors told as one sentence."""

import logging
import os
import signal
import socket
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Annotated, TypeAlias

import typer

from proto.keys import ClientKeys, KeysError, client_keys
from proto.streams import AddressError
from services import logs
from services.health import answering
from services.logs import about as about
from services.metrics import DROPPED as DROPPED
from services.metrics import TIME_BUCKETS_S as TIME_BUCKETS_S
from services.metrics import offering
from services.mocap.energy.settings import MOST_THREADS, Choice, EngineSettings
from services.mocap.errors import UserError, validated
from services.mocap.motion.settings import OutputSettings, Smoother
from services.mocap.search.overrides import as_assignments
from services.mocap.search.settings import Preset, SearchSettings
from services.process_priority import give_way as give_way

PARENT_VARIABLE = "XORMOCAP_PARENT"
"""Process id of a launcher; a service whose parent is no longer that one stops, so that none is orphaned."""

EXIT_USER_ERROR = 2
EXIT_STOPPED = 143
"""A service that was asked to stop, and did so in order; 0 means that its work was done."""


DEFAULT_ENGINE = EngineSettings()
DEFAULT_OUTPUT = OutputSettings()
BackendOption: TypeAlias = Annotated[
    Choice,
    typer.Option(
        envvar="XORMOCAP_BACKEND",
        help="What evaluates the energy; auto: gl on a GPU that does OpenGL, else cpu.",
    ),
]
ThreadsOption: TypeAlias = Annotated[
    int,
    typer.Option(
        min=0,
        max=MOST_THREADS,
        envvar="XORMOCAP_THREADS",
        help="Threads of the cpu backend in each process that evaluates; 0: one per core.",
    ),
]
SearchOption: TypeAlias = Annotated[
    Preset,
    typer.Option(
        "--search",
        help="default: the whole body by its contours, limbs in doubt by XOR; paper: passes of torso, limbs "
        "and head by XOR, as published; plain: the same without windows, pre-rendering and thinned meshes.",
    ),
]
SetOption: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="Change a setting of the search, such as detail_px=0; may be repeated. The README lists them.",
    ),
]
SettingsOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--settings", metavar="FILE", help="A TOML file with settings of the search; --set outweighs it."
    ),
]
SmoothOption: TypeAlias = Annotated[
    Smoother,
    typer.Option(
        help="Smooth joints.csv and motion.*: rts looks both ways, one-euro back only, as live; "
        "poses.csv stays as it was tracked.",
    ),
]
CutoffOption: TypeAlias = Annotated[
    float | None,
    typer.Option(
        metavar="HZ", help="How fast a motion smoothing lets by, in hertz; --smooth chooses by default."
    ),
]
DEFAULT_SEGMENTER = "auto"
SegmenterOption: TypeAlias = Annotated[
    str,
    typer.Option(
        "--segmenter",
        envvar="XORMOCAP_SEGMENTER",
        metavar="NAME",
        help="What makes silhouettes: clean-plate, mog2, bgsegm, chroma or chroma:RRGGBB, onnx:FILE, "
        "silhouettes (the take's own) or a plug-in's name; auto: silhouettes if the take has some, else "
        "clean-plate.",
    ),
]


def output_settings(smooth: Smoother, cutoff_hz: float | None) -> OutputSettings:
    """What the two options say; raises UserError where that cannot be."""
    fields = {"smooth": smooth, "cutoff_hz": cutoff_hz}
    return validated(OutputSettings, fields, "options of smoothing: ", UserError)


def output_arguments(settings: OutputSettings) -> tuple[str, ...]:
    """The two options for another process."""
    cutoff = () if settings.cutoff_hz is None else ("--cutoff-hz", str(settings.cutoff_hz))
    return ("--smooth", settings.smooth, *cutoff)


KEYS_VARIABLE, METRICS_VARIABLE = "XORMOCAP_KEYS", "XORMOCAP_METRICS"
KeysOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--keys",
        metavar="DIR",
        envvar=KEYS_VARIABLE,
        help="The folder with this service's keys, made by xormocap keys; needed beyond this machine.",
    ),
]


MetricsOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--metrics",
        metavar="[HOST:]PORT",
        envvar=METRICS_VARIABLE,
        help="Answer Prometheus there, on loopback unless a host is given; off by default.",
    ),
]


NiceOption: TypeAlias = Annotated[
    int,
    typer.Option("--nice", min=0, max=19, help="How far others go first that want the same core."),
]


def engine_settings(backend: Choice, threads: int) -> EngineSettings:
    """What the two options say; raises UserError where that cannot be."""
    fields = {"backend": backend, "threads": threads}
    return validated(EngineSettings, fields, "options of the energy: ", UserError)


def engine_arguments(settings: EngineSettings) -> tuple[str, ...]:
    """The two options for another process."""
    return tuple(word for name, value in settings.model_dump().items() for word in (f"--{name}", str(value)))


def search_arguments(settings: SearchSettings) -> tuple[str, ...]:
    """The options --set for another process."""
    return tuple(word for assignment in as_assignments(settings) for word in ("--set", assignment))


class StopRequest:
    """True once the process was asked to stop, by SIGINT, SIGTERM or the end of its launcher."""

    def __init__(self) -> None:
        self.count = 0
        """Signals so far; whoever asks twice wants it at once."""
        self.looked_s: float | None = None
        """When the service last looked (time.monotonic), as its loop does in every round."""
        self._parent = int(os.environ.get(PARENT_VARIABLE, "0"))
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._ask)

    def _ask(self, number: int, frame: FrameType | None) -> None:  # noqa: ARG002  (the signature of handlers)
        self.count += 1

    def __bool__(self) -> bool:
        self.looked_s = time.monotonic()
        return self.count > 0 or (self._parent != 0 and os.getppid() != self._parent)


def keys_of_client(folder: Path | None, role: str) -> ClientKeys | None:
    """What the option --keys leads to, for a client; raises KeysError where there are none."""
    return None if folder is None else client_keys(folder, role)


def on_hangup(act: Callable[[], None]) -> None:
    """Call a function at every SIGHUP, from a signal handler: it must be short."""
    signal.signal(signal.SIGHUP, lambda *_: act())


def client_name(role: str) -> str:
    """A name that no other process has: role, host and process id."""
    return f"{role}@{socket.gethostname()}:{os.getpid()}"


def run_service(name: str, main: Callable[[StopRequest], None], metrics: str | None = None) -> None:
    """Run a service's main function as this process, then exit. metrics: what --metrics says.

    The exit code is 0 when its work is done, EXIT_STOPPED after a stop, 2 for an error of the user's, else 1.
    The last line of the log says in one sentence what an error was.
    """
    stop = StopRequest()
    logs.begin(name)
    try:
        with answering(name, lambda: stop.looked_s), offering(metrics):
            main(stop)
    except (UserError, AddressError, KeysError) as error:
        print(error, file=sys.stderr)  # noqa: T201  (the one sentence that a launcher shows)
        sys.exit(EXIT_USER_ERROR)
    except Exception as error:
        logging.exception("unexpected error")
        print(f"{type(error).__name__}: {next(iter(str(error).splitlines()), '')}", file=sys.stderr)  # noqa: T201
        sys.exit(1)
    sys.exit(EXIT_STOPPED if stop else 0)
