"""First frames that cannot be tracked end in a sentence; single bad cameras are named and left out."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import unpack
from services.mocap.errors import CertainError, TakeError
from services.mocap.search.hull import carve
from services.mocap.search.model import Model
from services.mocap.search.plausibility import FirstLook, look_first
from services.mocap.types import Bytes, Floats, Mask

Poser = Callable[..., Floats]
Masks = Callable[..., Mask]
NAMES = [f"cam{c + 1:02d}" for c in range(8)]
A_POSE = {"shoulder_elevation": -45, "hip_abduction": 6}


@pytest.fixture(scope="session")
def masks(model: Model, standing: Poser, silhouettes_of: Callable[[Floats], Bytes]) -> Masks:
    """`masks(x_m, y_m, z_m, **degrees)`: what the cameras (8, H, W) see of someone there."""

    def make(x_m: float = 0.3, y_m: float = -0.2, z_m: float = 0.0, **degrees: float) -> Mask:
        pose = standing(**degrees)
        pose[:3] = x_m, y_m, pose[2] + z_m
        return unpack(silhouettes_of(pose), model.rig.n_cameras)

    return make


def turned(rig: Rig, camera: int, degrees: float, axis: str = "z") -> Rig:
    """The rig with one camera turned about the vertical, or another axis of the world, through its centre."""
    P = rig.P_px_world.copy()
    M = P[camera, :, :3]
    centre_m = -np.linalg.solve(M, P[camera, :, 3])
    M = M @ Rotation.from_euler(axis, degrees, degrees=True).as_matrix()
    P[camera] = np.hstack([M, -(M @ centre_m)[:, None]])
    return Rig(P, rig.sizes_px)


def some(rig: Rig, silhouettes: Mask, cameras: list[int]) -> tuple[Rig, Mask]:
    return Rig(rig.P_px_world[cameras], rig.sizes_px[cameras]), silhouettes[cameras]


@settings(max_examples=8, deadline=None)
@given(
    x_m=st.floats(-0.5, 0.5),
    y_m=st.floats(-0.5, 0.5),
    heading=st.floats(-180, 180),
    elevation=st.floats(-85, 60),
    stride=st.floats(-30, 30),
    cameras=st.sets(st.integers(0, 7), min_size=3),
)
def test_nothing_is_said_of_an_actor_alone(
    model: Model,
    masks: Masks,
    x_m: float,
    y_m: float,
    heading: float,
    elevation: float,
    stride: float,
    cameras: set[int],
) -> None:
    pose = {"root_heading": heading, "shoulder_elevation": elevation, "left_hip_flexion": stride}
    seen = masks(x_m, y_m, right_hip_flexion=-stride, **pose)
    assert look_first(*some(model.rig, seen, sorted(cameras))) == FirstLook((), (), seen)


@pytest.mark.parametrize("camera", [0, 5])
@pytest.mark.parametrize("value", [False, True])
def test_an_empty_or_full_camera_is_left_out(model: Model, masks: Masks, camera: int, value: bool) -> None:
    seen = masks(**A_POSE)
    seen[camera] = value
    look = look_first(model.rig, seen, NAMES)
    assert look.left_out == (camera,)
    (remark,) = look.remarks
    assert NAMES[camera] in remark
    assert "left out" in remark
    believed = look.believed(seen)
    assert not believed[camera].any()
    kept = [c for c in range(8) if c != camera]
    np.testing.assert_array_equal(believed[kept], seen[kept])


@pytest.mark.parametrize("cameras", [[0, 1, 2, 3, 4, 5, 6, 7], [0, 2, 3, 5, 6]])
@pytest.mark.parametrize("degrees", [8, -15])
def test_the_camera_that_disagrees_is_named(
    model: Model, masks: Masks, cameras: list[int], degrees: float
) -> None:
    rig, seen = some(model.rig, masks(**A_POSE), cameras)
    look = look_first(turned(rig, 2, degrees), seen, [NAMES[c] for c in cameras])
    assert look.left_out == (2,)
    assert look.remarks[0].startswith(
        f"calibration.toml: the silhouette of {NAMES[cameras[2]]} does not meet"
    )


def test_two_cameras_taken_for_each_other_are_named(model: Model, masks: Masks) -> None:
    P = model.rig.P_px_world.copy()
    P[[3, 5]] = P[[5, 3]]
    assert look_first(Rig(P, model.rig.sizes_px), masks(**A_POSE), NAMES).left_out == (3, 5)


def test_what_cannot_be_blamed_on_one_camera_is_remarked(model: Model, masks: Masks) -> None:
    """Neighbours taken for each other see about the same of an actor in the middle."""
    P = model.rig.P_px_world.copy()
    P[[1, 2]] = P[[2, 1]]
    look = look_first(Rig(P, model.rig.sizes_px), masks(**A_POSE), NAMES)
    assert look.left_out == ()
    assert look.remarks[0].startswith("calibration.toml: the cameras' silhouettes meet in space only in part")


@pytest.mark.parametrize(
    ("cameras", "camera", "axis", "degrees"),
    [
        ([0, 2, 3, 5], 1, "z", 8),
        ([0, 2, 3, 5], 2, "z", -15),
        ([0, 1, 3, 6], 3, "x", 8),
        ([0, 1, 2, 3], 2, "z", 6),
    ],
)
def test_the_camera_of_four_that_disagrees_is_named(
    model: Model, masks: Masks, cameras: list[int], camera: int, axis: str, degrees: float
) -> None:
    rig, seen = some(model.rig, masks(root_heading=20, **A_POSE), cameras)
    names = [NAMES[c] for c in cameras]
    look = look_first(turned(rig, camera, degrees, axis), seen, names)
    assert look.left_out == (camera,)
    assert look.remarks[0].startswith(f"calibration.toml: the silhouette of {names[camera]} does not meet")


@pytest.mark.parametrize("degrees", [4, -4])
def test_of_four_cameras_in_a_square_the_two_that_may_disagree_are_named(
    model: Model, masks: Masks, degrees: float
) -> None:
    """A camera that turns looks past the actor along the line on which two others face each other."""
    rig, seen = some(model.rig, masks(root_heading=20, **A_POSE), [0, 2, 4, 6])
    names = [NAMES[c] for c in (0, 2, 4, 6)]
    try:
        said = " ".join(look_first(turned(rig, 1, degrees), seen, names).remarks)
    except TakeError as error:
        said = str(error)
    assert "cam03 or cam07 disagrees with the others" in said


def test_with_three_cameras_nobody_is_blamed(model: Model, masks: Masks) -> None:
    rig, seen = some(model.rig, masks(**A_POSE), [0, 2, 5])
    with pytest.raises(TakeError, match=r"^calibration\.toml: .* of 3 cameras none can be singled out"):
        look_first(turned(rig, 1, 12), seen)


@pytest.mark.parametrize("apart_m", [0.9, 1.4])
@pytest.mark.parametrize("cameras", [[0, 1, 2, 3, 4, 5, 6, 7], [0, 2, 4, 6]])
def test_two_people_are_refused(model: Model, masks: Masks, apart_m: float, cameras: list[int]) -> None:
    down = {"shoulder_elevation": -80, "root_heading": 90}
    both = masks(-apart_m / 2, 0.1, **down) | masks(apart_m / 2, -0.1, **down)
    with pytest.raises(TakeError, match=r"^silhouettes: two people"):
        look_first(*some(model.rig, both, cameras))


@pytest.mark.parametrize("camera", [0, 3, 6])
@pytest.mark.parametrize("n_cameras", [8, 6, 5])
def test_furniture_that_cuts_the_actor_in_two_is_no_second_person(
    model: Model, masks: Masks, camera: int, n_cameras: int
) -> None:
    """A table hides the thighs from one camera: what the others see between trunk and shanks counts."""
    rig, seen = some(model.rig, masks(**A_POSE), [(camera + k) % 8 for k in range(n_cameras)])
    rows = np.flatnonzero(seen[0].any(axis=1))
    seen[0, rows[0] + len(rows) // 2 : rows[0] + 3 * len(rows) // 4] = False
    look = look_first(rig, seen)
    assert look.left_out == (0,)


@pytest.mark.parametrize("camera", [0, 3, 6])
@pytest.mark.parametrize("n_cameras", [8, 6])
def test_a_post_before_one_camera_is_no_second_person(
    model: Model, masks: Masks, camera: int, n_cameras: int
) -> None:
    """It cuts the actor in two from top to bottom, and hides hardly anything: the hull stays whole."""
    rig, seen = some(model.rig, masks(**A_POSE), [(camera + k) % 8 for k in range(n_cameras)])
    whole_m = carve(rig, seen).height_m
    middle = round(np.argwhere(seen[0])[:, 1].mean())
    seen[0, :, middle - 7 : middle + 7] = False
    look = look_first(rig, seen)
    assert look.two is None
    assert look.left_out == (0,) or "hides part of the actor from" in "".join(look.remarks)
    assert carve(rig, look.believed(seen), look.possible).height_m == pytest.approx(whole_m, abs=0.04)


@pytest.mark.parametrize("cameras", [[0, 1, 2, 3], [1, 3, 4, 6], [0, 2, 3, 5, 6, 7]])
def test_posts_before_two_cameras_are_no_second_person(
    model: Model, masks: Masks, cameras: list[int]
) -> None:
    """What they hide may be actor, or else the hull would be cut in two."""
    rig, seen = some(model.rig, masks(**A_POSE), cameras)
    cut = seen.copy()
    for k in (1, 2):
        middle = round(np.argwhere(seen[k])[:, 1].mean())
        cut[k, :, middle - 7 : middle + 7] = False
    look = look_first(rig, cut)
    assert look.left_out == ()
    assert sum("something hides part of the actor" in remark for remark in look.remarks) == 2
    assert (look.possible & seen).sum() > 0.9 * seen.sum()  # all but some of the head


def test_furniture_that_hides_the_legs_from_three_cameras_of_eight_is_left_out(
    model: Model, masks: Masks
) -> None:
    seen = masks(**A_POSE)
    for camera in (4, 5, 6):
        rows = np.flatnonzero(seen[camera].any(axis=1))
        seen[camera, rows[0] + len(rows) // 2 :] = False
    assert sorted(look_first(model.rig, seen).left_out) == [4, 5, 6]


def test_an_actor_cut_off_in_most_cameras_is_refused(model: Model, masks: Masks) -> None:
    with pytest.raises(TakeError, match=r"^silhouettes: \d of 8 cameras \(cam0.*\) cut the actor off"):
        look_first(model.rig, masks(z_m=1.0, **A_POSE), NAMES)


def test_so_is_one_in_two_pieces(model: Model, masks: Masks) -> None:
    seen = masks(z_m=1.0, **A_POSE)
    for mask in seen:
        lowest = np.flatnonzero(mask.any(axis=1))[-1]
        mask[lowest // 3 : lowest // 3 + 2] = False
    with pytest.raises(TakeError, match=r"^silhouettes: \d of 8 cameras \(cam0.*\) cut the actor off"):
        look_first(model.rig, seen, NAMES)


def test_a_hand_at_the_edge_is_nothing(model: Model, masks: Masks) -> None:
    seen = masks(**A_POSE)
    seen[:5, 120:124, 0] = True
    assert look_first(model.rig, seen).left_out == ()


def test_specks_at_the_edge_are_nothing(model: Model, masks: Masks) -> None:
    seen = masks(**A_POSE)
    seen[:, 0, 10:60:6], seen[:, 0, 11:60:6] = True, True
    assert look_first(model.rig, seen).left_out == ()


def test_nobody_and_inverted_are_told_apart(model: Model, masks: Masks) -> None:
    seen = masks(**A_POSE)
    with pytest.raises(TakeError, match=r"^silhouettes: nobody is visible .* choose a first frame"):
        look_first(model.rig, np.zeros_like(seen))
    with pytest.raises(CertainError, match=r"^silhouettes: 8 of 8 cameras are white nearly .* invert"):
        look_first(model.rig, ~seen)
    seen[1:] = False
    with pytest.raises(TakeError, match=r"^silhouettes: only 1 of 8 cameras show a person"):
        look_first(model.rig, seen)


def test_the_same_camera_over_and_over_is_said(model: Model, masks: Masks) -> None:
    rig = Rig(model.rig.P_px_world[[3] * 4], model.rig.sizes_px[:4])
    for seen in (masks(**A_POSE)[[3] * 4], masks(**A_POSE)[:4]):
        with pytest.raises(TakeError, match=r"^calibration\.toml: all cameras see the actor in the same dir"):
            look_first(rig, seen)


def test_cameras_that_look_away_are_said(model: Model, masks: Masks) -> None:
    rig, seen = model.rig, masks(**A_POSE)
    for camera in range(8):
        rig = turned(rig, camera, 180)
    mirrored = seen[:, ::-1]  # about where the rays meet again behind the cameras
    with pytest.raises(TakeError, match=r"^calibration\.toml: the cameras' rays meet behind them"):
        look_first(rig, mirrored)
