"""Options that several services and commands take, and what they stand for."""

from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from proto.keys import ClientKeys, client_keys
from services.mocap.body.skeleton import BodyName
from services.mocap.energy.settings import MOST_THREADS, Choice, EngineSettings
from services.mocap.errors import UserError, validated
from services.mocap.motion.settings import OutputSettings, Smoother
from services.mocap.search.overrides import as_assignments
from services.mocap.search.settings import Preset, SearchSettings
from services.mocap.take.segmenter_name import AUTO, meanings

DEFAULT_ENGINE = EngineSettings()
DEFAULT_OUTPUT = OutputSettings()
BackendOption: TypeAlias = Annotated[
    Choice,
    typer.Option(envvar="XORMOCAP_BACKEND", help="Energy backend; auto: gl on a GPU with OpenGL, else cpu."),
]
ThreadsOption: TypeAlias = Annotated[
    int,
    typer.Option(
        min=0,
        max=MOST_THREADS,
        envvar="XORMOCAP_THREADS",
        help="Threads of the cpu backend in each process that evaluates the energy; 0: one per core.",
    ),
]
SearchOption: TypeAlias = Annotated[
    Preset,
    typer.Option(
        "--search",
        help="default: aligns the body with contours, doubtful limbs by XOR; paper: passes of torso, limbs "
        "and head by XOR, as published; plain: the same without windows, pre-rendering and thinned meshes.",
    ),
]
BodyOption: TypeAlias = Annotated[
    BodyName | None,
    typer.Option(
        "--body",
        help="anatomical: the waist bends, leans and turns; paper: the trunk is rigid, as published. "
        "Default: paper with --search paper or plain, else anatomical.",
    ),
]
SetOption: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="A search setting, such as detail_px=0; may be repeated. services/mocap/README.md lists them.",
    ),
]
SettingsOption: TypeAlias = Annotated[
    Path | None,
    typer.Option("--settings", metavar="FILE", help="A TOML file with search settings; --set overrides it."),
]
FramesOption: TypeAlias = Annotated[
    str, typer.Option(help="Range of frames A:B, from A up to but not including B.")
]
WorkersOption: TypeAlias = Annotated[
    int, typer.Option(min=0, max=64, help="Number of limb worker processes.")
]
FittedOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(help="A folder written by xormocap fit, used instead of the take's actor and poses."),
]
SmoothOption: TypeAlias = Annotated[
    Smoother,
    typer.Option(
        help="Smoothing of joints.csv and motion.*: rts looks forward and back, one-euro only back; "
        "poses.csv is never smoothed."
    ),
]
CutoffOption: TypeAlias = Annotated[
    float | None,
    typer.Option(
        metavar="HZ", help="Cutoff frequency of the smoothing, in hertz; default: rts finds it, one-euro 4."
    ),
]
DEFAULT_SEGMENTER = AUTO
SegmenterOption: TypeAlias = Annotated[
    str,
    typer.Option(
        "--segmenter",
        envvar="XORMOCAP_SEGMENTER",
        metavar="NAME",
        help=" ".join(f"{' or '.join(names)}: {meaning};" for names, meaning in meanings().items())
        + " or a plug-in's name.",
    ),
]


def output_settings(smooth: Smoother, cutoff_hz: float | None) -> OutputSettings:
    """The two options as settings; raises UserError if they are invalid."""
    fields = {"smooth": smooth, "cutoff_hz": cutoff_hz}
    return validated(OutputSettings, fields, "options of smoothing: ", UserError)


def output_arguments(settings: OutputSettings) -> tuple[str, ...]:
    """The two options as arguments for another process."""
    cutoff = () if settings.cutoff_hz is None else ("--cutoff-hz", str(settings.cutoff_hz))
    return ("--smooth", settings.smooth, *cutoff)


KEYS_VARIABLE, METRICS_VARIABLE = "XORMOCAP_KEYS", "XORMOCAP_METRICS"
KeysOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--keys",
        metavar="DIR",
        envvar=KEYS_VARIABLE,
        help="Folder with this service's keys, made by xormocap keys; needed between machines.",
    ),
]


MetricsOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--metrics",
        metavar="[HOST:]PORT",
        envvar=METRICS_VARIABLE,
        help="Serve Prometheus metrics there, on loopback unless a host is given; off by default.",
    ),
]


NiceOption: TypeAlias = Annotated[
    int, typer.Option("--nice", min=0, max=19, help="Lower the priority by this much (niceness).")
]


def engine_settings(backend: Choice, threads: int) -> EngineSettings:
    """The two options as settings; raises UserError if they are invalid."""
    fields = {"backend": backend, "threads": threads}
    return validated(EngineSettings, fields, "options of the energy: ", UserError)


def engine_arguments(settings: EngineSettings) -> tuple[str, ...]:
    """The two options as arguments for another process."""
    return tuple(word for name, value in settings.model_dump().items() for word in (f"--{name}", str(value)))


def search_arguments(settings: SearchSettings) -> tuple[str, ...]:
    """The options --set as arguments for another process."""
    return tuple(word for assignment in as_assignments(settings) for word in ("--set", assignment))


def keys_of_client(folder: Path | None, role: str) -> ClientKeys | None:
    """The keys of the option --keys, for a client; raises KeysError if there are none."""
    return None if folder is None else client_keys(folder, role)
