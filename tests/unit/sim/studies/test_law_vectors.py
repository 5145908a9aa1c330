"""The law against vectors that an independent implementation computed."""

import json
import math
from pathlib import Path

import pytest

from sim.studies import LIMIT, worst_disagreement

VECTORS = Path(__file__).parents[3] / "golden" / "control_law_vectors.json"


def test_the_law_agrees_with_every_independent_vector() -> None:
    worst, count = worst_disagreement(VECTORS)
    assert count == 40
    assert worst <= LIMIT


@pytest.mark.parametrize(
    ("factor", "worst"), [(2.0, 0.5), (math.nan, math.inf)], ids=["half of it", "no number"]
)
def test_a_disagreement_is_a_share_of_what_was_expected(
    factor: float, worst: float, tmp_path: Path
) -> None:
    vector = json.loads(VECTORS.read_bytes())["vectors"][0]
    vector["output"]["W"] *= factor
    (tmp_path / "one.json").write_text(json.dumps({"vectors": [vector]}))
    assert worst_disagreement(tmp_path / "one.json")[0] == pytest.approx(worst)
