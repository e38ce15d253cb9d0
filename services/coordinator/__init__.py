"""Coordinator: runs the frame loop, fits torso and head, and gives limb tasks to workers (the paper's
server)."""
