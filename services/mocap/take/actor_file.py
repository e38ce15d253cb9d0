"""actor.toml: the fitted actor in a take folder."""

from services.mocap.body.actor import Actor
from services.mocap.errors import TakeError, load_toml, validated
from services.mocap.take import layout
from services.mocap.take.folder import Take


def take_actor(take: Take) -> Actor | None:
    """The actor that the take folder holds, if any; raises TakeError where it cannot be used."""
    path = take.folder / layout.ACTOR
    if not path.exists():
        return None
    return validated(Actor, load_toml(path, TakeError), f"{path}: ", TakeError)
