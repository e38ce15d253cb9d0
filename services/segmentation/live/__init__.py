"""Silhouettes of live cameras: sources that come and go, shots put together, drops counted."""
