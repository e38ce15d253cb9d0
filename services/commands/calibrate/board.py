"""Calibration with a board, for the command: the board's options, the progress bar, the table, the files."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.markup import escape
from rich.table import Table

from services.commands.calibrate.points import in_world_of
from services.commands.consoles import progress_bar, say, stdout, table_of, warn
from services.mocap.atomic import write_file
from services.mocap.calibration.board import Board, drawn
from services.mocap.calibration.clips import ORIGIN, find_clips
from services.mocap.calibration.coverage import covered_share, draw_coverage
from services.mocap.calibration.from_clips import calibrate_clips, check_clips
from services.mocap.calibration.known_lenses import known_lenses
from services.mocap.calibration.lens import Lens
from services.mocap.calibration.placing import read_points
from services.mocap.calibration.remarks import remarks_on, remarks_on_views
from services.mocap.calibration.rig_solving import Solution
from services.mocap.camera.calibration import Up, write_calibration
from services.mocap.errors import CalibrationError, UserError, load_toml, validated
from services.mocap.take.writer import write_picture

BOARD_FILE = "board.toml"
_PRINT_DOTS_PER_M = 300 / 0.0254
_LARGEST_PRINT_PX = 20000


def calibrate_by_board(
    clips: Path,
    said: dict[str, Any],
    lens: Lens,
    out: Path,
    up: Up,
    lens_file: Path | None = None,
    level: str | None = None,
    points_file: Path | None = None,
) -> None:
    """Calibrate a folder of clips, write the calibration and, beside it, its coverage and its record.

    said: the options about the board (see board_of). lens_file: a calibration whose lenses are held.
    level: the camera whose pictures are level, if there is no picture of the origin. points_file: measured
    points of the scene, whose world is taken. Raises UserError.
    """
    if not clips.is_dir():
        raise CalibrationError(
            f"{clips}: is not a folder: expected a folder with a clip <camera>.mp4 for each camera"
        )
    coverage, record = coverage_path(out), out.with_suffix(".json")
    if record == out:
        raise UserError(f"--out {out}: is the name of the record beside it: expected one that ends in .toml")
    board = board_of(said, clips)
    before = check_clips(clips, level, needs_origin=points_file is None)
    warn(before)
    names = [clip.camera for clip in find_clips(clips)]
    known = known_lenses(lens_file, names) if lens_file else None
    points = read_points(points_file, names) if points_file else None
    with progress_bar() as show:
        solution, remarks = calibrate_clips(
            clips, board, lens, show, known, level, needs_origin=points is None
        )
        show("calibrated", 1.0)
    if points is not None:
        cameras, more = in_world_of(solution.cameras, points)
        solution, remarks = replace(solution, cameras=cameras), remarks + more
    is_floor_known = points is not None or bool(find_clips(clips / ORIGIN))
    remarks += [
        *remarks_on_views(solution),
        *remarks_on(solution.cameras, is_floor_known=is_floor_known),
    ]
    write_calibration(out, solution.cameras, up)
    write_picture(coverage, draw_coverage(solution))
    _write_record(record, solution, board, [*before, *remarks])
    warn(remarks)
    stdout.print(_table(solution, is_floor_known=is_floor_known))
    say(f"{out}; look at {coverage}")


def coverage_path(calibration: Path) -> Path:
    """The picture beside a calibration: coverage.png of calibration.toml, left-coverage.png of left.toml."""
    prefix = "" if calibration.stem == "calibration" else f"{calibration.stem}-"
    return calibration.with_name(f"{prefix}coverage.png")


def board_of(said: dict[str, Any], clips: Path | None) -> Board:
    """The board of the folder's board.toml and the command line, which overrides it.

    said: fields of Board, and squares or markers ("7x10") for columns and rows; None for options that were
    not given.
    """
    path = None if clips is None else clips / BOARD_FILE
    fields = load_toml(path, CalibrationError) if path is not None and path.exists() else {}
    where = "board: " if not fields else f"{path}: "
    fields |= {name: value for name, value in said.items() if value is not None}
    squares, markers = fields.pop("squares", None), fields.pop("markers", None)
    if markers is not None:
        fields.setdefault("kind", "aruco")
    is_sheet = fields.get("kind") == "aruco"
    option, size = ("--markers", markers) if is_sheet else ("--squares", squares)
    other, unfit = ("--squares", squares) if is_sheet else ("--markers", markers)
    if unfit is not None:
        what = "a sheet of ArUco markers" if is_sheet else f"a {fields.get('kind', 'charuco')} board"
        raise UserError(f"{other} {unfit}: {what} is described by {option} CxR")
    if size is not None:
        columns, cross, rows = str(size).lower().partition("x")
        if not (cross and columns.isdecimal() and rows.isdecimal()):
            what = "markers" if is_sheet else "squares"
            raise UserError(f"{option} {size}: expected {what} in a row and rows, such as 7x10")
        fields |= {"columns": int(columns), "rows": int(rows)}
    _check_complete(fields, is_sheet)
    return validated(Board, fields, where, CalibrationError)


def _check_complete(fields: dict[str, Any], is_sheet: bool) -> None:
    """Raise UserError if a board's size is not known."""
    lengths = ("marker_m", "gap_m") if is_sheet else ("square_m",)
    if {"columns", "rows", *lengths} <= fields.keys():
        return
    options = (
        "--markers CxR (markers in a row and rows), --marker METRES and --gap METRES"
        if is_sheet
        else "--squares CxR (squares in a row and rows, not the corners between them) and --square METRES"
    )
    raise UserError(
        f"board: expected {options}, or a file {BOARD_FILE} with columns, rows and {' and '.join(lengths)} "
        "among the clips"
    )


def draw_board(path: Path, said: dict[str, Any], clips: Path | None) -> None:
    """Write the board as a PNG of 300 dots per inch."""
    board = board_of(said, clips)
    pitch_px = round(board.pitch_m * _PRINT_DOTS_PER_M)
    pitch_px = min(pitch_px, _LARGEST_PRINT_PX // (max(board.columns, board.rows) + 1))
    write_picture(path, drawn(board, pitch_px))
    what, side_m = ("square", board.pitch_m) if board.square_m else ("marker", board.marker_side_m)
    measured = "squares" if board.square_m else "markers and the gaps between them"
    say(
        f"{path}: print it so that a {what} is {1e3 * side_m:g} mm wide, glue it on something flat, and "
        f"measure the {measured}: all lengths are derived from them"
    )


def _table(solution: Solution, *, is_floor_known: bool) -> Table:
    """A row for each camera; is_floor_known: whether the world has a floor and an origin on it."""
    titles = ("pixels", "focal, px", "error, px", "RMS an axis", "views", "left out", "covered")
    table = table_of("camera", *titles, "from origin, m", "height, m")
    for c, camera in enumerate(solution.cameras):
        x_m, y_m, z_m = camera.centre_world_m
        table.add_row(
            escape(camera.name),
            f"{camera.width_px}x{camera.height_px}",
            f"{camera.K[0, 0]:.1f}",
            f"{solution.error_px(c):.2f}",
            f"{solution.rms_px(c):.2f}",
            f"{solution.n_views[c]}",
            f"{solution.n_bad_views[c]}",
            f"{100 * covered_share(solution, c):.0f}%",
            f"{np.hypot(x_m, y_m):.2f}" if is_floor_known else "-",
            f"{z_m:.2f}" if is_floor_known else "-",
        )
    return table


def _write_record(path: Path, solution: Solution, board: Board, remarks: list[str]) -> None:
    names = [camera.name for camera in solution.cameras]
    record = {
        "board": board.model_dump(exclude_none=True),
        "cameras": {
            name: {
                "error_px": round(solution.error_px(c), 4),
                "rms_per_axis_px": round(solution.rms_px(c), 4),
                "views": solution.n_views[c],
                "left_out": solution.n_bad_views[c],
                "covered": round(covered_share(solution, c), 3),
            }
            for c, name in enumerate(names)
        },
        "pairs": [
            {"cameras": [names[link.first], names[link.second]], "moments": link.n_shared}
            for link in solution.links
        ],
        "warnings": remarks,
    }
    write_file(path, json.dumps(record, indent=2) + "\n")
