"""Silhouettes of live cameras: sources that may disappear, assembly of shots, counts of drops."""
