"""What the `paper` backend holds on the GPU stays bounded, and is all given back."""

from collections.abc import Callable, Iterator
from typing import Any

import moderngl
import numpy as np
import pytest

from services.mocap.body.actor import Body
from services.mocap.body.skeleton import SEGMENT_NAMES, dofs_of, segments_below
from services.mocap.camera.rig import Rig
from services.mocap.energy.backend import Problem
from services.mocap.energy.gl.device import GlDevice, GlLostError
from services.mocap.energy.paper.backend import PaperBackend
from services.mocap.energy.paper.rasteriser import Kept
from services.mocap.energy.picture import Picture, Region
from services.mocap.types import Floats

ALL = tuple(range(len(SEGMENT_NAMES)))
HAND, HAND_DOFS = segments_below("left_wrist"), dofs_of("left_wrist")
MAKERS = ("buffer", "renderbuffer", "depth_renderbuffer", "framebuffer", "vertex_array", "program")
Ring = Callable[[int], Rig]


@pytest.fixture
def alive(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[], int]]:
    """How many GL objects have been made since and not been released."""
    made: list[Any] = []

    def recording(make: Callable[..., Any]) -> Callable[..., Any]:
        def wrapped(*arguments: Any, **named: Any) -> Any:
            made.append(make(*arguments, **named))
            return made[-1]

        return wrapped

    for name in MAKERS:
        monkeypatch.setattr(moderngl.Context, name, recording(getattr(moderngl.Context, name)))
    yield lambda: sum(type(thing.mglo).__name__ != "InvalidObject" for thing in made)


def _hand_problem(rig: Rig, pose: Floats) -> Problem:
    whole = Picture.whole(rig, np.zeros((1, *rig.shape_px), np.uint8))
    return Problem(pose, HAND_DOFS, HAND, whole.window(np.full((rig.n_cameras, 2), 30, np.int32), 16, 16))


def test_close_releases_everything_that_was_made(
    device: GlDevice, coarse_body: Body, ring: Ring, standing_pose: Floats, alive: Callable[[], int]
) -> None:
    backend = PaperBackend(device, coarse_body, ring(9))
    backend.coverage(standing_pose[None], ALL, Region.whole(ring(9)))
    backend.coverage(standing_pose[None], HAND, Region(np.zeros((9, 2), np.int32), 20, 20))
    assert alive() > 10
    backend.close()
    assert alive() == 0


def test_any_number_of_windows_and_segments_needs_a_bounded_number_of_objects(
    device: GlDevice, coarse_body: Body, ring: Ring, standing_pose: Floats, alive: Callable[[], int]
) -> None:
    rig = ring(2)
    backend, problem = PaperBackend(device, coarse_body, rig), _hand_problem(rig, standing_pose)
    energy, values = backend.energy(problem), np.zeros((1, len(HAND_DOFS)))
    before = energy(values)
    for k in range(100):
        origin_px = np.zeros((2, 2), np.int32)
        backend.coverage(
            standing_pose[None], tuple(s for s in ALL if k >> s & 1), Region(origin_px, 9 + k, 9)
        )
    assert alive() < 150
    np.testing.assert_array_equal(energy(values), before)


def test_ten_thousand_evaluations_leave_memory_flat(
    device: GlDevice,
    coarse_body: Body,
    ring: Ring,
    standing_pose: Floats,
    alive: Callable[[], int],
    resident_growth: Callable[[Callable[[], object]], int],
) -> None:
    rig = ring(1)
    energy = PaperBackend(device, coarse_body, rig).energy(_hand_problem(rig, standing_pose))
    values = np.zeros((100, len(HAND_DOFS)))

    def evaluate(times: int) -> None:
        for _ in range(times):
            energy(values)

    evaluate(110)  # a driver may take its own memory meanwhile: NVIDIA's takes 8 MB
    objects = alive()
    assert resident_growth(lambda: evaluate(100)) < 2_000_000
    assert alive() == objects


def test_backends_share_a_device_and_outlive_each_other(
    device: GlDevice, coarse_body: Body, ring: Ring, standing_pose: Floats
) -> None:
    rig = ring(2)
    first, second = PaperBackend(device, coarse_body, rig), PaperBackend(device, coarse_body, rig)
    drawn = first.coverage(standing_pose[None], ALL, Region.whole(rig))
    first.close()
    third = PaperBackend(device, coarse_body, rig)
    for backend in (second, third):
        np.testing.assert_array_equal(backend.coverage(standing_pose[None], ALL, Region.whole(rig)), drawn)
        backend.close()


def test_another_current_context_does_not_matter(
    device: GlDevice, coarse_body: Body, ring: Ring, standing_pose: Floats
) -> None:
    rig = ring(2)
    backend = PaperBackend(device, coarse_body, rig)
    drawn = backend.coverage(standing_pose[None], ALL, Region.whole(rig))
    other = GlDevice()  # becomes the current one
    np.testing.assert_array_equal(backend.coverage(standing_pose[None], ALL, Region.whole(rig)), drawn)
    other.close()
    np.testing.assert_array_equal(backend.coverage(standing_pose[None], ALL, Region.whole(rig)), drawn)


def test_a_closed_device_is_a_lost_one(
    device: GlDevice, coarse_body: Body, ring: Ring, standing_pose: Floats
) -> None:
    rig = ring(2)
    backend = PaperBackend(device, coarse_body, rig)
    energy = backend.energy(_hand_problem(rig, standing_pose))
    device.close()
    with pytest.raises(GlLostError):
        energy(np.zeros((1, len(HAND_DOFS))))
    with pytest.raises(GlLostError):
        backend.coverage(standing_pose[None], ALL, Region.whole(rig))
    backend.close()


def test_kept_values_are_made_once_and_the_one_unused_longest_goes_first() -> None:
    made: list[str] = []
    released: list[str] = []

    def make(key: str) -> str:
        made.append(key)
        return key.upper()

    kept = Kept(make, released.append, most=2)
    assert [kept[key] for key in "abaca"] == ["A", "B", "A", "C", "A"]
    assert (made, released) == (["a", "b", "c"], ["B"])
    kept.clear()
    assert sorted(released) == ["A", "B", "C"]
