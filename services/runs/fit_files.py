"""The files of a fit: actor.toml, poses, measures, pictures and a record of its quality."""

import csv
import shutil
from pathlib import Path

from services.mocap.atomic import atomic_file
from services.mocap.body.actor import build_body
from services.mocap.body.measures import Measure
from services.mocap.camera.rig import Rig
from services.mocap.camera.undistort import Undistorter
from services.mocap.energy.bitplanes import unpack_trimaps
from services.mocap.export.fit_sheet import Seen, Shown, draw_fit
from services.mocap.export.model_painter import ModelPainter
from services.mocap.export.tiles import trimap_picture
from services.mocap.export.turntable import draw_turntable
from services.mocap.fit.quality import FitQuality
from services.mocap.take.actor_file import write_actor
from services.mocap.take.fit_record import (
    MEASURES,
    OCCLUDED,
    OVERLAY,
    POSES,
    RECORD,
    TURNTABLE,
    FitRecord,
    hints_of,
    write_colour_tables,
    write_record,
)
from services.mocap.take.folder import Take
from services.mocap.take.layout import ACTOR
from services.mocap.take.moved_cameras import moves_of, write_moved
from services.mocap.take.tables import write_poses_csv
from services.mocap.take.writer import write_picture
from services.mocap.types import Bytes
from services.runs.take_fit import TakeFit, frames_in_words


def write_fit(take: Take, found: TakeFit, folder: Path) -> None:
    """Write what a fit found into a folder: its actor.toml, poses, measures and pictures; fit.json last.

    Each file of an earlier fit is replaced atomically; other files stay.
    """
    (folder / RECORD).unlink(missing_ok=True)  # it says that the other files are complete
    write_poses_csv(folder / POSES, found.pose_table(take.settings.fps))
    with atomic_file(folder / MEASURES) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["measure", "cm", "uncertainty_cm", "how"])
        writer.writerows([m.name, f"{m.cm:.1f}", uncertainty_of(m), m.how] for m in found.measures)
    write_picture(folder / TURNTABLE, draw_turntable(build_body(found.actor)))
    write_picture(folder / OVERLAY, _overlay(take, found))
    write_moved(folder, found.moved_take or take)
    shutil.rmtree(folder / OCCLUDED, ignore_errors=True)
    for name, mask in found.occluded.items():
        write_picture(folder / OCCLUDED / f"{name}.png", mask)
    write_colour_tables(folder, found.colour_tables)
    write_actor(folder / ACTOR, found.actor, origin_of(take, found))
    write_record(folder, _record(take, found))


def origin_of(take: Take, found: TakeFit) -> str:
    """The source of a fit, in words."""
    return f"{frames_in_words(found)} of {take.settings.name!r}"


def _overlay(take: Take, found: TakeFit) -> Bytes:
    """The first frame of all cameras, before and after."""
    start = "generic body" if found.start.mesh is None else "own mesh"
    if found.is_refined:
        start = "body of the run"
    states = []
    for title, actor, pose, quality in (
        (f"before: {start}", found.start, found.start_pose, found.fit.before),
        ("after: fitted body", found.actor, found.fit.poses[0], found.fit.after),
    ):
        painter = ModelPainter(build_body(actor), Rig.of(found.cameras))
        title = (
            f"{title}, height {actor.height:.3f} m, frame {found.frames[0]}: "
            f"energy {quality.energy_px[0]:.0f} px, mean IoU {quality.iou[0].mean():.3f}"
        )
        states.append(Shown(title, painter.segment_masks(pose), quality.iou[0]))
    return draw_fit(_seen(take, found), states)


def _seen(take: Take, found: TakeFit) -> list[Seen]:
    """The first frame in all cameras: pictures, or silhouettes if there are none."""
    seen, trimaps = [], unpack_trimaps(found.seen[0], len(found.cameras))
    for c, camera in enumerate(found.cameras):
        trimap = trimaps[c, : camera.height_px, : camera.width_px]
        picture = trimap_picture(trimap)
        if take.has_video(camera):
            with take.video(camera, found.frames[0], found.frames[0] + 1) as video:
                picture = Undistorter(camera).image(next(iter(video)))
        seen.append(Seen(camera, picture, trimap))
    return seen


def uncertainty_of(row: Measure) -> str:
    """The standard deviation of a measure as text; empty if it is not known."""
    return "" if row.uncertainty_cm is None else f"{row.uncertainty_cm:.1f}"


def _record(take: Take, found: TakeFit) -> FitRecord:
    def by_camera(quality: FitQuality) -> dict[str, float]:
        means = quality.iou.mean(axis=0).tolist()
        return {camera.name: mean for camera, mean in zip(found.cameras, means, strict=True)}

    return FitRecord(
        actor=found.actor.content_hash,
        first_frame=found.frames[0],
        end_frame=found.frames[-1] + 1,
        is_refined=found.is_refined,
        projections={camera.name: camera.P_px_world.tolist() for camera in take.calibrated},
        hints=hints_of(take.settings),
        energy_before_px=found.fit.before.energy_px.tolist(),
        energy_after_px=found.fit.after.energy_px.tolist(),
        iou_before=by_camera(found.fit.before),
        iou_after=by_camera(found.fit.after),
        seconds=found.seconds,
        lacking=dict(found.lacking),
        moved=dict(moves_of(found.moved_take or take)),
        warnings=found.warnings,
    )
