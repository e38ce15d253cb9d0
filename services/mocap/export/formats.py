"""The table of export formats.

To add one, add its name to `FormatName`, a row to `FORMATS`, and the names of its files to result/layout.py
and to `KNOWN` there: a run does not write into a folder with files that it does not know.
"""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Literal, TypeAlias

from services.mocap.body.humanoid_names import Naming
from services.mocap.errors import UserError
from services.mocap.export.bvh import write_bvh
from services.mocap.export.glb import write_glb
from services.mocap.export.marker_files import write_c3d, write_trc
from services.mocap.export.overlay import write_overlay
from services.mocap.motion.motion import Rest
from services.mocap.result.layout import (
    ANGLES,
    ANGLES_PARQUET,
    BVH,
    C3D,
    GLB,
    JOINTS_PARQUET,
    OVERLAY,
    POSES_PARQUET,
    REPORT,
    TRC,
)
from services.mocap.result.result import Result, open_take_of
from services.mocap.take.csv_columns import as_cells, frame_cells, write_columns
from services.mocap.verdict.judging import verdict_of

log = logging.getLogger(__name__)

FormatName: TypeAlias = Literal["bvh", "glb", "trc", "c3d", "angles", "report", "parquet", "overlay"]


@dataclass(frozen=True)
class Options:
    """Options of some formats."""

    naming: Naming = "xormocap"
    unit: Literal["m", "cm"] = "m"
    rest: Rest = "T"
    """These three are write_bvh's."""
    take: Path | None = None
    """The take folder whose pictures overlay draws on; None: the one that was tracked."""


@dataclass(frozen=True)
class Format:
    """One kind of export."""

    files: tuple[str, ...]
    write: Callable[[Path, Result, Options], None]
    """Writes them into a folder, each completely or not at all; raises UserError."""
    by_default: bool = True
    """Whether every run writes them by default."""
    needs: tuple[str, ...] = ()
    """Optional packages: extras of pyproject.toml."""

    @property
    def missing(self) -> list[str]:
        """The required packages that are not installed."""
        return [package for package in self.needs if find_spec(package) is None]


def _bvh(folder: Path, result: Result, options: Options) -> None:
    motion = result.motion
    write_bvh(
        folder / BVH,
        motion.poses,
        motion.body.offsets_m,
        motion.fps,
        unit=options.unit,
        rest=options.rest,
        naming=options.naming,
    )


def _angles(folder: Path, result: Result, _: Options) -> None:
    """angles.csv: frame, time_s and every anatomical angle in degrees."""
    columns = frame_cells(result.frames, "time_s", result.times_s)
    for name, angles_deg in result.angles_deg.items():
        columns[f"{name}_deg"] = as_cells(name, angles_deg, ".4f")
    write_columns(folder / ANGLES, columns)


def _overlay(folder: Path, result: Result, options: Options) -> None:
    """Of the poses as they were tracked."""
    tracked = options.take or result.take_folder
    if tracked is None:
        raise UserError(f"{result.folder}: does not name its take: add --take FOLDER")
    if options.take is None and "live" in result.run:
        raise UserError(f"{result.folder}: is of live cameras: add --take with the folder of their recording")
    if options.take is None and not tracked.is_dir():
        raise UserError(f"{result.folder}: its take is not at {tracked} any more: add --take FOLDER")
    take = open_take_of(result, tracked)
    last = int(result.tracked.frames_shown[-1])
    if last >= take.settings.frames:
        raise UserError(
            f"{tracked}: has {take.settings.frames} frames, but the result extends to frame {last}: expected "
            "the take that was tracked"
        )
    body, verdict = result.motion.body, verdict_of(result)
    write_overlay(folder / OVERLAY, take, body, result.tracked, result.fps, verdict, hurry=lambda: False)


def _report(folder: Path, result: Result, _: Options) -> None:
    # Matplotlib may be missing, and takes a second.
    from services.mocap.export.page.html_report import write_report

    write_report(folder / REPORT, result)


def _parquet(folder: Path, result: Result, _: Options) -> None:
    from services.mocap.export.parquet import write_parquet  # pyarrow may be missing

    write_parquet(folder, result)


FORMATS: dict[FormatName, Format] = {
    "bvh": Format((BVH,), _bvh),
    "glb": Format((GLB,), lambda folder, result, _: write_glb(folder / GLB, result.motion)),
    "trc": Format((TRC,), lambda folder, result, _: write_trc(folder / TRC, result.motion)),
    "c3d": Format((C3D,), lambda folder, result, _: write_c3d(folder / C3D, result.motion)),
    "angles": Format((ANGLES,), _angles),
    "report": Format((REPORT,), _report, needs=("jinja2", "matplotlib")),
    "parquet": Format(
        (POSES_PARQUET, JOINTS_PARQUET, ANGLES_PARQUET), _parquet, by_default=False, needs=("pyarrow",)
    ),
    "overlay": Format((OVERLAY,), _overlay, by_default=False),  # runs draw it themselves, if it is wanted
}
DEFAULT_FORMATS: tuple[FormatName, ...] = tuple(name for name, form in FORMATS.items() if form.by_default)


def write_formats(
    folder: Path, result: Result, names: tuple[FormatName, ...], options: Options | None = None
) -> list[Path]:
    """Export a result into a folder; returns the files. Raises UserError for what cannot be written."""
    written = []
    for name in names:
        if missing := FORMATS[name].missing:
            raise UserError(
                f"{name}: needs {' and '.join(missing)}, which is not installed: "
                f"pip install {' '.join(missing)}"
            )
        FORMATS[name].write(folder, result, options or Options())
        written += [folder / file for file in FORMATS[name].files]
    return written


def write_defaults(
    folder: Path, result: Result, names: Sequence[FormatName], warn: Callable[[str], object]
) -> None:
    """Export the formats of a run; a format that cannot be written causes a warning, not an error."""
    for name in names:
        if missing := FORMATS[name].missing:
            file, packages = FORMATS[name].files[0], " and ".join(missing)
            warn(f"{file} is left out without {packages}: xormocap export --to {name} makes it")
            continue
        try:
            write_formats(folder, result, (name,))
        except UserError as error:
            warn(str(error))
        except Exception as error:
            log.exception("%s cannot be written", name)
            warn(f"{FORMATS[name].files[0]} is left out because of an error: {error}")
