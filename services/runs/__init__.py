"""What the commands run on this machine: the services as local processes, and the actor's fit."""

from pathlib import Path


class ServiceFailedError(Exception):
    """A service ended with an error that is not the user's; the text has its last line."""


class Interrupted(Exception):  # noqa: N818  (a request, not an error)
    """The run was stopped before its end."""

    def __init__(self, folder: Path | None) -> None:
        """Folder: where the frames solved by then are; None where there were none."""
        kept = f"what was tracked by then is in {folder}; the same command goes on from there"
        super().__init__(f"stopped; {kept if folder else 'nothing was tracked'}")
        self.folder = folder
