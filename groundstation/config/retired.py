"""Keys that configurations of earlier versions have, and what to do about each.

A file or a recording that has one loads: the key is left out, and the advice is shown once.
"""

import warnings
from collections.abc import Mapping
from typing import Any

_BY_GATE = "The pose gate and the response tests do its work (docs/explanation/trust.md)."
RETIRED_KEYS: dict[str, str] = {
    "guards.divergence_m": _BY_GATE,
    "guards.divergence_s": _BY_GATE,
    "guards.tilt_error_deg": "Use guards.oscillation_deg.",
    "guards.tilt_error_s": "Use guards.oscillation_s.",
    "guards.sway_deg": "Use guards.oscillation_deg.",
    "guards.sway_s": "Use guards.oscillation_s.",
    "takeoff.nudge": "The height behind the thrust and the response tests find another body's "
    "poses.",
    "guards.heave": "guards.oscillation_deg does its work.",
    "guards.heave_s": "guards.oscillation_s does its work.",
}
"""Dotted key (``guards.tilt_share``), or a section with all its keys (``pilot``), to one sentence
of advice."""


class RetiredKeyWarning(UserWarning):
    """A configuration has a key that this version no longer reads."""


def drop_retired_keys(
    data: Mapping[str, Any],
    source: str = "",
    advice: Mapping[str, str] = RETIRED_KEYS,
    section: str = "",
) -> dict[str, Any]:
    """``data`` without the keys that ``advice`` names.

    A :class:`RetiredKeyWarning` for each of them.

    Args:
        data: a configuration, or its table ``section``.
        source: the file's name, for the warning.
        advice: dotted key to advice.
        section: the dotted key of ``data`` with a dot behind it; empty for the whole.
    """
    kept: dict[str, Any] = {}
    for key, value in data.items():
        dotted = f"{section}{key}"
        if dotted in advice:
            words = f"{dotted}: no longer used, ignored. {advice[dotted]}"
            warnings.warn(
                f"{source}: {words}" if source else words, RetiredKeyWarning, stacklevel=2
            )
        elif isinstance(value, Mapping):
            kept[key] = drop_retired_keys(value, source, advice, f"{dotted}.")
        else:
            kept[key] = value
    return kept
