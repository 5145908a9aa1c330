"""From evidence against the poses to what is done: suspicion, and conviction. Sans-IO.

*Suspicion*: nothing is learnt from the poses, the last trim is held, and the operator is told. *Conviction*: the poses
are not believed again in this flight; it ends with a descent on the model, from what was believed before. Where the
attitude obeys and only the position stands, or where something moves the vehicle, it may be a tether, a net or a hand:
the flight ends in the same way, and nobody is convicted.
"""

from typing import NamedTuple

from groundstation.core.safety.guards import Since
from groundstation.core.safety.obedience import STILL_SUSPECTS, PoseEvidence

HELD_S = 1.0
"""How long the suspicion that the position stands may last, before it ends the flight [s]."""
WITNESS = 0.5
"""Share of the evidence that convicts where the autopilot's own attitude disagrees with the poses, too [-]."""

ANSWERED, PAROLE_S = 3.0, 0.8
"""Poses that came back after the descent had begun are believed as to speed once so much speaks for them (see
obedience.py), and not at all where that takes longer than so long [s]."""
OLD_SHARE, OLD_S = 0.6, 0.3
"""Poses older than this share of ``flight.coast_s`` for so long [s] are too old to fly by."""


class Charge(NamedTuple):
    """Why a flight ends because of its poses."""

    reason: str
    convicted: bool
    """False where the vehicle itself may be held."""


class Conviction:
    """One flight's. Times are on the event loop's clock [s]."""

    def __init__(self) -> None:
        """Nothing speaks against the poses."""
        self.says = ""
        """The newest line for the operator; empty where there is no news."""
        self._suspected = False
        self._still_since_s: float | None = None

    def look(self, evidence: PoseEvidence, now_s: float, *, led: bool = False, doubted: bool = False) -> Charge | None:
        """What follows from ``evidence``.

        ``led`` where something else than commands moves it; ``doubted`` where the autopilot's own attitude disagrees
        with the poses.
        """
        self.says = ""
        suspect = evidence.suspicious
        if suspect != self._suspected:
            self._suspected = suspect
            share = 100.0 * max(evidence)
            self.says = (
                f"suspicion: {_accusation(evidence)} ({share:.0f} % of what convicts); nothing is learnt from them"
                if suspect
                else "the suspicion has gone: the poses show what the commands do"
            )
        least = WITNESS if doubted else 1.0
        if max(evidence.attitude, evidence.axes, evidence.heading) >= least:
            if led and not doubted:
                return Charge(f"suspicion: {LED}: down on the model", convicted=False)
            also = ", and the autopilot's own attitude says so, too" if doubted else ""
            return Charge(f"convicted: {_accusation(evidence)}{also}: down on the model", convicted=True)
        if evidence.push >= 1.0:
            return Charge(f"suspicion: {_accusation(evidence)}: down on the model", convicted=False)
        if evidence.still < STILL_SUSPECTS:
            self._still_since_s = None
        elif self._still_since_s is None:
            self._still_since_s = now_s
        elif evidence.still >= 1.0 or now_s - self._still_since_s >= HELD_S - 1e-9:
            return Charge(f"suspicion: {_accusation(evidence)}: down on the model", convicted=False)
        return None


LED = "something else than the commands moves it (a hand, or it is another body)"


def charge_lateness(late_s: float) -> Charge | None:
    """What follows from poses that follow the commands so much later than they say [s]; None where they do not."""
    if late_s == 0.0:
        return None
    why = (
        f"convicted: what the poses show follows the commands {1e3 * late_s:.0f} ms later than told "
        "(poses older than they say, or commands that get lost)"
    )
    return Charge(f"{why}: down on the model", convicted=True)


def charge_age(age_s: float, coast_s: float, since: Since, now_s: float) -> Charge | None:
    """What follows from poses so old that no loop is stable by them, though no command has passed its deadline.

    They are ``age_s`` old as they come, and commands may rest on one for ``coast_s`` [s]; None where they are not.
    """
    limit_s = OLD_SHARE * coast_s
    if not since.lasts("old", age_s > limit_s, now_s, OLD_S):
        return None
    return Charge(
        f"the poses are {1e3 * age_s:.0f} ms old as they come, limit {1e3 * limit_s:.0f} ms "
        f"({OLD_SHARE:g} of flight.coast_s): down on the model",
        convicted=False,
    )


class Parole:
    """Poses that come back after the descent has begun for want of them: are they this vehicle's, and new?"""

    def __init__(self) -> None:
        """None are missing."""
        self._missing_s: float | None = None
        self._begun_s: float | None = None

    def begin(self, pose_s: float) -> None:
        """The newest pose, of ``pose_s`` [s], is so old that the descent begins."""
        self._missing_s, self._begun_s = pose_s, None

    def serves(self, pose_s: float) -> bool:
        """Whether poses have come back, the newest of ``pose_s`` [s], that have not proven themselves."""
        return self._missing_s is not None and pose_s > self._missing_s

    def ends(self, answered: float) -> bool:
        """Whether so much speaks for them that they are believed from now on."""
        if answered > ANSWERED:
            self._missing_s = None
        return self._missing_s is None

    def charge(self, now_s: float) -> Charge | None:
        """What follows where it lasts."""
        self._begun_s = now_s if self._begun_s is None else self._begun_s
        if now_s - self._begun_s < PAROLE_S - 1e-9:
            return None
        return Charge("the poses that came back do not show what the commands do: down on the model", convicted=False)


def _accusation(evidence: PoseEvidence) -> str:
    largest = max(evidence)
    if evidence.attitude == largest:
        return (
            "the poses do not turn as the commands turn the vehicle (another body, a picture that stands, "
            "or axes that are set up wrongly: see groundstation carry)"
        )
    if evidence.heading == largest:
        return "the poses turn about the vertical, and no command asks for that"
    if evidence.axes == largest:
        return "the poses move as a mirrored or turned image of the vehicle (check pose.axes with groundstation carry)"
    if evidence.push == largest:
        return (
            "the position does not show what pushes the vehicle (it lies along an axis, or comes late, "
            "or something holds the vehicle)"
        )
    return "the position stands while the vehicle is pushed (something holds it, or the position is not its own)"
