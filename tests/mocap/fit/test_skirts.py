"""A skirt is found where there is one, and only there."""

from collections.abc import Callable
from typing import Any

import pytest

from services.mocap.body.actor import build_body
from services.mocap.body.garments import Skirt
from services.mocap.body.shape_space import actor_of
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Region
from services.mocap.fit.worn import in_best_skirt
from services.mocap.search.chains import ALL_SURFACES


@pytest.mark.parametrize("worn", [Skirt(length=0.24, flare=0.05), Skirt(length=0.4, flare=0.01), None])
def test_the_skirt_that_is_worn_is_found(rig: Rig, a_person: Callable[..., Any], worn: Skirt | None) -> None:
    person = a_person(3, 2)
    actor = actor_of(person.x).in_skirt(worn)
    drawn = CpuBackend(build_body(actor), rig).coverage(person.poses, ALL_SURFACES, Region.whole(rig))
    other = actor.in_skirt(Skirt(length=0.3, flare=0.0))
    found = in_best_skirt(other, person.poses, rig, TriPlanes.sure(drawn)).skirt
    if worn is None:
        assert found is None
    else:
        assert found is not None
        assert found.length == pytest.approx(worn.length, abs=0.031)
        assert found.flare == pytest.approx(worn.flare, abs=0.026)
