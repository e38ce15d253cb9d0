"""Viewer: the page on which browsers show a take, during tracking or afterwards."""
