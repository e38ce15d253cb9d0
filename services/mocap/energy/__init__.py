"""The energy: bit-planes, windows, rasterising backends."""
