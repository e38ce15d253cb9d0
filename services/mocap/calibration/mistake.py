"""What the checks of a take tell: a mistake, and its remedy."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Mistake:
    """Something that is wrong with a take."""

    file: str
    """Of the take folder, and the field or camera in it."""
    what: str
    remedy: str
    is_certain: bool = False
    """Whether tracking is bound to fail."""
    is_out_of_step: bool = False
    """Whether a camera shows other moments than the others."""
    is_change: bool = False
    """Whether the cameras agree up to some frame, and not afterwards."""

    def __str__(self) -> str:
        return f"{self.file}: {self.what}: {self.remedy}"
