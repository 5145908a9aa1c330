"""The judges of a fault: by the truth, by thrust, by the bytes that left."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from tests.proving.faults.judge.thrust import LIFTS, Thrust
    from tests.proving.faults.judge.truth import Truth
    from tests.proving.faults.judge.verdict import JUDGED_S, LIMITS, Answer, Row, broken, exempted, judged
    from tests.proving.faults.judge.wire import Wire, set_point

_MODULES = {
    "thrust": ("LIFTS", "Thrust"),
    "truth": ("Truth",),
    "verdict": ("Answer", "JUDGED_S", "LIMITS", "Row", "broken", "exempted", "judged"),
    "wire": ("Wire", "set_point"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
