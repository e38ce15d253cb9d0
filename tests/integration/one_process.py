"""Takes tracked in this process: services find the same, and take longer to start."""

from pathlib import Path

from services import library
from services.mocap.search.settings import SearchSettings
from services.mocap.take.actor_file import take_actor
from services.mocap.take.folder import open_take


def tracked_here(folder: Path, out: Path, frames: str, search: SearchSettings) -> Path:
    """Track some frames of a take whose actor is known, and write the results into `out`, which is
    returned."""
    take = open_take(folder)
    actor = take_actor(take)
    assert actor is not None
    library.write_result(
        out, take, actor, library.track(take, actor, take.frame_range(frames), search=search), formats=()
    )
    return out
