"""Segmentation: video in, silhouettes out; one process per camera group."""
