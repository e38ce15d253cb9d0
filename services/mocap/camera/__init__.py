"""Cameras: calibration, projection, undistortion."""
