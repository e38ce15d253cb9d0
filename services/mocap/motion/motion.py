"""A body in motion: the source of every motion file."""

from dataclasses import dataclass
from functools import cached_property

from services.mocap.body.actor import Body
from services.mocap.body.kinematics import joint_transforms
from services.mocap.camera.camera import R_ZUP_YUP
from services.mocap.types import Floats, Ints


@dataclass(frozen=True, eq=False)
class Motion:
    """Poses of one body in consecutive frames, N >= 1."""

    name: str
    """The take's."""
    fps: float
    frames: Ints
    """(N,) the frames' numbers in the take."""
    times_s: Floats
    """(N,) the frames' times in the take."""
    poses: Floats
    """(N, D) in metres and radians."""
    body: Body

    @cached_property
    def T_world_joint(self) -> Floats:
        """(N, J, 4, 4) in the z-up world, in the order of JOINT_NAMES."""
        return joint_transforms(self.poses, self.body.offsets_m)


def to_y_up(points_zup: Floats) -> Floats:
    """Points or offsets (…, 3) of the z-up world in the axes of motion.bvh, .glb and .trc.

    These are y-up; z is where an actor with heading zero faces, x is to the actor's left.
    """
    return points_zup @ R_ZUP_YUP


def rotations_to_y_up(R_zup: Floats) -> Floats:
    """Rotations (…, 3, 3) of the z-up world in those axes."""
    R_yup: Floats = R_ZUP_YUP.T @ R_zup @ R_ZUP_YUP
    return R_yup
