"""Reads calibrations of other tools."""

from services.mocap.camera.formats.loose import Axis
from services.mocap.camera.formats.reading import Format, Units, UnknownFormatError, read_any

__all__ = ["Axis", "Format", "Units", "UnknownFormatError", "read_any"]
