"""The law against vectors that an independent implementation computed."""

import json
from pathlib import Path

import pytest

from sim.studies import LIMIT, worst_disagreement

VECTORS = Path(__file__).parents[3] / "golden" / "control_law_vectors.json"


def test_the_law_agrees_with_every_independent_vector() -> None:
    worst, count = worst_disagreement(VECTORS)
    assert count == 40
    assert worst <= LIMIT


@pytest.mark.parametrize("output", ["thrust_rate", "rate_x", "rate_y", "V_known", "W"])
def test_a_wrong_number_in_a_vector_is_noticed(output: str, tmp_path: Path) -> None:
    data = json.loads(VECTORS.read_text())
    data["vectors"][7]["output"][output] *= 1.0 + 1e-7
    data["vectors"][7]["output"][output] += 1e-7
    changed = tmp_path / "changed.json"
    changed.write_text(json.dumps(data))
    assert worst_disagreement(changed)[0] > LIMIT
