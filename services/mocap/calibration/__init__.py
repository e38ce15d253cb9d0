"""Calibrates cameras by a board, by measured points, a colour chart or a tracked body; checks them, and their
timing, by silhouettes."""
