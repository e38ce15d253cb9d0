"""Live configurations: a TOML file that names the cameras' sources, opened like a take.

Unlike a recorded take it has no videos and no number of frames.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from services.mocap.camera.calibration import read_calibration
from services.mocap.camera.camera import Camera
from services.mocap.camera.colour import read_colours
from services.mocap.errors import TakeError, load_toml, nearest, validated
from services.mocap.take.folder import Take, open_take
from services.mocap.take.layout import COLOURS
from services.mocap.take.live_settings import LiveCamera, LiveSettings
from services.mocap.take.settings import TakeSettings
from services.mocap.take.video_checks import check_plate

OPEN_END = 2**31 - 1
"""The number of frames of live input, whose end is open."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LiveTake(Take):
    """Live input in place of a recording, checked by `open_live`."""

    live: LiveSettings
    sources: tuple[LiveCamera, ...]
    """Of the cameras, in their order; paths are complete."""
    background_folder: Path | None
    """The empty stage; None: seen at the start."""
    colour_path: Path | None
    """The file of colour corrections; None: no correction."""

    def has_video(self, camera: Camera) -> bool:  # noqa: ARG002  (as of a take)
        """See Take: live input cannot be read again."""
        return False

    @property
    def actor_path(self) -> Path | None:
        """See Take: the file that the configuration names, even if it is missing."""
        return None if self.live.actor is None else self.folder / self.live.actor

    def inputs(self, from_videos: bool) -> list[Path]:  # noqa: ARG002  (as of a take)
        """See Take: the files that stay the same from run to run."""
        files = [*(self.plate(camera) for camera in self.cameras), self.colour_path]
        return [self.folder / self.live.calibration, *(path for path in files if path is not None)]

    def groups(self) -> dict[str, list[int]]:
        """Cameras by their position in calibration.toml, group by group."""
        names = dict.fromkeys(source.group for source in self.sources)
        return {name: [c for c, one in enumerate(self.sources) if one.group == name] for name in names}

    @property
    def groups_here(self) -> list[str]:
        """The groups of cameras that are not on other hosts."""
        return [name for name in self.groups() if name not in self.live.elsewhere]

    def cameras_of(self, groups: Iterable[str]) -> list[int]:
        """The cameras of some groups by their position in calibration.toml, group by group."""
        by_group = self.groups()
        return [c for group in groups for c in by_group[group]]

    def plate(self, camera: Camera) -> Path | None:
        """See Take."""
        if self.background_folder is None:
            return None
        paths = [self.background_folder / f"{camera.name}{suffix}" for suffix in (".mp4", ".png")]
        return next((path for path in paths if path.exists()), None)


def open_source(path: Path) -> Take:
    """Open and check a take folder or a live configuration's file; raises TakeError.

    Each service of a run calls it, so it does not decode videos: the command that starts a run has done so,
    or segmentation finds damaged ones.
    """
    return open_live(path) if path.is_file() else open_take(path, decoded=False)


def open_live(path: Path) -> LiveTake:
    """Opens and checks a live configuration, except whether its sources are available.

    Raises TakeError for the first error found.
    """
    settings = validated(LiveSettings, load_toml(path, TakeError), f"{path}: ", TakeError)
    folder = path.resolve().parent
    cameras = read_calibration(folder / settings.calibration, settings.up)
    sources = _sources(path, settings, cameras)
    if settings.least_cameras > len(cameras):
        raise TakeError(
            f"{path}: least_cameras: expected at most {len(cameras)}, the cameras of {settings.calibration}"
        )
    for group in settings.elsewhere:
        if group not in (known := sorted({source.group for source in sources})):
            raise TakeError(
                f"{path}: elsewhere: {group}: no camera is of that group: {nearest(group, known)}"
            )
    background = None if settings.background is None else folder / settings.background
    colour_path = _colour_path(path, settings)
    take = LiveTake(
        folder=folder,
        settings=TakeSettings(
            name=settings.name,
            fps=settings.fps,
            units="m",
            up=settings.up,
            frames=OPEN_END,
            longest_side=settings.longest_side,
            actor_height=settings.actor_height,
            facing=settings.facing,
        ),
        calibrated=cameras,
        source="videos",
        colours=read_colours(colour_path, [camera.name for camera in cameras]) if colour_path else {},
        colour_path=colour_path,
        live=settings,
        sources=sources,
        background_folder=background,
    )
    _check_plates(path, take)
    return take


def _colour_path(path: Path, settings: LiveSettings) -> Path | None:
    """The file of colour corrections that the configuration names, or the one next to it."""
    named = path.resolve().parent / (settings.colour or COLOURS)
    if named.exists():
        return named
    if settings.colour is not None:
        raise TakeError(f"{path}: colour: {named} is missing: expected a file of xormocap calibrate --colour")
    return None


def _sources(path: Path, settings: LiveSettings, cameras: tuple[Camera, ...]) -> tuple[LiveCamera, ...]:
    names = [camera.name for camera in cameras]
    for name in settings.cameras:
        if name not in names:
            raise TakeError(
                f"{path}: [cameras.{name}]: is no camera of {settings.calibration}: {nearest(name, names)}"
            )
    for name in names:
        if name not in settings.cameras:
            raise TakeError(f"{path}: [cameras.{name}] is missing: expected a table with its source")
    folder, sources = path.resolve().parent, []
    for name in names:
        source = validated(LiveCamera, settings.cameras[name], f"{path}: [cameras.{name}] ", TakeError)
        complete = {"source": str(folder / str(source.source))} if source.is_file else {}
        sources.append(source.model_copy(update=complete))
    return tuple(sources)


def _check_plates(path: Path, take: LiveTake) -> None:
    if take.background_folder is None:
        return
    for camera in take.calibrated:
        plate = take.plate(camera)
        if plate is None:
            raise TakeError(
                f"{take.background_folder}: has neither {camera.name}.png nor {camera.name}.mp4: expected "
                f"the empty stage of every camera, or no background in {path}"
            )
        check_plate(plate, camera, decoded=False)
