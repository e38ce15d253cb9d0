"""The options of `xormocap calibrate`."""

from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import typer

from services.mocap.calibration.lens import Lens
from services.mocap.camera.calibration import Up
from services.mocap.camera.formats import Axis, Format, Units

_BOARD, _FILES = "Board", "Files of other tools"

ClipsArgument: TypeAlias = Annotated[
    Path | None, typer.Argument(help="The folder of clips: <camera>.mp4 and origin/.", metavar="CLIPS")
]
OutOption: TypeAlias = Annotated[
    Path | None, typer.Option(help="Where it goes; CLIPS/calibration.toml by default.")
]
BoardOption: TypeAlias = Annotated[
    Literal["charuco", "chessboard"] | None,
    typer.Option(help="What is printed on the board; charuco by default.", rich_help_panel=_BOARD),
]
SquaresOption: TypeAlias = Annotated[
    str | None,
    typer.Option(help="Squares in a row and rows, such as 7x10.", metavar="CxR", rich_help_panel=_BOARD),
]
SquareOption: TypeAlias = Annotated[
    float | None, typer.Option(help="The side of a square in metres.", rich_help_panel=_BOARD)
]
MarkerOption: TypeAlias = Annotated[
    float | None,
    typer.Option(help="The side of a marker in metres; 3/4 of a square's.", rich_help_panel=_BOARD),
]
DictionaryOption: TypeAlias = Annotated[
    str | None, typer.Option(help="The markers' dictionary; 5x5_100 by default.", rich_help_panel=_BOARD)
]
LegacyOption: TypeAlias = Annotated[
    bool | None,
    typer.Option(help="The board was drawn by OpenCV before 4.6.", rich_help_panel=_BOARD),
]
DrawOption: TypeAlias = Annotated[
    Path | None, typer.Option(help="Write the board as a PNG to print, and stop.", rich_help_panel=_BOARD)
]
LensOption: TypeAlias = Annotated[
    Lens, typer.Option(help="normal, wide (one coefficient more) or fisheye.", rich_help_panel=_BOARD)
]
UpOption: TypeAlias = Annotated[Up, typer.Option(help="The axis that points up in the file that is written.")]
CheckOption: TypeAlias = Annotated[
    Path | None, typer.Option(help="Say whether a take's cameras agree.", metavar="TAKE")
]
ColourOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(help="Correct a take's colours by colour/<camera>.png, a ColorChecker.", metavar="TAKE"),
]
ImportOption: TypeAlias = Annotated[
    Path | None,
    typer.Option("--import", help="Convert this file or folder instead.", rich_help_panel=_FILES),
]
FromOption: TypeAlias = Annotated[
    Format | None,
    typer.Option("--from", help="Its format; found out by default.", rich_help_panel=_FILES),
]
ToOption: TypeAlias = Annotated[
    Literal["pose2sim", "opencv"],
    typer.Option("--to", help="pose2sim (also xormocap's own) or opencv.", rich_help_panel=_FILES),
]
SizeOption: TypeAlias = Annotated[
    str | None,
    typer.Option(help="Picture size WxH, where the file does not say.", rich_help_panel=_FILES),
]
UnitsOption: TypeAlias = Annotated[
    Units,
    typer.Option(help="Its unit of length, where the format leaves it open.", rich_help_panel=_FILES),
]
ScaleOption: TypeAlias = Annotated[
    float, typer.Option(help="Multiply lengths by this, as for COLMAP.", rich_help_panel=_FILES)
]
AxisOption: TypeAlias = Annotated[
    Axis,
    typer.Option("--its-up", help="The axis that points up in it.", rich_help_panel=_FILES),
]
