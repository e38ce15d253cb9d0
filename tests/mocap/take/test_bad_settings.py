from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

import pytest

SmallTake: TypeAlias = Callable[..., Path]
Refusal: TypeAlias = Callable[[Path], str]


def change_settings(folder: Path, old: str, new: str) -> None:
    path = folder / "take.toml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


@pytest.mark.parametrize("name", ["take.toml", "calibration.toml"])
def test_missing_settings_and_calibration(small_take: SmallTake, refusal: Refusal, name: str) -> None:
    folder = small_take()
    (folder / name).unlink()
    expected = (
        "a take folder: xormocap new makes one from videos"
        if name == "take.toml"
        else "a TOML file of that name"
    )
    assert refusal(folder) == f"{name}: is missing: expected {expected}"


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("fps = 10.0", "fsp = 10.0", "take.toml: fsp: unknown field: did you mean fps"),
        (
            "units = ",
            "init_frame = 2\nunits = ",
            "take.toml: init_frame: unknown field: did you mean init_frames",
        ),
        (
            "units = ",
            "longest_side = 10\nunits = ",
            "take.toml: longest_side: expected a number of pixels, 32 or more, to which larger pictures are "
            "reduced along their longer side, found 10",
        ),
        (
            "fps = 10.0",
            'fps = "ten"',
            "take.toml: fps: expected a positive number of frames per second, found 'ten'",
        ),
        ("fps = 10.0", "fps = 0", "take.toml: fps: expected a positive number of frames per second, found 0"),
        (
            "fps = 10.0",
            "fps = nan",
            "take.toml: fps: expected a positive number of frames per second, found nan",
        ),
        (
            "frames = 4",
            "frames = 4.5",
            "take.toml: frames: expected a whole number of frames, 1 or more, found 4.5",
        ),
        (
            'units = "m"',
            'units = "mm"',
            "take.toml: units: expected \"m\", since all lengths are in metres, found 'mm'",
        ),
        (
            'up = "z"',
            'up = "x"',
            'take.toml: up: expected "y" or "z", the axis of the calibrated world that points up, '
            "found 'x'",
        ),
        (
            "frames = 4",
            "frames = 4\nactor_height = 178",
            "take.toml: actor_height: expected the actor's height in metres, 0.5 to 2.5, found 178: "
            "178 cm is 1.78",
        ),
        (
            "frames = 4",
            "frames = 4\nactor_height = 1780",
            "take.toml: actor_height: expected the actor's height in metres, 0.5 to 2.5, found 1780: "
            "1780 mm is 1.78",
        ),
        (
            "frames = 4",
            "frames = 4\nactor_height = 30000",
            "take.toml: actor_height: expected the actor's height in metres, 0.5 to 2.5, found 30000",
        ),
        (
            "frames = 4",
            "frames = 4\ninit_frames = 9",
            "take.toml: init_frames: expected at most frames = 4, found 9",
        ),
        (
            "frames = 4",
            "frames = 4\n[initial_pose]\nleft_elbow_rad = 1.0",
            "take.toml: initial_pose: left_elbow_rad: unknown parameter: did you mean left_elbow_flexion_rad",
        ),
        (
            "frames = 4",
            "frames = 4\n[initial_pose]\nleft_elbow_flexion_rad = -0.5",
            "take.toml: initial_pose: left_elbow_flexion_rad: expected 0.000 to 2.618 rad, the limits of the "
            "joint, found -0.5",
        ),
        (
            "frames = 4",
            'frames = 4\n[initial_pose]\nroot_x_m = "1"',
            "take.toml: initial_pose: expected a table of pose parameters in metres and radians, such as "
            "root_x_m = 0.5, found {'root_x_m': '1'}",
        ),
    ],
)
def test_bad_settings(small_take: SmallTake, refusal: Refusal, old: str, new: str, expected: str) -> None:
    folder = small_take(n_cameras=1)
    change_settings(folder, old, new)
    assert refusal(folder) == expected


def test_settings_that_are_no_toml(small_take: SmallTake, refusal: Refusal) -> None:
    folder = small_take(n_cameras=1)
    change_settings(folder, "fps = 10.0", "fps = ")
    said = refusal(folder)
    assert said.startswith("take.toml: not valid TOML: invalid value (at line 2")
    assert said.endswith('put text in quotes, as in up = "z"; decimals take a point, not a comma')


def test_a_mirrored_camera_is_refused(small_take: SmallTake, refusal: Refusal) -> None:
    folder = small_take()
    path = folder / "calibration.toml"
    lines = path.read_text().splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("rotation"))
    after = next(i for i, line in enumerate(lines[first:], first) if line.startswith("translation"))
    lines[first:after] = ["rotation = [[1, 0, 0], [0, 1, 0], [0, 0, -1]]"]
    path.write_text("\n".join(lines))
    assert refusal(folder).startswith(
        "calibration.toml: [cam01] rotation: not a rotation (determinant -1, mirrored axes): export it again"
    )
