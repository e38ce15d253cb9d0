"""All there is, with a skeleton whose skull turns on the neck and whose feet turn on the shanks.

test_another_skeleton.py runs it. The table is changed before anything is imported that is derived from it, so
this needs a process of its own, and a folder of its own for compiled code, which takes the table in as
constants.
"""

from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from services.mocap.body import skeleton_table
from services.mocap.body.segment_row import Parameter, Turns

_SKULL = (
    Parameter("skull_pitch", "swing", (0.0, 1.0, 0.0), -30.0, 40.0, rest=0.1, in_paper=False),
    Parameter("skull_lean", "swing", (1.0, 0.0, 0.0), -30.0, 30.0, rest=0.1, in_paper=False),
    Parameter("skull_turn", "twist", (0.0, 0.0, 1.0), -40.0, 40.0, rest=0.3, in_paper=False),
)
_ANGLES = Turns(
    "ZXY",
    (
        ("skull_flexion", -1, "chin to the throat"),
        ("skull_lateral_bending", 1, "ear to the right shoulder"),
        ("skull_rotation", 1, "face to the left, on the neck"),
    ),
)
_FOOT_TURN = Parameter("ankle_turn", "twist", (0.0, 0.0, -1.0), -30.0, 30.0, rest=0.1)
_KNOWN_DOFS = sum((2 if row.paired else 1) * len(row.parameters) for row in skeleton_table.ROWS)
_CHANGED = {
    "head": {"parameters": _SKULL, "angles": (_ANGLES,)},
    "foot": {"parameters": (*skeleton_table.FOOT.parameters, _FOOT_TURN)},
}
skeleton_table.ROWS = tuple(replace(row, **_CHANGED.get(row.name, {})) for row in skeleton_table.ROWS)  # type: ignore[assignment, arg-type]

# Only now, as they take the table in.
from proto.framing import decode, encode  # noqa: E402
from proto.messages import LimbTask, Recording  # noqa: E402
from services.library import track, write_result  # noqa: E402
from services.mocap.body.actor import Actor, build_body  # noqa: E402
from services.mocap.body.kinematics import N_DOF, joint_positions, segment_transforms  # noqa: E402
from services.mocap.body.skeleton import DOF_INDEX, DOFS, JOINT_NAMES, SEGMENT_NAMES, BodyName  # noqa: E402
from services.mocap.camera.rig import Rig  # noqa: E402
from services.mocap.energy.bitplanes import TriPlanes, unpack  # noqa: E402
from services.mocap.energy.cpu.backend import CpuBackend  # noqa: E402
from services.mocap.energy.picture import Picture, Region  # noqa: E402
from services.mocap.export.formats import FORMATS  # noqa: E402
from services.mocap.fit.fitting import fit_actor  # noqa: E402
from services.mocap.motion.smoothing import rts  # noqa: E402
from services.mocap.search.chains import ALL_SURFACES, HEAD, LIMBS, TORSO  # noqa: E402
from services.mocap.search.first_pose import turned_round  # noqa: E402
from services.mocap.search.model import Model  # noqa: E402
from services.mocap.search.settings import SearchSettings  # noqa: E402
from services.mocap.search.stages import whole_body_energy  # noqa: E402
from services.mocap.synth.studio import studio_cameras  # noqa: E402
from services.mocap.take.folder import Take, open_take  # noqa: E402
from services.mocap.take.layout import silhouette_folder, silhouette_path  # noqa: E402
from services.mocap.take.settings import TakeSettings  # noqa: E402
from services.mocap.take.writer import take_writer, write_picture  # noqa: E402
from services.mocap.types import Floats  # noqa: E402
from services.pose_size import with_whole_poses  # noqa: E402

ACTOR = Actor(height=1.75)
BODY = build_body(ACTOR)
CAMERAS = studio_cameras(6)
RIG = Rig.of(CAMERAS)
MODEL = Model(BODY, RIG, CpuBackend(BODY, RIG))
SKULL = [DOF_INDEX[parameter.name] for parameter in _SKULL]
FEET = [DOF_INDEX[f"{side}_ankle_turn"] for side in ("left", "right")]
NEW = [*SKULL, *FEET]
N_FRAMES = 3


def poses() -> Floats:
    """(3, D) upright, arms half down, nodding and turning the feet outward more and more."""
    made = np.zeros((N_FRAMES, N_DOF))
    made[:, 2] = BODY.pelvis_height_m
    for side in ("left", "right"):
        made[:, DOF_INDEX[f"{side}_shoulder_elevation"]] = np.radians(-50)
        made[:, DOF_INDEX[f"{side}_elbow_flexion"]] = np.radians(20)
        made[:, DOF_INDEX[f"{side}_hip_abduction"]] = np.radians(8)
    made[:, DOF_INDEX["skull_pitch"]] = np.radians([22, 26, 30])
    made[:, DOF_INDEX["skull_lean"]] = np.radians([10, 13, 16])
    made[:, FEET] = np.radians([[-20], [-22], [-24]])
    return made


TRUTH = poses()
SEEN = MODEL.backend.coverage(TRUTH, ALL_SURFACES, Region.whole(RIG))


def off_mm(found: Floats, truth: Floats) -> float:
    """Mean distance of what ends head and feet: of the vertices of their segments."""
    return 1000.0 * float(np.linalg.norm(_ends_m(found) - _ends_m(truth), axis=-1).mean())


def _ends_m(poses: Floats) -> Floats:
    T = segment_transforms(np.atleast_2d(poses), BODY.offsets_m)
    of_segments = []
    for name in ("head", "left_foot", "right_foot"):
        s = SEGMENT_NAMES.index(name)
        of_segments.append(BODY.vertices_m[s] @ T[:, s, :3, :3].swapaxes(1, 2) + T[:, s, None, :3, 3])
    return np.concatenate(of_segments, axis=1)


def straightened(pose: Floats) -> Floats:
    straight = pose.copy()
    straight[NEW] = 0.0
    return straight


@pytest.fixture(scope="module")
def take(tmp_path_factory: pytest.TempPathFactory) -> Take:
    folder = tmp_path_factory.mktemp("takes") / "nod"
    settings = TakeSettings(name="nod", fps=10.0, units="m", up="z", frames=N_FRAMES)
    with take_writer(folder, settings, CAMERAS) as part:
        for frame, planes in enumerate(SEEN):
            for camera, mask in zip(CAMERAS, unpack(planes, len(CAMERAS)), strict=True):
                write_picture(silhouette_path(silhouette_folder(part, camera.name), frame), mask)
    return open_take(folder)


def test_every_parameter_is_in_one_chain() -> None:
    assert _KNOWN_DOFS + len(NEW) == N_DOF
    assert set(SKULL) < set(HEAD.dofs)
    assert FEET[0] in LIMBS["left_leg"].extremity.dofs
    chains = (*TORSO.dofs, *HEAD.dofs, *(d for limb in LIMBS.values() for d in limb.dofs))
    assert sorted(chains) == list(range(N_DOF))


def test_kinematics_turn_what_is_above_the_neck() -> None:
    pose = np.zeros((1, N_DOF))
    rest = joint_positions(pose, BODY.offsets_m)[0]
    pose[0, DOF_INDEX["skull_pitch"]] = np.radians(30)
    moved = np.linalg.norm(joint_positions(pose, BODY.offsets_m)[0] - rest, axis=1) > 1e-6
    assert [name for name, is_moved in zip(JOINT_NAMES, moved, strict=True) if is_moved] == ["head_top"]


def test_who_faces_the_other_way_nods_and_leans_the_other_way() -> None:
    pose = TRUTH[0].copy()
    pose[[*SKULL[2:], *FEET]] = 0.1, 0.2, 0.3
    turned = turned_round(pose)
    np.testing.assert_allclose(turned[SKULL], [-1, -1, 1] * pose[SKULL])
    np.testing.assert_allclose(turned[FEET], pose[FEET[::-1]])


def test_energy_sees_the_parameters() -> None:
    picture = Picture.whole(RIG, SEEN[0])
    energy = whole_body_energy(MODEL, picture, SearchSettings(detail_px=0.0))
    exact, straight = energy(np.stack([TRUTH[0], straightened(TRUTH[0])]))
    assert exact == 0
    assert straight > 300


@pytest.mark.parametrize("body", get_args(BodyName))
def test_alignment_finds_the_parameters_that_the_body_has(body: BodyName) -> None:
    settings, start = SearchSettings(body=body), straightened(TRUTH[0])
    found = MODEL.aligner(settings).align(Picture.whole(RIG, SEEN[0]), start, settings).pose
    assert found[FEET].any()
    assert found[SKULL].any() == (body == "anatomical")
    if body == "anatomical":
        assert off_mm(found, TRUTH[0]) < 0.5 * off_mm(start, TRUTH[0])


def test_a_fit_finds_poses() -> None:
    guess = TRUTH[0].copy()
    guess[NEW] *= 0.7
    fit = fit_actor(RIG, TriPlanes.sure(SEEN[:2]), ACTOR, guess)
    assert fit.poses.shape == (2, N_DOF)
    assert off_mm(fit.poses[0], TRUTH[0]) < 20


def test_the_protocol_carries_them() -> None:
    task = LimbTask(
        take="nod", run="0" * 32, frame=0, pass_index=0, limb="left_arm", shard=0, shards=1, actor="a" * 64,
        rig="b" * 64, search={}, pose=TRUTH[0], origin_px=np.zeros((6, 2), np.int32),
        window=np.zeros((1, 4, 6), np.uint8),
    )  # fmt: skip
    recording = Recording(
        take="nod", run="", plan="", shards=1, end_frame=2, retries=0, worker_backends={}, memory={},
        poses=TRUTH[:2], actor=np.zeros(0, np.uint8),
    )  # fmt: skip
    for message in (task, recording):
        arrived = with_whole_poses(decode([bytes(frame) for frame in encode(message)]))
        assert arrived.model_dump().keys() == message.model_dump().keys()
    assert isinstance(arrived, Recording)
    np.testing.assert_array_equal(arrived.poses, TRUTH[:2])


@pytest.mark.parametrize("body", get_args(BodyName))
def test_the_papers_search_finds_the_parameters_that_the_body_has(take: Take, body: BodyName) -> None:
    paper = SearchSettings(method="paper", body=body)
    (found,) = track(take, ACTOR, range(1), straightened(TRUTH[0]), search=paper)
    assert found.solution.pose[SKULL].any() == (body == "anatomical")
    if body == "anatomical":
        assert off_mm(found.solution.pose, TRUTH[0]) < 0.5 * off_mm(straightened(TRUTH[0]), TRUTH[0])


def test_a_take_is_tracked_and_exported(take: Take, tmp_path: Path) -> None:
    tracked = list(track(take, ACTOR, first_pose=straightened(TRUTH[0])))
    found = np.array([frame.solution.pose for frame in tracked])
    assert off_mm(found, TRUTH) < 25
    assert rts(found, 10.0, 5.0).shape == found.shape
    result = write_result(tmp_path / "result", take, ACTOR, tracked, tuple(FORMATS))
    files = {path.name for path in (tmp_path / "result").iterdir()}
    assert {file for form in FORMATS.values() for file in form.files} <= files
    header, first = (tmp_path / "result" / "poses.csv").read_text().splitlines()[:2]
    assert [dof.column for dof in DOFS] == [
        name for name in header.split(",") if name in {dof.column for dof in DOFS}
    ]
    assert len(first.split(",")) == len(header.split(","))
    nodded_deg = result.angles_deg["skull_flexion"] + result.angles_deg["neck_flexion"]
    np.testing.assert_allclose(nodded_deg[-1], 30, atol=8)
    assert "Xrotation" in (tmp_path / "result" / "motion.bvh").read_text()
    assert len(result.motion.body.vertices_m) == len(SEGMENT_NAMES)
