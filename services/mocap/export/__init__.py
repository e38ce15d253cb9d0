"""Writes result files for other programs, and compares joints with a reference."""
