"""Recorder: poses in, motion files out."""
