"""Options that several services and commands take, and what they stand for."""

from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from proto.keys import ClientKeys, client_keys
from services.mocap.energy.settings import MOST_THREADS, Choice, EngineSettings
from services.mocap.errors import UserError, validated
from services.mocap.motion.settings import OutputSettings, Smoother
from services.mocap.search.overrides import as_assignments
from services.mocap.search.settings import Preset, SearchSettings

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


def keys_of_client(folder: Path | None, role: str) -> ClientKeys | None:
    """What the option --keys leads to, for a client; raises KeysError where there are none."""
    return None if folder is None else client_keys(folder, role)
