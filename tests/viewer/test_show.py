"""Where the page's scene puts bodies and cameras."""

from queue import Queue

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.kinematics import N_DOF, SEGMENT_JOINTS, segment_transforms
from services.mocap.body.skeleton import SEGMENT_PARENTS
from services.mocap.camera.rig import Rig
from services.mocap.take.folder import Take
from services.mocap.types import Floats
from services.viewer.controls import Controls
from services.viewer.frame_history import FrameHistory
from services.viewer.page_words import show_words
from services.viewer.show import Show, frusta_of, placed_segments


@pytest.mark.parametrize(
    ("colours", "said"), [({}, []), ({"head": (1, 1, 1, 1), "left_hand": (2, 2, 2, 2)}, ["head", "hand"])]
)
def test_colour_classes_can_be_chosen_where_there_are_any(
    colours: dict[str, tuple[int, ...]], said: list[str]
) -> None:
    body = build_body(Actor(colours=colours))
    show = Show("walk", 15.0, FrameHistory(range(3)), body, None, (), None, is_live=False)
    words = show_words(show, (), Controls(Queue(), show))
    assert ("colours" in words["contents"]) == bool(said)
    assert [part for _, part in words["legends"]["colours"]] == said


def test_a_frustum_is_its_camera(walk: Take) -> None:
    for camera, lens in zip(walk.cameras, frusta_of(Rig.of(walk.cameras)), strict=True):
        np.testing.assert_allclose(lens.position_m, camera.centre_world_m, atol=1e-9)
        R_world_camera = Rotation.from_quat(np.roll(lens.wxyz, -1)).as_matrix()
        np.testing.assert_allclose(R_world_camera, camera.R_camera_world.T, atol=1e-9)
        assert np.isclose(lens.fov_rad, 2 * np.arctan(camera.height_px / 2 / camera.K[1, 1]))
        assert lens.aspect == camera.width_px / camera.height_px


def test_a_projection_of_any_sign_is_the_same_camera(walk: Take) -> None:
    rig = Rig.of(walk.cameras)
    turned = Rig(-2.0 * rig.P_px_world, rig.sizes_px)
    for ours, theirs in zip(frusta_of(rig), frusta_of(turned), strict=True):
        np.testing.assert_allclose(ours.position_m, theirs.position_m, atol=1e-9)
        np.testing.assert_allclose(abs(ours.wxyz @ theirs.wxyz), 1.0)


def test_segments_stand_where_kinematics_has_them() -> None:
    body = build_body(Actor(height=1.8))
    pose = np.random.default_rng(3).uniform(-0.4, 0.4, N_DOF)
    wxyz, root_m = placed_segments(body, pose)
    T_world_segment = segment_transforms(pose[None], body.offsets_m)[0]
    turns = Rotation.from_quat(np.roll(wxyz, -1, axis=1)).as_matrix()
    T_world: dict[str | None, Floats] = {None: np.eye(4)}
    for s, (name, parent) in enumerate(SEGMENT_PARENTS.items()):
        T = np.eye(4)
        T[:3, :3] = turns[s]
        T[:3, 3] = root_m if parent is None else body.offsets_m[SEGMENT_JOINTS[s]]
        T_world[name] = T_world[parent] @ T
        np.testing.assert_allclose(T_world[name], T_world_segment[s], atol=1e-9, err_msg=name)
