"""What a user may choose of the energy's backend, light enough for every process to import."""

from typing import Literal, TypeAlias

from pydantic import Field

from services.mocap.errors import FrozenModel

Choice: TypeAlias = Literal["auto", "gl", "cpu", "paper"]
MOST_THREADS = 1024


class EngineSettings(FrozenModel):
    """A choice of backend; the same for all processes of a run unless their own options say otherwise."""

    backend: Choice = Field(default="auto", description="one of auto, gl, cpu, paper")
    """auto: gl where there is hardware OpenGL, else cpu; paper: the profile of the paper, for its tables."""
    threads: int = Field(default=1, ge=0, le=MOST_THREADS, description=f"a number of 0 to {MOST_THREADS}")
    """Threads of the cpu backend in one process; 0 for one per core."""
