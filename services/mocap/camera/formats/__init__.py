"""Calibrations of other tools: read, and written."""

from services.mocap.camera.formats.reading import Axis, Format, Units, read_any
from services.mocap.camera.formats.writing import write_opencv, write_pose2sim

__all__ = ["Axis", "Format", "Units", "read_any", "write_opencv", "write_pose2sim"]
