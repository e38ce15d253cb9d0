"""Fitting an actor's shape and poses to silhouettes: contours, matched both ways, and least squares."""
