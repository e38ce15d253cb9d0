"""Writes result files for other programs, the report and the overlay, and draws the pictures in them."""
