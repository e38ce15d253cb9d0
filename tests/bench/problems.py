"""What table 1 evaluates: the paper's windows about a person, plain, with pre-rendering, with colours."""

from dataclasses import dataclass, replace

import numpy as np

from bench.rates import BATCHES
from services.mocap.body.actor import Actor, Body, build_body
from services.mocap.body.colours import QUARTERS
from services.mocap.body.kinematics import N_DOF
from services.mocap.body.skeleton import DOF_INDEX, SEGMENT_NAMES, SIDES
from services.mocap.camera.camera import Camera
from services.mocap.camera.rig import Rig
from services.mocap.energy.backend import Backend, Problem
from services.mocap.energy.bitplanes import pack_classes
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Picture, Region
from services.mocap.search.chains import ALL_SURFACES, HEAD, LIMBS, Stage
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.search.stages import stage_window
from services.mocap.synth.studio import studio_cameras
from services.mocap.types import Floats

LARGEST_BATCH = max(BATCHES)
DETAIL_PX = SearchSettings().detail_px
_PAPER_SETUP = (320, 240, 8)
_PAPER_RATES = {
    ("full", "XOR"): 95.9,
    ("full", "XORPR"): 95.5,
    ("half-res", "XOR"): 131.1,
    ("half-res", "XORPR"): 131.2,
    ("arm", "XOR"): 133.7,
    ("arm", "XORPR"): 433.1,
    ("head", "XOR"): 144.9,
    ("head", "XORPR"): 855.4,
}
"""Window and method -> evaluations per second on a GeForce3 (the paper, table 1)."""
_SHIRT, _TROUSERS, _SKIN = ((number,) * QUARTERS for number in (1, 2, 3))
_BARE = ("head", "left_hand", "right_hand")
_CLOTHES = {
    name: _SKIN if name in _BARE else _SHIRT if "arm" in name or name == "torso" else _TROUSERS
    for name in SEGMENT_NAMES
}
"""Segment -> the colour class of each quarter."""
_SPREAD = 0.02  # metres and radians about the pose, as in a descent


@dataclass(frozen=True)
class Setup:
    """How many cameras of which size."""

    width_px: int
    height_px: int
    n_cameras: int

    @classmethod
    def of(cls, size: str, n_cameras: int) -> "Setup":
        """From a size such as 320x240."""
        width_px, height_px = size.split("x")
        return cls(int(width_px), int(height_px), n_cameras)

    def __str__(self) -> str:
        return f"{self.n_cameras} cameras of {self.width_px}x{self.height_px}"


@dataclass(frozen=True, eq=False)
class Case:
    """One row of the table."""

    window: str
    """full, half-res, arm, head or hand."""
    method: str
    """XOR: all segments are drawn at every evaluation. XORPR: those that do not move are pre-rendered.
    "XORPR, colours": pixels of a wrong colour class count, too; the CPU paints them, whatever draws."""
    problem: Problem
    thinned: Problem
    """The same at the search's usual level of detail."""
    values: Floats
    """(LARGEST_BATCH, d) that differ a little from each other."""
    paper: float | None
    """The paper's figure."""

    @property
    def name(self) -> str:
        """Size, window and method, as in the paper."""
        region = self.problem.picture.region
        return f"{region.width_px}x{region.height_px} ({self.window}) {self.method}"

    @property
    def is_plain_whole(self) -> bool:
        """Whether this is the whole body in whole pictures, which any renderer can draw."""
        return (self.window, self.method) == ("full", "XOR")


class Scene:
    """A standing person in a ring of cameras."""

    def __init__(self, setup: Setup) -> None:
        self.setup = setup
        self.cameras: tuple[Camera, ...] = studio_cameras(setup.n_cameras, setup.width_px, setup.height_px)
        self.rig, self.body = Rig.of(self.cameras), build_body(Actor(colours=_CLOTHES))
        self.pose = _standing(self.body)

    def cases(self) -> list[Case]:
        """All rows of the table; the person's own silhouettes and classes are the input."""
        backend = CpuBackend(self.body, self.rig)
        model = Model(self.body, self.rig, backend)
        drawn = backend.coverage(self.pose[None], ALL_SURFACES, Region.whole(self.rig))
        whole = Picture.whole(self.rig, drawn[0])
        everything = Stage(tuple(range(N_DOF)), ALL_SURFACES, 0)
        arm = LIMBS["left_arm"]
        pictures = {
            "full": (everything, whole),
            "half-res": (everything, whole.halved()),
            "arm": (arm.main, stage_window(model, arm.main, whole, self.pose)),
            "head": (HEAD, stage_window(model, HEAD, whole, self.pose)),
            "hand": (arm.extremity, stage_window(model, arm.extremity, whole, self.pose)),
        }
        cases = [
            (window, method, make, stage, picture)
            for window, (stage, picture) in pictures.items()
            for method, make in (("XOR", self._plain), ("XORPR", self._pre_rendered))
        ]
        painted = pack_classes(model.colours.painted(self.pose, whole.region))
        coloured = replace(whole, classes=painted)
        for window, stage in (("full", everything), ("arm", arm.main), ("hand", arm.extremity)):
            picture = coloured if stage is everything else stage_window(model, stage, coloured, self.pose)
            cases.append((window, "XORPR, colours", self._pre_rendered, stage, picture))
        return [
            self._case(
                window, method, *(make(backend, stage, picture, detail_px) for detail_px in (0.0, DETAIL_PX))
            )
            for window, method, make, stage, picture in cases
        ]

    def _plain(self, _: Backend, stage: Stage, picture: Picture, detail_px: float) -> Problem:
        return Problem(self.pose, stage.dofs, ALL_SURFACES, picture, detail_px=detail_px)

    def _pre_rendered(self, backend: Backend, stage: Stage, picture: Picture, detail_px: float) -> Problem:
        if stage.others:
            others = backend.coverage(self.pose[None], stage.others, picture.region, detail_px)
            picture = picture.ignoring(others[0])
        return Problem(self.pose, stage.dofs, stage.segments, picture, detail_px=detail_px)

    def _case(self, window: str, method: str, problem: Problem, thinned: Problem) -> Case:
        setup = self.setup
        is_papers = (setup.width_px, setup.height_px, setup.n_cameras) == _PAPER_SETUP
        around = np.random.default_rng(0).normal(0.0, _SPREAD, (LARGEST_BATCH, len(problem.dofs)))
        return Case(
            window,
            method,
            problem,
            thinned,
            self.pose[list(problem.dofs)] + around,
            _PAPER_RATES.get((window, method)) if is_papers else None,
        )


def _standing(body: Body) -> Floats:
    """An upright pose (D,) with the arms hanging a little off the body."""
    pose = np.zeros(N_DOF)
    pose[DOF_INDEX["root_z"]] = body.pelvis_height_m
    for side in SIDES:
        pose[DOF_INDEX[f"{side}_shoulder_elevation"]] = -1.2
        pose[DOF_INDEX[f"{side}_elbow_flexion"]] = 0.3
    return pose
