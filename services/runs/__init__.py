"""Runs on this machine, for the commands: the services as local processes, and the actor's fit."""

from pathlib import Path


class ServiceFailedError(Exception):
    """A service ended with an error that is not the user's; the text has its last line."""


class Interrupted(Exception):  # noqa: N818  (a request, not an error)
    """The run was stopped before its end."""

    def __init__(self, folder: Path | None) -> None:
        """folder: where the frames so far are; None if there are none."""
        kept = f"the frames so far are in {folder}; the same command continues from there"
        super().__init__(f"stopped; {kept if folder else 'nothing was tracked'}")
        self.folder = folder
