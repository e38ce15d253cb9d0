"""Between the world of a take's files (y-up or z-up) and the z-up world used inside.

Points and cameras of a take's files (calibration.toml, joints.csv) are in the take's own world. Pose
parameters (poses.csv, `[initial_pose]` in take.toml) always mean the z-up world, since the skeleton's table
defines them there.
"""

from services.mocap.camera.calibration import Up
from services.mocap.camera.camera import R_ZUP_YUP
from services.mocap.types import Floats


def to_take_world(points_world_m: Floats, up: Up) -> Floats:
    """(…, 3) points of the inside z-up world, in the take's world."""
    return points_world_m if up == "z" else points_world_m @ R_ZUP_YUP


def from_take_world(points_take_m: Floats, up: Up) -> Floats:
    """(…, 3) points of the take's world, in the inside z-up world."""
    return points_take_m if up == "z" else points_take_m @ R_ZUP_YUP.T
