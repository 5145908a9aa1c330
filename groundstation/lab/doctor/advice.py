"""What a parameter of an autopilot should be, and why, in plain words. Pure.

An :class:`Advice` is a row of the tables in px4.py and ardupilot.py; a :class:`Finding` is what came of it.
"""

from collections.abc import Callable, Iterable, Mapping
from enum import StrEnum
from typing import NamedTuple

import msgspec

from links.mavlink.protocol import AutopilotParameter


class Weight(StrEnum):
    """How much hangs on a parameter."""

    MUST = "must"
    """With any other value it does not fly, or not safely."""
    SHOULD = "should"
    """Another value is a risk."""
    NOTE = "note"
    """Right or wrong depends on the lab: to be read, not to be fixed."""


class Rule(NamedTuple):
    """Which values are accepted."""

    words: str
    """In words, for the operator."""
    accepts: Callable[[float], bool]
    """True for an accepted value."""
    better: Callable[[float], float]
    """The recommended value, from the one that is there."""


class Advice(NamedTuple):
    """About one parameter."""

    names: tuple[str, ...]
    """Its name, and what other versions of the firmware call it."""
    weight: Weight
    rule: Rule
    why: str
    reboot: bool = False
    """True where a new value counts only after the autopilot was restarted."""


class Facts(NamedTuple):
    """What the tables must know of our own configuration."""

    own_system: int
    """Our MAVLink system."""
    target_system: int
    """The vehicle's MAVLink system."""
    hover: float
    """Signal 0..1 that carries the vehicle, as we believe: weight over full thrust, through the thrust curve."""
    own_curve: bool
    """True where the link straightens the motors' curve itself (link.thrust_curve, or the vehicle's)."""


class Finding(msgspec.Struct, frozen=True):
    """One parameter on one vehicle."""

    name: str
    verdict: str
    """``ok``, ``must``, ``should``, ``note``, or ``absent`` where the autopilot does not have it."""
    value: float | None
    accepted: str
    recommended: float | None
    """What --fix would set; None where nothing is wrong or absent."""
    why: str
    reboot: bool


def one_of(values: Mapping[float, str], better: float) -> Rule:
    """Any of ``values`` (value → what it means)."""
    words = ", ".join(f"{value:g} ({meaning})" for value, meaning in values.items())
    return Rule(words, lambda v: v in values, lambda _: better)


def exactly(value: float) -> Rule:
    """This value only."""
    return Rule(f"{value:g}", lambda v: v == value, lambda _: value)


def between(low: float, high: float, better: float) -> Rule:
    """Anything in a range."""
    slack = 1e-6 * max(abs(low), abs(high))  # parameters are 32-bit floats
    return Rule(f"{low:g} to {high:g}", lambda v: low - slack <= v <= high + slack, lambda _: better)


def near(value: float, share: float) -> Rule:
    """Within ``share`` of ``value``."""
    low, high = (1.0 - share) * value, (1.0 + share) * value
    return Rule(f"{low:.2f} to {high:.2f}", lambda v: low <= v <= high, lambda _: round(value, 3))


def with_bit(bit: int, meaning: str) -> Rule:
    """Bit number ``bit`` set, the others as they are."""
    mask = 1 << bit
    return Rule(f"bit {bit} ({mask}) set: {meaning}", lambda v: bool(int(v) & mask), lambda v: float(int(v) | mask))


def without_bit(bit: int, meaning: str) -> Rule:
    """Bit number ``bit`` not set, the others as they are."""
    mask = 1 << bit
    return Rule(f"bit {bit} ({mask}) not set: {meaning}", lambda v: not int(v) & mask, lambda v: float(int(v) & ~mask))


def judged(advice: Advice, found: Mapping[str, AutopilotParameter]) -> Finding:
    """What ``advice`` says of the parameters that were ``found``."""
    for name in advice.names:
        if name in found:
            value = found[name].value
            fine = advice.rule.accepts(value)
            verdict = "ok" if fine and advice.weight is not Weight.NOTE else str(advice.weight)
            recommended = None if fine or advice.weight is Weight.NOTE else advice.rule.better(value)
            return Finding(name, verdict, value, advice.rule.words, recommended, advice.why, advice.reboot)
    return Finding(advice.names[0], "absent", None, advice.rule.words, None, advice.why, advice.reboot)


def is_wrong(findings: Iterable[Finding]) -> bool:
    """True where something must or should be changed."""
    return any(finding.verdict in (Weight.MUST, Weight.SHOULD) for finding in findings)
