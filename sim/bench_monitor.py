"""What the monitor of the poses and the second witness take of a command, in one run.

A clock that is read around every call would cost as much as what it measures. So one flight's calls are recorded, and
then made again: those of the whole pilot, of the monitor alone, and of the witness alone, in turns.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from time import thread_time
from typing import Any

from groundstation.control.obedience import Obedience
from groundstation.pilot import Pilot
from groundstation.witness import Witness
from sim.fly import fly
from sim.prepare import prepare
from sim.scenarios import SCENARIOS

GOAL_SHARE = 0.1
"""Most that both may take of all of a command."""
TICKS = 1500
"""Commands in the flight that is recorded."""
ROUNDS = 15
"""So often each is made again; the fastest counts, which other programs disturbed least."""

SUBJECTS: dict[type, tuple[str, ...]] = {
    Pilot: ("pose", "tick", "follow", "stand", "lift", "descend", "idle"),
    Obedience: ("pose", "restart"),
    Witness: ("pose", "attitude", "arm"),
}
"""What is measured, and the methods that its owner calls."""

Call = tuple[str, tuple[Any, ...], dict[str, Any]]


@contextmanager
def recorded(subject: type, names: tuple[str, ...]) -> Iterator[list[Call]]:
    """Within it the calls of ``names`` are noted, from the making of a ``subject`` on."""
    calls: list[Call] = []
    inner = {name: getattr(subject, name) for name in ("__init__", *names)}

    def noting(name: str) -> Any:
        method = inner[name]

        def noted(*arguments: Any, **options: Any) -> Any:
            calls.append((name, arguments[1:], options))
            return method(*arguments, **options)

        return noted

    for name in inner:
        setattr(subject, name, noting(name))
    try:
        yield calls
    finally:
        for name, method in inner.items():
            setattr(subject, name, method)


def spent_s(subject: type, calls: list[Call]) -> float:
    """The processor's time that ``calls`` of a new ``subject`` take [s]."""
    (_, arguments, options), *rest = calls
    made = subject(*arguments, **options)
    methods = {name: getattr(made, name) for name in SUBJECTS[subject]}
    return _made_s(rest, methods) - _made_s(rest, dict.fromkeys(methods, _nothing))


def _made_s(calls: list[Call], methods: dict[str, Any]) -> float:
    """The processor's time that ``calls`` take by ``methods`` [s]."""
    start = thread_time()
    for name, arguments, options in calls:
        methods[name](*arguments, **options)
    return thread_time() - start


def _nothing(*_: Any, **__: Any) -> None:
    """Do nothing: what it takes to make a call again is no part of the call."""


def monitor(scenario: str) -> dict[str, float]:
    """What both take of a command [µs], and as a share of all of it; and the share of the witness."""
    world, config = prepare(SCENARIOS[scenario], [])
    calls: dict[type, list[Call]] = {}
    for subject, names in SUBJECTS.items():
        with recorded(subject, names) as calls[subject]:
            fly(world, config, seed=0, duration_s=TICKS * world.frame_period_s)
    least = dict.fromkeys(SUBJECTS, float("inf"))
    for _ in range(ROUNDS):
        for subject, noted in calls.items():
            least[subject] = min(least[subject], spent_s(subject, noted))
    pilot, obedience, witness = least.values()  # the monitor is a part of the pilot, the witness is not
    ticks = sum(name == "tick" for name, _, _ in calls[Pilot])
    return {
        "monitor_us": 1e6 * (obedience + witness) / ticks,
        "monitor_share": (obedience + witness) / (pilot + witness),
        "witness_share": witness / (pilot + witness),
    }
