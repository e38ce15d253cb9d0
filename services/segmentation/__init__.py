"""Segmentation: video in, silhouettes out; one process per camera group."""

import services.mocap  # noqa: F401  (says where compiled code is kept, before Numba is there)
