"""Moves a body so that its rim lies on the input's contours."""
