"""`xormocap calibrate`: cameras from clips of a board, from other tools' files, or checked by silhouettes."""

from services.commands.calibrate import options
from services.commands.calibrate.board import calibrate_by_board, draw_board
from services.commands.calibrate.check import check_take
from services.commands.calibrate.colour import calibrate_colour
from services.commands.calibrate.files import convert
from services.commands.consoles import say
from services.commands.consoles import stderr as _err
from services.commands.consoles import stdout as _out
from services.mocap.errors import UserError


def calibrate(
    clips: options.ClipsArgument = None,
    out: options.OutOption = None,
    board: options.BoardOption = None,
    squares: options.SquaresOption = None,
    square: options.SquareOption = None,
    marker: options.MarkerOption = None,
    dictionary: options.DictionaryOption = None,
    legacy: options.LegacyOption = None,
    draw: options.DrawOption = None,
    lens: options.LensOption = "normal",
    up: options.UpOption = "z",
    check: options.CheckOption = None,
    colour: options.ColourOption = None,
    source: options.ImportOption = None,
    kind: options.FromOption = None,
    target: options.ToOption = "pose2sim",
    size: options.SizeOption = None,
    units: options.UnitsOption = "auto",
    scale: options.ScaleOption = 1.0,
    world: options.AxisOption = "z",
) -> None:
    """Calibrate cameras by a board, or convert a calibration, or check a take's.

    CLIPS holds <camera>.mp4 or folders <camera> of pictures, in which the board is moved about, at the same
    moments; origin/<camera>.mp4 or .png, where it lies on the floor at the world's origin; and optionally
    intrinsics/<camera>.mp4, where one camera alone sees it close. The board may be said in CLIPS/board.toml.
    """
    _check_one_is_asked_for(clips, draw, check, colour, source)
    if check is not None:
        check_take(check, _out, _err)
    elif colour is not None:
        calibrate_colour(colour, _out, _err)
    elif source is not None:
        if out is None:
            raise UserError("calibrate --import: expected --out, the file or folder to write")
        convert(source, kind, out, target, size, units, scale, world, up, _err)
        say(f"{out}")
    else:
        said = {
            "kind": board,
            "squares": squares,
            "square_m": square,
            "marker_m": marker,
            "dictionary": dictionary,
            "legacy": legacy,
        }
        if draw is not None:
            draw_board(draw, said, clips, _out)
        elif clips is not None:
            calibrate_by_board(clips, said, lens, out or clips / "calibration.toml", up, _out, _err)


def _check_one_is_asked_for(
    clips: options.ClipsArgument, draw: options.DrawOption, *others: options.CheckOption
) -> None:
    """Raise UserError unless one thing is asked for; a board may be drawn as the clips' board.toml says."""
    asked = sum(given is not None for given in (clips, *others))
    if (draw is None and asked != 1) or (draw is not None and any(other is not None for other in others)):
        raise UserError(
            "calibrate: expected one of a folder of CLIPS, --check TAKE, --colour TAKE, --import FILE or "
            "--draw FILE"
        )
