"""Checks of exported files in the tools that they are for."""
