"""How sure a fit says it is of measures, against how far off they are."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from services.mocap.body.actor import Actor, build_body
from services.mocap.body.measures import measure, with_uncertainties
from services.mocap.body.shape_space import INDEX, PARAMETERS, actor_of, of_kind
from services.mocap.camera.rig import Rig
from services.mocap.fit.contours import contours_of
from services.mocap.fit.least_squares import Fitting
from services.mocap.fit.normal_equations import ALL_DOFS, FitStage, State
from services.mocap.fit.priors import COVARIANCE, Prior

_LAST = FitStage(of_kind("height", "bone", "joint", "profile"), ALL_DOFS, 0.8, 1, is_strict=True)


def test_what_is_not_known_of_a_bone_is_not_known_of_its_measure() -> None:
    actor = Actor(height=1.72)
    covariance = np.zeros((len(PARAMETERS), len(PARAMETERS)))
    covariance[INDEX["thigh"], INDEX["thigh"]] = 0.02**2
    rows = {row.name: row for row in with_uncertainties(measure(build_body(actor)), actor, covariance)}
    assert rows["thigh"].uncertainty_cm == pytest.approx(0.02 * rows["thigh"].cm, rel=0.05)
    assert rows["forearm"].uncertainty_cm == pytest.approx(0.0, abs=1e-9)


def test_silhouettes_leave_less_open_than_people_differ(rig: Rig, a_person: Callable[..., Any]) -> None:
    person = a_person(0, 1)
    fitting = Fitting(rig, contours_of(rig, person.seen, 250), Prior(person.poses))
    covariance = fitting.shape_covariance(State(person.x, person.poses), _LAST)
    np.testing.assert_allclose(covariance, covariance.T, atol=1e-9)
    assert np.linalg.eigvalsh(covariance).min() > 0.0
    assert np.all(np.diag(covariance) < 1.1 * np.diag(COVARIANCE))
    body = build_body(actor_of(person.x))
    rows = {row.name: row for row in with_uncertainties(measure(body), actor_of(person.x), covariance)}
    for name, low_cm, high_cm in (("height", 0.1, 2.0), ("shank", 0.1, 1.5), ("waist girth", 0.5, 5.0)):
        assert low_cm < (rows[name].uncertainty_cm or 0.0) < high_cm, name
