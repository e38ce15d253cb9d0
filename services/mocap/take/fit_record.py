"""The files of a fit next to its actor.toml: their names, the record (fit.json), and reading its poses."""

import shutil
import zlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import cv2
import numpy as np
from pydantic import Field, ValidationError

from services.mocap.atomic import atomic_file, write_file
from services.mocap.body.actor import Actor
from services.mocap.body.colours import MOST_CLASSES
from services.mocap.camera.camera import Camera
from services.mocap.errors import FrozenModel, TakeError
from services.mocap.take.layout import as_spelt
from services.mocap.take.pictures import read_silhouette
from services.mocap.take.settings import TakeSettings
from services.mocap.take.tables import read_poses_csv
from services.mocap.types import Bytes, Floats, Mask

FIT_FOLDER = "fit"
"""In a take folder, and in a folder of results."""
RECORD, POSES, MEASURES = "fit.json", "poses.csv", "measures.csv"
OVERLAY, TURNTABLE = "overlay.png", "turntable.png"
OCCLUDED = "occluded"
"""A folder of pictures, one per camera from which something hides the actor: white where it does."""
COLOURS = "colours.npz"
"""What the actor's colour classes look like: a table by camera's name."""
_ENTRY = "camera:"
"""Before a camera's name in that file."""
COLOUR_BINS = (16, 32, 32)
"""Of such a table: lightness, and the two chromatic axes of CIELAB."""


class FitRecord(FrozenModel):
    """The record of a fit."""

    actor: str = Field(pattern="^[0-9a-f]{64}$")
    """Content hash of the actor that the poses belong to."""
    first_frame: int = Field(ge=0)
    end_frame: int = Field(ge=1)
    """The frame after the last."""
    is_refined: bool = False
    """Whether it was a fit to frames of the whole take, by the poses of a result."""
    projections: dict[str, tuple[tuple[float, ...], ...]] = Field(default_factory=dict)
    """By camera that saw the actor the rows of its P_px_world by the take's calibration, in the pixels of
    that; empty in records of earlier versions."""
    hints: dict[str, Any]
    """The hints about the first pose in take.toml (hints_of)."""
    energy_before_px: list[float]
    """Differing pixels of each frame, over all cameras: of the generic body in its first pose."""
    energy_after_px: list[float]
    """The same for the fitted body in its fitted pose."""
    iou_before: dict[str, float]
    """By camera: overlap of model and silhouette (intersection over union), mean over the frames."""
    iou_after: dict[str, float]
    seconds: dict[str, float]
    """Wall time of each stage."""
    lacking: dict[str, tuple[str, ...]] = Field(default_factory=dict)
    """By camera which of hands, feet and head its silhouettes lack in these frames."""
    moved: dict[str, tuple[float, float]] = Field(default_factory=dict)
    """By camera that does not stand where the take's calibration says: by how many degrees it is turned, and
    by how many millimetres it is moved; calibration.toml next to this record has its place."""
    warnings: list[str]


def was_seen_by(record: FitRecord, cameras: Iterable[Camera]) -> bool:
    """Whether these cameras, as calibrated, saw the actor of a fit: by their names and projections."""
    return all(
        camera.name in record.projections
        and np.allclose(record.projections[camera.name], camera.P_px_world, rtol=1e-6, atol=1e-6)
        for camera in cameras
    )


def hints_of(settings: TakeSettings) -> dict[str, Any]:
    """The hints about the first pose in take.toml, for a record."""
    return settings.model_dump(include={"facing", "initial_pose"})


def write_record(folder: Path, record: FitRecord) -> None:
    """Write fit.json, completely or not at all."""
    write_file(folder / RECORD, record.model_dump_json(indent=2) + "\n")


def read_record(folder: Path) -> FitRecord | None:
    """The record of a fit; None if there is none. Raises TakeError if it cannot be used."""
    path = folder / RECORD
    if not path.exists():
        return None
    try:
        return FitRecord.model_validate_json(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, ValidationError):
        raise TakeError(f"{path}: is not a file of xormocap fit: remove it or fit again") from None


def record_of(folder: Path, actor: Actor | None) -> FitRecord | None:
    """The record of the fit in a folder that found this very actor; None if no fit there found it. Raises
    TakeError as read_record."""
    record = read_record(folder)
    is_its_own = record is not None and actor is not None and record.actor == actor.content_hash
    return record if is_its_own else None


def was_refined(folder: Path, actor: Actor) -> bool | None:
    """Whether the fit in a folder that found this very actor was one to frames of the whole take; else as
    record_of."""
    record = record_of(folder, actor)
    return None if record is None else record.is_refined


def known_poses(folder: Path, actor: Actor, settings: TakeSettings) -> dict[int, Floats]:
    """The poses (D,) that a fit has for this very actor, by frame; empty where there are none.

    Poses from a fit with other hints in take.toml are not used. Raises TakeError if the files of the fit
    cannot be used.
    """
    record = record_of(folder, actor)
    if record is None or record.hints != hints_of(settings):
        return {}
    return read_poses_csv(folder / POSES).by_frame()


def read_learnt(folder: Path, cameras: Sequence[Camera]) -> tuple[dict[str, Mask], dict[str, Bytes]]:
    """What a fit learnt of some cameras: read_occluded and read_colour_tables."""
    return read_occluded(folder, cameras), read_colour_tables(folder, cameras)


def copy_learnt(fit: Path, to: Path) -> None:
    """Copy the record of a fit, and what it learnt of cameras, into another folder."""
    to.mkdir(exist_ok=True)
    for path in (fit / COLOURS, *(fit / OCCLUDED).glob("*.png"), fit / RECORD):
        if path.exists():
            copy = to / path.relative_to(fit)
            copy.parent.mkdir(exist_ok=True)
            shutil.copy(path, copy)


def read_occluded(folder: Path, cameras: Iterable[Camera]) -> dict[str, Mask]:
    """By camera the pixels (h, w), without lens distortion, in which something hides the actor.

    As written by a fit. Raises TakeError for a picture that cannot be used.
    """
    occluded = {}
    for camera in cameras:
        path = as_spelt(folder / OCCLUDED / f"{camera.name}.png")
        if path.exists():
            mask = read_silhouette(path).view(np.uint8)
            if abs(mask.shape[1] * camera.height_px - mask.shape[0] * camera.width_px) > max(mask.shape):
                raise TakeError(f"{path}: has another aspect ratio than {camera.name}: fit again")
            # of another size if the take's longest_side was another one at the time of the fit
            resized = cv2.resize(mask, camera.size_px, interpolation=cv2.INTER_NEAREST)
            occluded[camera.name] = resized > 0
    return occluded


def read_colour_tables(folder: Path, cameras: Iterable[Camera]) -> dict[str, Bytes]:
    """By camera the class of each colour (COLOUR_BINS), 0 for none, as a fit learnt it; empty if none did.

    Raises TakeError for a file that cannot be used.
    """
    path = folder / COLOURS
    if not path.exists():
        return {}
    try:
        with np.load(path, allow_pickle=False) as file:
            tables = {c.name: file[_ENTRY + c.name] for c in cameras if _ENTRY + c.name in file}
    except (OSError, EOFError, TypeError, ValueError, zlib.error, BadZipFile):
        raise TakeError(f"{path}: is not a file of xormocap fit: remove it or fit again") from None
    for name, table in tables.items():
        if table.shape != COLOUR_BINS or table.dtype != np.uint8 or table.max() > MOST_CLASSES:
            raise TakeError(f"{path}: {name}: is not a table of colour classes: remove it or fit again")
    return tables


def write_colour_tables(folder: Path, tables: Mapping[str, Bytes]) -> None:
    """Write the tables by camera, completely or not at all; without any, an earlier file goes."""
    if not tables:
        (folder / COLOURS).unlink(missing_ok=True)
        return
    entries: dict[str, Any] = {_ENTRY + name: table for name, table in tables.items()}
    with atomic_file(folder / COLOURS) as part, part.open("wb") as file:
        np.savez_compressed(file, **entries)
