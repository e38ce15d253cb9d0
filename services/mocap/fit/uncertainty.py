"""The uncertainty of a body's measures, from noise in silhouettes and undetermined directions."""

from dataclasses import replace

import numpy as np

from services.mocap.body.actor import Actor
from services.mocap.body.measures import Measure, measure
from services.mocap.body.shape_space import body_of, clip_to_bounds, vector_of
from services.mocap.types import Floats

_DIRECTIONS = 12
"""The widest of all directions of shapes; the others together move no measure by a millimetre."""


def with_uncertainties(
    measures: tuple[Measure, ...], actor: Actor, covariance: Floats
) -> tuple[Measure, ...]:
    """The measures of an actor, each with its standard deviation.

    covariance: (n, n) of the actor's shape vector. The body is measured again, one deviation away in
    each of the directions that are least known.
    """
    x = vector_of(actor)
    variances, directions = np.linalg.eigh(covariance)
    steps = directions[:, -_DIRECTIONS:] * np.sqrt(np.maximum(variances[-_DIRECTIONS:], 0.0))
    here_cm, squares = _cm(actor, x), np.zeros(len(measures))
    for step in steps.T:
        squares += (_cm(actor, clip_to_bounds(x + step)) - here_cm) ** 2
    return tuple(
        replace(row, uncertainty_cm=float(deviation))
        for row, deviation in zip(measures, np.sqrt(squares), strict=True)
    )


def _cm(actor: Actor, x: Floats) -> Floats:
    """(M,) the measures of a shape vector of the actor's mesh."""
    return np.array([row.cm for row in measure(body_of(x, actor.wearing(None)))])
