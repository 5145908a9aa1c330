"""Checks the control law against vectors computed by an implementation that is independent of this
project.
"""

import json
import math
from pathlib import Path
from typing import Any

from groundstation.core.control import Law, LawState, backstep
from groundstation.core.geometry import FLOATS, subtract
from sim.text import notice

LIMIT = 1e-9
"""Largest allowed |a - e| / max(1, |e|)."""
_PARAMETERS = {
    "k2": "k2",
    "k3": "k3",
    "kb": "kb",
    "M": "sigma_bound",
    "r": "sigma_slope",
    "M_rho": "rho_bound",
    "r_rho": "rho_slope",
    "c": "velocity_scale",
    "B": "b_bound",
    "epsilon": "epsilon",
    "delta": "delta",
    "n": "projection_order",
    "g": "gravity",
}


def worst_disagreement(path: Path) -> tuple[float, int]:
    """The largest |a - e| / max(1, |e|) over all outputs of all vectors in ``path``, and how many
    vectors.

    Raises:
        OSError: the file can't be read.
        ValueError: it is not such a file; the text names the file and what is missing.
    """
    try:
        vectors = json.loads(path.read_bytes())["vectors"]
        pairs = [pair for vector in vectors for pair in _compare(vector)]
    except UnicodeDecodeError as error:
        why = notice("file.not_utf8", at=error.start)
        raise ValueError(notice("vectors.unread", path=path, why=why)) from None
    except (KeyError, TypeError, json.JSONDecodeError) as error:
        raise ValueError(
            notice("vectors.unread", path=path, why=f"{type(error).__name__}: {error}")
        ) from None
    if not pairs:
        raise ValueError(notice("vectors.none", path=path))
    # A NaN must not pass as agreement: it counts as infinitely wrong.
    errors = [abs(a - e) / max(1.0, abs(e)) for a, e in pairs]
    return max(math.inf if math.isnan(x) else x for x in errors), len(vectors)


def _compare(vector: dict[str, Any]) -> list[tuple[float, float]]:
    """(actual, expected) of every number of one vector."""
    told = {ours: vector["parameters"][theirs] for theirs, ours in _PARAMETERS.items()}
    law = Law(**told, k3_down=told["k3"])
    given, reference = vector["input"], vector["input"]["reference"]
    state = LawState(
        subtract(given["position"], reference["position"]),
        subtract(given["velocity"], reference["velocity"]),
        tuple(given["velocity"]),
        tuple(given["attitude_wxyz"]),
        given["thrust"],
        tuple(given["b_hat"]),
        tuple(reference["acceleration"]),
        tuple(reference["jerk"]),
    )
    step = backstep(FLOATS, law, state, mass=vector["parameters"]["mass"])
    names = {"V_known": "v_known", "W": "w"}
    pairs: list[tuple[float, float]] = []
    for name, expected in vector["output"].items():
        actual = getattr(step, names.get(name, name))
        if isinstance(expected, list):
            pairs += zip(actual, expected, strict=True)
        else:
            pairs.append((actual, expected))
    return pairs
