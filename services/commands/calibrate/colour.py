"""`xormocap calibrate --colour TAKE`: matches the cameras' colours with pictures of a ColorChecker."""

from pathlib import Path

from rich.markup import escape

from services.commands.consoles import say, stdout, table_of, warn
from services.mocap.calibration.colour_chart import ColourFit, fit_colours
from services.mocap.camera.colour import write_colours
from services.mocap.errors import CalibrationError
from services.mocap.take import layout
from services.mocap.take.folder import open_take
from services.mocap.take.pictures import check_png, read_picture


def calibrate_colour(folder: Path) -> None:
    """Fit a correction to colour/<camera>.png of each camera, write colour.toml, print colour errors.

    Raises UserError, before anything is written, if there is no picture or one cannot be used.
    """
    take = open_take(folder)
    fits: dict[str, ColourFit] = {}
    for camera in take.calibrated:
        path = layout.colour_picture_path(folder, camera.name)
        if path.exists():
            check_png(path, camera)
            fits[camera.name] = fit_colours(read_picture(path), path)
    if not fits:
        raise CalibrationError(
            f"{layout.colour_picture_path(folder, take.cameras[0].name)}: is missing: expected one picture "
            "<camera>.png of a ColorChecker per camera, in the light and with the settings of the take"
        )
    missing = [camera.name for camera in take.cameras if camera.name not in fits]
    if missing:
        names = ", ".join(missing)
        warn([f"{folder}: no picture of a chart from {names}: their colours stay unchanged"])
    means = {
        name: (fit.correction, float(fit.before.mean()), float(fit.after.mean()))
        for name, fit in fits.items()
    }
    write_colours(folder / layout.COLOURS, means)
    table = table_of("camera", "delta E before", "after", "worst before", "after")
    for name, fit in fits.items():
        figures = (fit.before.mean(), fit.after.mean(), fit.before.max(), fit.after.max())
        table.add_row(escape(name), *(f"{figure:.1f}" for figure in figures))
    stdout.print(table)
    say(f"{folder / layout.COLOURS}")
