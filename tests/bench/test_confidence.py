"""Weights are found again from what they made, and a take of the own body is told from lost limbs."""

from pathlib import Path

import numpy as np

from bench.confidence import Known, as_tables, known_of, weights_of
from services.mocap.body.actor import Actor
from services.mocap.search.lost_probability import EVIDENCE, WEIGHTS, lost_probabilities
from services.mocap.synth.take import write_synthetic_take
from services.mocap.take.marks import PARTS


def _made(seed: int, weights: np.ndarray) -> Known:
    rng = np.random.default_rng(seed)
    evidence = rng.normal(size=(4000, len(EVIDENCE)))
    probability = 1.0 / (1.0 + np.exp(-(evidence @ weights[1:] + weights[0])))
    return Known(str(seed), evidence, np.where(rng.random(4000) < probability, 200.0, 20.0))


def test_weights_are_found_again() -> None:
    weights = np.array([-1.0, *np.linspace(-1.5, 1.5, len(EVIDENCE))])
    takes = [_made(seed, weights) for seed in range(3)]
    np.testing.assert_allclose(weights_of(takes), weights, atol=0.15)
    fitted, *reliability = as_tables(takes)
    assert fitted.row_count == 1 + len(EVIDENCE)
    assert len(reliability) == 2
    assert as_tables([]) == []


def test_the_own_body_is_not_lost(tmp_path: Path) -> None:
    write_synthetic_take(tmp_path / "walk", n_frames=4, n_cameras=4)
    (tmp_path / "walk" / "actor.toml").write_text(Actor(height=1.75).to_toml())
    known = known_of(tmp_path / "walk", true_silhouettes=True)
    assert known.evidence.shape == (4 * len(PARTS), len(EVIDENCE))
    assert not known.is_lost.any()
    assert lost_probabilities(known.evidence).max() < 0.1
    assert len(WEIGHTS) == 1 + len(EVIDENCE)
