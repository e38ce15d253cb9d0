"""What a user does changes what is shown."""

import queue
from collections.abc import Callable
from pathlib import Path

import pytest
from pydantic import ValidationError

from services.commands.view import finished_show
from services.viewer.actions import ACTIONS, Action
from services.viewer.controls import Controls


@pytest.fixture
def act(result: Path) -> Callable[[str], Controls]:
    """`act('{"do": "step", "frames": 1}')`: the controls after an action as a browser sends it."""
    actions: queue.Queue[Action] = queue.Queue()
    controls = Controls(actions, finished_show(result, None))

    def do(text: str) -> Controls:
        actions.put(ACTIONS.validate_json(text))
        controls.perform(0.0)
        return controls

    return do


@pytest.mark.parametrize(("source", "shown"), [("videos", "pictures"), ("silhouettes", "silhouettes")])
def test_a_take_without_videos_has_no_pictures(
    result: Path, small_take: Callable[..., Path], source: str, shown: str
) -> None:
    controls = Controls(queue.Queue(), finished_show(result, small_take("walk", source=source, frames=24)))
    assert controls.look.content == shown


def test_transport(act: Callable[[str], Controls]) -> None:
    assert act('{"do": "seek", "frame": 7}').player.frame == 7
    assert act('{"do": "seek", "frame": 700}').player.frame == 23
    assert act('{"do": "seek", "frame": -1}').player.frame == 0
    assert act('{"do": "play"}').player.is_playing is False, "finished results play at first"
    assert act('{"do": "play"}').player.is_playing is True
    assert act('{"do": "step", "frames": 3}').player.frame == 3
    assert act('{"do": "speed", "factor": 0.25}').player.speed == 0.25


def test_tiles(act: Callable[[str], Controls]) -> None:
    look = act('{"do": "show", "content": "difference", "part": "head", "cameras": [5, 1, 99]}').look
    assert (look.content, look.part, look.cameras) == ("difference", "head", (1, 5))
    large = act('{"do": "enlarge", "camera": 6}').look
    assert large.cameras == (6,) and large.tile_width_px > look.tile_width_px
    assert act('{"do": "enlarge", "camera": 99}').look.cameras == (1, 5)
    act('{"do": "enlarge", "camera": 6}')
    assert act('{"do": "enlarge", "camera": null}').look == look


def test_room_and_charts(act: Callable[[str], Controls]) -> None:
    controls = act('{"do": "room", "frusta": false, "trails": true, "follow": true}')
    assert (controls.room.frusta, controls.room.trails, controls.room.follow) == (False, True, True)
    controls.framing = None
    framing = act('{"do": "frame", "what": "actor"}').framing
    assert framing is not None and framing.what == "actor"
    assert act('{"do": "charts", "titles": ["Confidence"]}').charts == ("Confidence",)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        '{"do": "explode"}',
        '{"do": "seek", "frame": 1.5}',
        '{"do": "speed", "factor": 0}',
        '{"do": "speed", "factor": 1e999}',
        '{"do": "show", "content": "secrets", "part": null, "cameras": []}',
        '{"do": "charts", "titles": ["a", "b", "c"]}',
        '{"do": "play", "on": true, "else": 1}',
    ],
)
def test_what_no_page_sends_is_refused(text: str) -> None:
    with pytest.raises(ValidationError):
        ACTIONS.validate_json(text)
