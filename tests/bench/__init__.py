"""Measurements beside the paper's own numbers: what `scripts/bench` prints."""
