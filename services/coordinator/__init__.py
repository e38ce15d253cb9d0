"""Coordinator: owns the frame loop, the torso and the head, and hands out the limbs (the paper's server)."""
