"""The file names in a take folder, for readers and writers."""

from pathlib import Path

from services.mocap.camera.camera import nfc

SETTINGS = "take.toml"
CALIBRATION = "calibration.toml"
COLOURS = "colour.toml"
ACTOR = "actor.toml"
VIDEOS, BACKGROUND, SILHOUETTES = "videos", "background", "silhouettes"
REFERENCE_JOINTS_CSV = "reference/joints.csv"


def as_spelt(path: Path) -> Path:
    """The path, or that of the file or folder there whose name differs from it only in what `nfc` removes."""
    if path.exists() or not path.parent.is_dir():
        return path
    return next((other for other in path.parent.iterdir() if nfc(other.name) == nfc(path.name)), path)


def video_path(take_folder: Path, camera: str) -> Path:
    """The camera's recording."""
    return take_folder / VIDEOS / f"{camera}.mp4"


def background_video_path(take_folder: Path, camera: str) -> Path:
    """The camera's clean plate as a video."""
    return take_folder / BACKGROUND / f"{camera}.mp4"


def colour_picture_path(take_folder: Path, camera: str) -> Path:
    """The camera's picture of a colour chart."""
    return as_spelt(take_folder / "colour" / f"{camera}.png")


def silhouette_folder(take_folder: Path, camera: str) -> Path:
    """The folder of the camera's silhouettes."""
    return as_spelt(take_folder / SILHOUETTES / camera)


def silhouette_path(folder: Path, frame: int) -> Path:
    """One frame's silhouette in a camera's folder of silhouettes."""
    return folder / f"{frame:06d}.png"
