"""Live input uses what a fit learnt only for the fit's own actor and cameras."""

import shutil
from pathlib import Path

from services.mocap.body.actor import Actor
from services.mocap.take.actor_file import write_actor
from services.mocap.take.fit_record import FIT_FOLDER
from services.mocap.take.folder import open_take
from services.mocap.take.layout import ACTOR, CALIBRATION
from services.mocap.take.live import open_live
from services.runs.fit_files import write_fit
from services.runs.live import fit_of_actor
from services.runs.take_fit import TakeFit


def test_a_fit_counts_for_its_actor_and_its_cameras(walk: Path, walk_fit: TakeFit, tmp_path: Path) -> None:
    take, recorded, config = open_take(walk), tmp_path / "recorded", tmp_path / "live.toml"
    fit = recorded / FIT_FOLDER
    lines = [
        f'fps = {take.settings.fps}\nup = "z"\ncalibration = "recorded/{CALIBRATION}"',
        f'name = "stage"\nactor = "recorded/{ACTOR}"',
        *(f'[cameras.{camera.name}]\nsource = "http://stage/{camera.name}"' for camera in take.cameras),
    ]
    config.write_text("\n".join(lines))
    write_fit(take, walk_fit, fit)
    shutil.copy(walk / CALIBRATION, recorded)
    assert fit_of_actor(open_live(config)) is None  # there is no actor yet
    shutil.copy(fit / ACTOR, recorded)
    assert fit_of_actor(open_live(config)) == fit

    config.write_text("\n".join(["longest_side = 160", *lines]))
    assert fit_of_actor(open_live(config)) is None
    config.write_text("\n".join(lines))
    write_actor(recorded / ACTOR, Actor(height=1.9), "nothing")
    assert fit_of_actor(open_live(config)) is None
