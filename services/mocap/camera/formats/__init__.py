"""Calibrations of other tools: read, and written."""

from services.mocap.camera.formats.loose import Axis
from services.mocap.camera.formats.other_tools import write_opencv, write_pose2sim
from services.mocap.camera.formats.reading import Format, Units, read_any

__all__ = ["Axis", "Format", "Units", "read_any", "write_opencv", "write_pose2sim"]
