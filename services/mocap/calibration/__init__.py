"""From pictures of a board to calibrated cameras: detection, one camera, pairs, all together, the report."""
