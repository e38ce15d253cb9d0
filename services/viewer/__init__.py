"""Viewer: the page in a browser on which a take is watched, while it is tracked or afterwards."""
