"""All there is, with a skeleton whose waist has three parameters; test_bending_spine.py runs it.

The table is changed before anything is imported that is derived from it, so this needs a process of its own,
and a folder of its own for compiled code, which takes the table in as constants.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from services.mocap.body import skeleton_table
from services.mocap.body.segment_row import Parameter, Turns

_WAIST = (
    Parameter("waist_pitch", "swing", (0.0, 1.0, 0.0), -30.0, 60.0),
    Parameter("waist_lean", "swing", (1.0, 0.0, 0.0), -30.0, 30.0),
    Parameter("waist_turn", "twist", (0.0, 0.0, 1.0), -40.0, 40.0),
)
_ANGLES = Turns(
    "ZXY",
    (
        ("trunk_flexion", -1, "trunk forward over the pelvis"),
        ("trunk_lateral_bending", 1, "trunk to the right"),
        ("trunk_rotation", 1, "trunk to the left"),
    ),
)
_PAPER_DOFS = sum((2 if row.paired else 1) * len(row.parameters) for row in skeleton_table.ROWS)
_BENDING = replace(skeleton_table.TORSO, parameters=_WAIST, angles=(_ANGLES,))
skeleton_table.ROWS = tuple(_BENDING if row is skeleton_table.TORSO else row for row in skeleton_table.ROWS)  # type: ignore[assignment]

# Only now, as they take the table in.
from proto.framing import decode, encode  # noqa: E402
from proto.messages import LimbTask, Recording  # noqa: E402
from services.library import track, write_result  # noqa: E402
from services.mocap.body.actor import Actor, build_body  # noqa: E402
from services.mocap.body.kinematics import N_DOF, joint_positions  # noqa: E402
from services.mocap.body.skeleton import DOF_INDEX, DOFS, JOINT_NAMES, SEGMENT_NAMES  # noqa: E402
from services.mocap.camera.rig import Rig  # noqa: E402
from services.mocap.energy.bitplanes import TriPlanes, unpack  # noqa: E402
from services.mocap.energy.cost import Cost  # noqa: E402
from services.mocap.energy.cpu.backend import CpuBackend  # noqa: E402
from services.mocap.energy.picture import Picture, Region  # noqa: E402
from services.mocap.export.formats import FORMATS  # noqa: E402
from services.mocap.fit.fitting import fit_actor  # noqa: E402
from services.mocap.motion.smoothing import rts  # noqa: E402
from services.mocap.search.chains import ALL_SEGMENTS, HEAD, LIMBS, TORSO  # noqa: E402
from services.mocap.search.first_pose import _turned_round  # noqa: E402
from services.mocap.search.model import Model  # noqa: E402
from services.mocap.search.settings import SearchSettings  # noqa: E402
from services.mocap.search.stages import whole_body_energy  # noqa: E402
from services.mocap.synth.studio import studio_cameras  # noqa: E402
from services.mocap.take.folder import Take, open_take  # noqa: E402
from services.mocap.take.settings import TakeSettings  # noqa: E402
from services.mocap.take.writer import take_writer  # noqa: E402
from services.mocap.types import Floats  # noqa: E402
from services.pose_size import with_whole_poses  # noqa: E402

ACTOR = Actor(height=1.75)
BODY = build_body(ACTOR)
CAMERAS = studio_cameras(6)
RIG = Rig.of(CAMERAS)
MODEL = Model(BODY, RIG, CpuBackend(BODY, RIG))
WAIST = [DOF_INDEX[parameter.name] for parameter in _WAIST]
N_FRAMES = 3


def poses() -> Floats:
    """(3, D) upright, arms half down, bowing and leaning more and more."""
    made = np.zeros((N_FRAMES, N_DOF))
    made[:, 2] = BODY.pelvis_height_m
    for side in ("left", "right"):
        made[:, DOF_INDEX[f"{side}_shoulder_elevation"]] = np.radians(-50)
        made[:, DOF_INDEX[f"{side}_elbow_flexion"]] = np.radians(20)
    made[:, DOF_INDEX["waist_pitch"]] = np.radians([16, 20, 24])
    made[:, DOF_INDEX["waist_lean"]] = np.radians([4, 7, 10])
    return made


TRUTH = poses()
SEEN = MODEL.backend.coverage(TRUTH, ALL_SEGMENTS, Region.whole(RIG))


def off_mm(found: Floats, truth: Floats) -> float:
    """Mean distance of the joints."""
    found_m, true_m = (joint_positions(np.atleast_2d(p), BODY.offsets_m) for p in (found, truth))
    return 1000.0 * float(np.linalg.norm(found_m - true_m, axis=2).mean())


def straightened(pose: Floats) -> Floats:
    straight = pose.copy()
    straight[WAIST] = 0.0
    return straight


@pytest.fixture(scope="module")
def take(tmp_path_factory: pytest.TempPathFactory) -> Take:
    folder = tmp_path_factory.mktemp("takes") / "bow"
    settings = TakeSettings(name="bow", fps=10.0, units="m", up="z", frames=N_FRAMES)
    with take_writer(folder, settings, CAMERAS) as writer:
        for frame, planes in enumerate(SEEN):
            for camera, mask in zip(CAMERAS, unpack(planes, len(CAMERAS)), strict=True):
                writer.silhouette(camera, frame, mask)
    return open_take(folder)


def test_the_waist_has_parameters_and_the_torsos_stage_finds_them() -> None:
    assert _PAPER_DOFS + len(WAIST) == N_DOF
    assert set(WAIST) < set(TORSO.dofs)
    chains = (*TORSO.dofs, *HEAD.dofs, *(d for limb in LIMBS.values() for d in limb.dofs))
    assert sorted(chains) == list(range(N_DOF))


def test_kinematics_turn_what_is_above_the_waist() -> None:
    pose = np.zeros((1, N_DOF))
    rest = joint_positions(pose, BODY.offsets_m)[0]
    pose[0, DOF_INDEX["waist_turn"]] = np.radians(30)
    moved = np.linalg.norm(joint_positions(pose, BODY.offsets_m)[0] - rest, axis=1) > 1e-6
    arms = {name for name in JOINT_NAMES if name.endswith(("shoulder", "elbow", "wrist"))}
    assert {name for name, is_moved in zip(JOINT_NAMES, moved, strict=True) if is_moved} - {
        "head", "head_top"
    } == arms  # fmt: skip


def test_who_faces_the_other_way_bows_and_leans_the_other_way() -> None:
    turned = _turned_round(TRUTH[0])
    np.testing.assert_allclose(turned[WAIST], [-1, -1, 1] * TRUTH[0, WAIST])


def test_energy_sees_the_waist() -> None:
    picture = Picture.whole(RIG, SEEN[0])
    energy = whole_body_energy(MODEL, picture, TRUTH[0], Cost(), 0.0)
    exact, straight = energy(np.stack([TRUTH[0], straightened(TRUTH[0])]))
    assert exact == 0
    assert straight > 1000


def test_alignment_finds_the_waist() -> None:
    settings = SearchSettings()
    aligned = MODEL.aligner(settings).align(Picture.whole(RIG, SEEN[0]), straightened(TRUTH[0]), settings)
    assert off_mm(aligned.pose, TRUTH[0]) < 0.5 * off_mm(straightened(TRUTH[0]), TRUTH[0])


def test_a_fit_finds_poses() -> None:
    guess = TRUTH[0].copy()
    guess[WAIST] *= 0.7
    fit = fit_actor(RIG, TriPlanes.sure(SEEN[:2]), ACTOR, guess)
    assert fit.poses.shape == (2, N_DOF)
    assert off_mm(fit.poses[0], TRUTH[0]) < 20


def test_the_protocol_carries_it() -> None:
    task = LimbTask(
        take="bow", run="0" * 32, frame=0, pass_index=0, limb="left_arm", shard=0, shards=1, actor="a" * 64,
        rig="b" * 64, search={}, pose=TRUTH[0], origin_px=np.zeros((6, 2), np.int32),
        window=np.zeros((1, 4, 6), np.uint8),
    )  # fmt: skip
    recording = Recording(
        take="bow", run="", plan="", shards=1, end_frame=2, retries=0, worker_backends={}, memory={},
        poses=TRUTH[:2], actor=np.zeros(0, np.uint8),
    )  # fmt: skip
    for message in (task, recording):
        arrived = with_whole_poses(decode([bytes(frame) for frame in encode(message)]))
        assert arrived.model_dump().keys() == message.model_dump().keys()
    assert isinstance(arrived, Recording)
    np.testing.assert_array_equal(arrived.poses, TRUTH[:2])


def test_the_papers_search_finds_the_waist(take: Take) -> None:
    paper = SearchSettings(method="paper")
    (found,) = track(take, ACTOR, range(1), straightened(TRUTH[0]), search=paper)
    assert off_mm(found.solution.pose, TRUTH[0]) < 0.5 * off_mm(straightened(TRUTH[0]), TRUTH[0])


def test_a_take_is_tracked_and_exported(take: Take, tmp_path: Path) -> None:
    tracked = list(track(take, ACTOR, first_pose=straightened(TRUTH[0])))
    found = np.array([frame.solution.pose for frame in tracked])
    assert off_mm(found, TRUTH) < 25
    np.testing.assert_allclose(found[-1, WAIST[:2]], TRUTH[-1, WAIST[:2]], atol=np.radians(6))
    assert rts(found, 10.0, 5.0).shape == found.shape
    result = write_result(tmp_path / "result", take, ACTOR, tracked, tuple(FORMATS))
    files = {path.name for path in (tmp_path / "result").iterdir()}
    assert {file for form in FORMATS.values() for file in form.files} <= files
    header, first = (tmp_path / "result" / "poses.csv").read_text().splitlines()[:2]
    assert [dof.column for dof in DOFS] == [
        name for name in header.split(",") if name in {dof.column for dof in DOFS}
    ]
    assert len(first.split(",")) == len(header.split(","))
    np.testing.assert_allclose(result.angles_deg["trunk_flexion"][-1], 24, atol=8)
    assert "Xrotation" in (tmp_path / "result" / "motion.bvh").read_text()
    assert len(result.motion.body.vertices_m) == len(SEGMENT_NAMES)
