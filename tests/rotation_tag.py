"""Turns a video by its rotation tag, as a telephone held upright does."""

from pathlib import Path


def tag_a_quarter_turn(video: Path, height_px: int) -> None:
    """Change the display matrix of an MP4 file with pictures that are stored height_px high."""
    data = bytearray(video.read_bytes())
    matrix = data.index(b"tkhd") + 4 + 40  # version 0: the display matrix is 40 bytes into the box
    assert data[matrix : matrix + 4] == (1 << 16).to_bytes(4, "big")
    a_quarter = [0, 1 << 16, 0, -(1 << 16), 0, 0, height_px << 16, 0, 1 << 30]
    data[matrix : matrix + 36] = b"".join(value.to_bytes(4, "big", signed=True) for value in a_quarter)
    video.unlink()
    video.write_bytes(data)
