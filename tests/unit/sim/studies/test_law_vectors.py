"""The law against vectors that an independent implementation computed."""

from pathlib import Path

from sim.studies import LIMIT, worst_disagreement

VECTORS = Path(__file__).parents[3] / "golden" / "control_law_vectors.json"


def test_the_law_agrees_with_every_independent_vector() -> None:
    worst, count = worst_disagreement(VECTORS)
    assert count == 40
    assert worst <= LIMIT
