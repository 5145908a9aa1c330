"""Flights that others recorded: import, and how well our estimator predicts them."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.analysis.evidence.evidence import evidence_command
    from groundstation.analysis.evidence.imports import import_command


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, name)
