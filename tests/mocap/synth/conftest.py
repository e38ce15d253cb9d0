import pytest

from services.mocap.body.actor import Actor, Body, build_body


@pytest.fixture(scope="session")
def synth_body() -> Body:
    return build_body(Actor(height=1.75))
