from pathlib import Path

import numpy as np
import pytest

from services.mocap.body.actor import Actor, Body, build_body
from services.mocap.body.kinematics import joint_positions
from services.mocap.body.skeleton import DOF_INDEX, LOWER, UPPER
from services.mocap.errors import UserError
from services.mocap.export.bvh import write_bvh
from services.mocap.synth.bvh_file import read_bvh
from services.mocap.synth.motions import perform_bvh
from services.mocap.synth.rest_pose import read_rest_pose
from services.mocap.synth.retarget import joint_errors_m, retarget
from services.mocap.synth.rounds import dance
from services.mocap.synth.take import write_synthetic_take
from services.mocap.synth.walk import STAND_S
from services.mocap.types import Floats

MIXAMO = {
    "pelvis": "Hips", "waist": "Spine", "shoulder": "Arm", "elbow": "ForeArm", "wrist": "Hand",
    "hip": "UpLeg", "knee": "Leg", "ankle": "Foot", "neck": "Neck", "head": "Head",
}  # fmt: skip
CMU = Path(__file__).resolve().parents[3] / "../shared/data/motions/cmu_12_01_walk.bvh"


@pytest.fixture(scope="module")
def danced(synth_body: Body) -> Floats:
    return dance(200, 15.0, synth_body)[10::10]


@pytest.fixture(scope="module")
def own_file(tmp_path_factory: pytest.TempPathFactory, danced: Floats, synth_body: Body) -> Path:
    path = tmp_path_factory.mktemp("bvh") / "own.bvh"
    write_bvh(path, danced, synth_body.offsets_m, 15.0)
    return path


def _retargeted(path: Path, body: Body, n: int) -> tuple[Floats, float]:
    motion = read_bvh(path)
    rest = read_rest_pose(motion, path)
    places, R = motion.sample(np.arange(n) * motion.frame_s)
    poses = retarget(places, R, rest, body)
    return poses, float(joint_errors_m(places, R, rest, poses, body).mean())


def _renamed(text: str) -> str:
    lines = text.split("\n")
    for i, line in enumerate(lines):
        words = line.split()
        if words and words[0] in ("ROOT", "JOINT"):
            side, _, joint = words[1].rpartition("_")
            lines[i] = f"{words[0]} mixamorig:{side.capitalize()}{MIXAMO[joint]}"
    return "\n".join(lines)


def _check_same(found: Floats, poses: Floats, body: Body) -> None:
    difference = found - poses
    heading = DOF_INDEX["root_heading"]
    difference[:, heading] -= 2 * np.pi * np.round(difference[:, heading] / (2 * np.pi))
    assert np.abs(difference).max() < 1e-3
    way_m = joint_positions(found, body.offsets_m) - joint_positions(poses, body.offsets_m)
    assert np.linalg.norm(way_m, axis=2).max() < 1e-3


@pytest.mark.parametrize("unit", ["m", "cm"])
def test_our_own_file_gives_our_poses_back(
    tmp_path: Path, danced: Floats, synth_body: Body, unit: str
) -> None:
    path = tmp_path / "own.bvh"
    write_bvh(path, danced, synth_body.offsets_m, 15.0, unit="cm" if unit == "cm" else "m")
    found, error_m = _retargeted(path, synth_body, len(danced))
    _check_same(found, danced, synth_body)
    assert error_m < 1e-5


def test_other_names_are_the_same_motion(
    tmp_path: Path, own_file: Path, danced: Floats, synth_body: Body
) -> None:
    path = tmp_path / "mixamo.bvh"
    path.write_text(_renamed(own_file.read_text()).replace("\n", "\r\n"))
    _check_same(_retargeted(path, synth_body, len(danced))[0], danced, synth_body)


def test_another_body_moves_alike(own_file: Path, danced: Floats) -> None:
    small = build_body(Actor(height=1.2))
    found, error_m = _retargeted(own_file, small, len(danced))
    np.testing.assert_allclose(found[:, 6:], danced[:, 6:], atol=1e-3)
    np.testing.assert_allclose(found[:, :3], danced[:, :3] * 1.2 / 1.75, atol=1e-3)
    assert error_m < 1e-4


@pytest.mark.parametrize("lost", ["", "ROOT pelvis", "JOINT waist"])
def test_the_waist_turns_as_in_the_file(tmp_path: Path, danced: Floats, synth_body: Body, lost: str) -> None:
    """Without a name for the pelvis, all that is told is the turn of the trunk as a whole."""
    bending = danced.copy()
    for name, degrees in (("waist_pitch", 25.0), ("waist_lean", -12.0), ("waist_turn", 20.0)):
        bending[:, DOF_INDEX[name]] = np.radians(degrees) * np.linspace(-0.5, 1.0, len(danced))
    path = tmp_path / "bending.bvh"
    write_bvh(path, bending, synth_body.offsets_m, 15.0)
    if lost:
        path.write_text(path.read_text().replace(lost, lost.split()[0] + " thing"))
    found, error_m = _retargeted(path, synth_body, len(danced))
    if lost == "ROOT pelvis":
        assert error_m < 0.02
        return
    _check_same(found, bending, synth_body)
    assert error_m < 1e-5


@pytest.mark.skipif(not CMU.exists(), reason="the shared motions are not here")
def test_a_real_walk_is_performed(synth_body: Body) -> None:
    made = perform_bvh(CMU, None, 0.0, 15.0, synth_body)
    assert made.joint_error_m < 0.04
    assert (made.poses >= LOWER).all()
    assert (made.poses <= UPPER).all()
    assert len(made.poses) == int((STAND_S + 4.35) * 15) + 1
    lowest_m = np.array([synth_body.lowest_point_m(pose) for pose in made.poses])
    assert np.abs(lowest_m).max() < 0.02
    assert np.abs(np.diff(made.poses[:, 6:], axis=0)).max() * 15 < 12
    assert np.linalg.norm(np.ptp(made.poses[:, :2], axis=0)) == pytest.approx(4.1, abs=0.1)


def test_a_part_of_a_file_makes_a_take(tmp_path: Path, own_file: Path) -> None:
    made = write_synthetic_take(
        tmp_path / "take", motion=str(own_file), n_frames=14, start_s=0.2, n_cameras=1, height_m=1.6
    )
    assert len(made.poses) == 14
    assert made.joint_error_m is not None
    assert made.joint_error_m < 1e-4
    still = int(STAND_S * 15)
    np.testing.assert_allclose(made.poses[:still], made.poses[:1].repeat(still, axis=0))


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda _: "solid cube", "expected a BVH file, with the words HIERARCHY and MOTION"),
        (
            lambda text: text.replace("JOINT left_knee", "JOINT thing"),
            "has no joint for the actor's left knee",
        ),
        (lambda text: text.partition("Frame Time")[0] + "Frame Time: 0.1\n", "MOTION: has no frames"),
        (lambda text: text + "nan\n", "MOTION: expected finite numbers"),
        (lambda text: text + "1.0 2.0\n", "MOTION: expected 51 numbers for each frame"),
        (lambda text: text + "1.0 two\n", "MOTION: expected numbers only"),
        (lambda text: text.replace("OFFSET", "OFFSET x", 1), "OFFSET of pelvis: expected 3 numbers"),
        (lambda text: text.replace("Xrotation", "Wrotation", 1), "CHANNELS of pelvis: 'wrotation'"),
        (lambda text: text.replace("Frame Time: 0", "Frame Time: -1"), "Frame Time: expected seconds"),
        (lambda text: text.replace("}\nMOTION", "MOTION"), "every { closed by a }"),
    ],
)
def test_refuses_in_one_sentence(tmp_path: Path, own_file: Path, synth_body: Body, change, sentence) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path / "broken.bvh"
    path.write_text(change(own_file.read_text()))
    with pytest.raises(UserError) as error:
        perform_bvh(path, None, 0.0, 15.0, synth_body)
    assert str(error.value).startswith(f"{path}: ")
    assert sentence in str(error.value)
    assert "\n" not in str(error.value)


def test_refuses_more_than_a_file_holds(own_file: Path, synth_body: Body) -> None:
    with pytest.raises(
        UserError, match=r"lasts 1\.20 s: expected a start within it and, from there, at most"
    ):
        perform_bvh(own_file, 500, 0.0, 15.0, synth_body)
    with pytest.raises(UserError, match=r"cannot be read"):
        perform_bvh(own_file.parent, None, 0.0, 15.0, synth_body)
