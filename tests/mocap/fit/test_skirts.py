"""A skirt is found where there is one, and only there."""

from collections.abc import Callable
from typing import Any

import pytest

from services.mocap.body.actor import build_body
from services.mocap.body.garments import Hat, Skirt
from services.mocap.body.shape_space import actor_of
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Region
from services.mocap.fit.worn import as_worn, in_best_skirt
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


def test_a_skirt_and_a_hat_are_found_together_in_some_of_many_frames(
    rig: Rig, a_person: Callable[..., Any]
) -> None:
    person, worn = a_person(3, 12), Hat(brim=1.75, peak=1.75, rim=0.03, crown=0.02)
    actor = actor_of(person.x).in_skirt(Skirt(length=0.24, flare=0.05)).in_hat(worn)
    drawn = CpuBackend(build_body(actor), rig).coverage(person.poses, ALL_SURFACES, Region.whole(rig))
    found = as_worn(actor.bare, person.poses, rig, TriPlanes.sure(drawn))
    assert found.skirt is not None
    assert found.skirt.length == pytest.approx(0.24, abs=0.031)
    assert found.hat is not None
    assert found.hat.brim == pytest.approx(worn.brim, abs=0.36)
