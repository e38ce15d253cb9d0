"""The fit of a take, with the fitting itself replaced, which takes seconds."""

import logging
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

from exact_take import write_exact_take
from first_pose import say_first_pose
from services.mocap.body.actor import Actor, build_body
from services.mocap.body.skeleton import BodyName
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.energy.settings import EngineSettings
from services.mocap.fit.fitting import Fit
from services.mocap.fit.quality import quality_of
from services.mocap.search.settings import SearchSettings
from services.mocap.take.folder import Take
from services.mocap.types import Floats, Mask
from services.runs.fit import fit_take
from services.runs.take_fit import TakeFit
from services.runs.take_silhouettes import TakeSilhouettes

CPU, QUICK = EngineSettings(backend="cpu"), SearchSettings(max_passes=1)
TALLER_M = 1.76543219
FILES = {"actor.toml", "fit.json", "poses.csv", "measures.csv", "overlay.png", "turntable.png"}
"""All that a fit writes."""
log = logging.getLogger("services.mocap.fit")


def write_walk(folder: Path) -> Path:
    """Write a take of three frames and cameras whose first pose is said, so that it is found at once; returns
    its folder."""
    write_exact_take(folder, n_frames=3, n_cameras=3)
    say_first_pose(folder)
    return folder


def stretch(
    rig: Rig,
    seen: TriPlanes,
    start: Actor,
    poses: Floats,
    progress: Callable[[float], None],
    body: BodyName,
    height_m: float | None,
) -> Fit:
    """In place of the fit: another height, all frames in the first pose."""
    assert seen.silhouettes.shape == seen.unsure.shape == (3, 1, *rig.shape_px)
    log.warning("something odd about %s", "cam01")
    assert body == QUICK.body
    assert height_m in (None, start.height)
    progress(0.5)
    actor, poses = Actor(height=TALLER_M), np.tile(poses, (len(seen), 1))
    before, after = (quality_of(build_body(shape), poses, rig, seen) for shape in (start, actor))
    return Fit(actor, poses, before, after)


def fit_by(
    fitter: Callable[..., Fit],
    take: Take,
    frames: range,
    search: SearchSettings = QUICK,
    show: Callable[[str, float], None] = lambda *_: None,
    blind: Mapping[str, Mask] | None = None,
    **others: bool,
) -> TakeFit:
    """As fit_take, with this in place of the fit; blind: see SilhouetteSource.blind."""
    silhouettes = TakeSilhouettes(take)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("services.runs.fit_frames.fit_actor", fitter)
        patch.setattr(silhouettes.segmenter.source, "blind", lambda: blind or {})
        return fit_take(silhouettes, frames, CPU, search, show, **others)
