"""A hat is found where there is one, and only there."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from services.mocap.body.actor import build_body
from services.mocap.body.garments import Hat
from services.mocap.body.shape_space import INDEX, actor_of
from services.mocap.camera.rig import Rig
from services.mocap.energy.bitplanes import TriPlanes
from services.mocap.energy.cpu.backend import CpuBackend
from services.mocap.energy.picture import Region
from services.mocap.fit.hats import in_best_hat
from services.mocap.search.chains import ALL_SURFACES

WORN = Hat(brim=1.75, peak=1.75, rim=0.03, crown=0.02)
CAP = Hat(brim=1.1, peak=1.8, rim=0.03, crown=0.02)


@pytest.mark.parametrize("worn", [WORN, CAP, Hat(brim=2.1, peak=2.1, rim=0.015, crown=0.04), None])
@pytest.mark.parametrize("before", [WORN, None])
def test_the_hat_that_is_worn_is_found(
    rig: Rig, a_person: Callable[..., Any], worn: Hat | None, before: Hat | None
) -> None:
    """From a head that was fitted as deep as a brim."""
    person = a_person(3, 2)
    dressed = build_body(actor_of(person.x).in_hat(worn))
    seen = TriPlanes.sure(CpuBackend(dressed, rig).coverage(person.poses, ALL_SURFACES, Region.whole(rig)))
    start = person.x.copy()
    if worn is not None:
        start[INDEX["head_depth"]] = np.log(1.3)
    found = in_best_hat(actor_of(start).in_hat(before), person.poses, rig, seen).hat
    if worn is None:
        assert found is None
    else:
        assert found is not None
        assert found.brim == pytest.approx(worn.brim, abs=0.36)
        assert found.peak == pytest.approx(worn.peak, abs=0.36)
        assert found.rim == pytest.approx(worn.rim, abs=0.016)
        assert found.crown == pytest.approx(worn.crown, abs=0.021)
