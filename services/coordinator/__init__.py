"""Coordinator: runs the frame loop, solves frames, and gives limb tasks to workers (the paper's server)."""
