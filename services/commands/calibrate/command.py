"""`xormocap calibrate`: calibrates cameras from clips of a board or other tools' files, or checks or refines
them with silhouettes."""

from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from services.commands.calibrate.board import calibrate_by_board, draw_board
from services.commands.calibrate.check import check_take
from services.commands.calibrate.colour import calibrate_colour
from services.commands.calibrate.importing import Target, import_calibration
from services.commands.calibrate.points import place_by_points
from services.commands.calibrate.refine import refine_take
from services.mocap.calibration.board import BoardKind
from services.mocap.calibration.lens import N_COEFFICIENTS, Lens
from services.mocap.camera.calibration import Up
from services.mocap.camera.formats import Axis, Format, Units
from services.mocap.errors import UserError
from services.mocap.take.layout import CALIBRATION

_board_option = partial(typer.Option, rich_help_panel="Board")
_import_option = partial(typer.Option, rich_help_panel="Files of other tools")
_BOARD = {"board", "squares", "square", "marker", "markers", "gap", "first_id", "dictionary"}
_BOARD |= {"legacy", "inverted"}
_OPTIONS_OF: dict[str, set[str]] = {
    "refine": {"clips", "out"},
    "check": set(),
    "colour": set(),
    "source": {"kind", "target", "size", "units", "scale", "world", "points", "out", "up"},
    "draw": {"clips", *_BOARD},
    "clips": {"out", "lens", "level", "points", "up", *_BOARD},
    "points": {"lens", "out", "up"},
}
"""By the parameter that asks for it, what the command does, and which other parameters have an effect then.
If several of them are given, the first one here counts."""


def calibrate(
    context: typer.Context,
    clips: Annotated[
        Path | None,
        typer.Argument(
            help="The folder with the clips: <camera>.mp4 and origin/; with --refine, the take.",
            metavar="CLIPS|TAKE",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="The file to write; CLIPS/calibration.toml by default, TAKE/calibration-refined.toml with "
            "--refine."
        ),
    ] = None,
    board: Annotated[
        BoardKind | None,
        _board_option(
            help="The kind of board: charuco (default), aruco (a sheet of markers with gaps) or chessboard."
        ),
    ] = None,
    squares: Annotated[
        str | None,
        _board_option(help="Number of squares per row, and number of rows, such as 7x10.", metavar="CxR"),
    ] = None,
    square: Annotated[float | None, _board_option(help="Side length of a square in metres.")] = None,
    marker: Annotated[
        float | None, _board_option(help="Side length of a marker in metres; by default 3/4 of a square's.")
    ] = None,
    markers: Annotated[
        str | None,
        _board_option(
            help="Of a sheet of ArUco markers: markers per row, and rows, such as 5x7.", metavar="CxR"
        ),
    ] = None,
    gap: Annotated[
        float | None, _board_option(help="Of a sheet of ArUco markers: the gap between two in metres.")
    ] = None,
    first_id: Annotated[
        int | None, _board_option(help="Of a sheet of ArUco markers: number of the first; 0 by default.")
    ] = None,
    dictionary: Annotated[
        str | None, _board_option(help="Dictionary of the markers; 5x5_100 by default.")
    ] = None,
    legacy: Annotated[bool | None, _board_option(help="The board was drawn by OpenCV before 4.6.")] = None,
    draw: Annotated[
        Path | None, _board_option(help="Write the board as a PNG file to print, and exit.")
    ] = None,
    lens: Annotated[
        str,
        _board_option(
            help="Lens model: normal, wide (one more coefficient) or fisheye; or a calibration file of any "
            "tool, whose lenses are held.",
            metavar="MODEL|FILE",
        ),
    ] = "normal",
    level: Annotated[
        str | None,
        _board_option(
            help="Without origin/: the camera whose pictures are upright and level.", metavar="CAMERA"
        ),
    ] = None,
    inverted: Annotated[
        bool | None, _board_option(help="The board is white on black. Default: both are tried.")
    ] = None,
    points: Annotated[
        Path | None,
        typer.Option(
            help="A table camera,u,v,x,y,z of measured points. With CLIPS or --import it defines the world; "
            "with --lens FILE alone, the cameras' poses.",
            metavar="FILE",
        ),
    ] = None,
    up: Annotated[Up, typer.Option(help="The axis that points up in the file that is written.")] = "z",
    check: Annotated[
        Path | None, typer.Option(help="Check whether the cameras of this take agree.", metavar="TAKE")
    ] = None,
    refine: Annotated[
        Path | None,
        typer.Option(
            help="Correct the extrinsics of TAKE by the body and poses of this result.",
            metavar="RESULT",
        ),
    ] = None,
    colour: Annotated[
        Path | None,
        typer.Option(
            help="Match this take's colours with colour/<camera>.png, pictures of a ColorChecker.",
            metavar="TAKE",
        ),
    ] = None,
    source: Annotated[
        Path | None, _import_option("--import", help="Convert this calibration file or folder.")
    ] = None,
    kind: Annotated[
        Format | None, _import_option("--from", help="Format of the imported file; detected by default.")
    ] = None,
    target: Annotated[
        Target, _import_option("--to", help="Format to write: pose2sim (also xormocap's own) or opencv.")
    ] = "pose2sim",
    size: Annotated[
        str | None, _import_option(help="Picture size WxH, if the file does not contain it.")
    ] = None,
    units: Annotated[
        Units, _import_option(help="Unit of length of the imported file, if its format does not define it.")
    ] = "auto",
    scale: Annotated[float, _import_option(help="Factor for all lengths, for example for COLMAP.")] = 1.0,
    world: Annotated[
        Axis | None,
        _import_option(
            "--its-up",
            help="The axis that points up in the imported file; that of its format by default, else z.",
        ),
    ] = None,
) -> None:
    """Calibrate cameras with a board, convert a calibration of another tool, or check or refine the
    calibration of a take.

    CLIPS contains <camera>.mp4 or folders <camera> of pictures, synchronised, in which the board is moved
    about; origin/<camera>.mp4 or .png, in which the board lies on the floor at the world's origin; and
    optionally intrinsics/<camera>.mp4, in which the board is close to one camera. CLIPS/board.toml may
    describe the board.
    """
    _check_mode(context)
    said: dict[str, Any] = {"kind": board, "squares": squares, "square_m": square, "marker_m": marker}
    said |= {"markers": markers, "gap_m": gap, "first_id": first_id, "dictionary": dictionary}
    said |= {"legacy": legacy, "inverted": inverted}
    if refine is not None:
        if clips is None:
            raise UserError(
                "calibrate --refine RESULT: expected the take as well: calibrate TAKE --refine RESULT"
            )
        refine_take(clips, refine, out)
    elif check is not None:
        check_take(check)
    elif colour is not None:
        calibrate_colour(colour)
    elif source is not None:
        import_calibration(
            source, kind=kind, size=size, units=units, scale=scale, its_up=world, points=points, out=out,
            target=target, up=up,
        )  # fmt: skip
    elif draw is not None:
        draw_board(draw, said, clips)
    elif clips is not None:
        model, lens_file = _lens_of(lens)
        calibrate_by_board(clips, said, model, out or clips / CALIBRATION, up, lens_file, level, points)
    elif points is not None:
        _, lens_file = _lens_of(lens)
        if lens_file is None or out is None:
            raise UserError(
                "calibrate --points: expected CLIPS or --import FILE, whose cameras are moved; alone, it "
                "needs --lens FILE, the cameras' lenses, and --out FILE, the file to write"
            )
        place_by_points(points, lens_file, out, up)


def _check_mode(context: typer.Context) -> None:
    """Raise UserError unless exactly one thing is asked for, and if an option is given that has no effect
    with it."""
    sources = {p: context.get_parameter_source(p.name or "") for p in context.command.params}
    words = {
        p.name or "": p.opts[0] for p, source in sources.items() if source and source.name == "COMMANDLINE"
    }
    asked = [mode for mode in _OPTIONS_OF if mode in words]
    if not asked or not _OPTIONS_OF[asked[0]].issuperset(asked[1:]):
        raise UserError(
            "calibrate: expected one of a folder of CLIPS, TAKE --refine RESULT, --check TAKE, "
            "--colour TAKE, --import FILE, --points FILE or --draw FILE"
        )
    for name, word in words.items():
        if name != asked[0] and name not in _OPTIONS_OF[asked[0]]:
            mode = "CLIPS" if asked[0] == "clips" else words[asked[0]]
            raise UserError(f"calibrate: {word} has no effect with {mode}: leave it out")


def _lens_of(text: str) -> tuple[Lens, Path | None]:
    """The lens model that --lens names, and the file if it names one, whose lenses are held.

    Cameras that the file lacks have the model. Raises UserError.
    """
    for model in N_COEFFICIENTS:
        if text == model:
            return model, None
    if not Path(text).exists():
        raise UserError(
            f"--lens {text}: is no lens model and no file: expected {', '.join(N_COEFFICIENTS)} or a file "
            "with lenses"
        )
    return "normal", Path(text)
