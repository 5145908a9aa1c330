"""What is worth telling of dropped and missing poses: once as it begins, and once as it is over. Sans-IO."""

from collections.abc import Mapping

from groundstation.core.messages import Pose, PoseEvent

MORE = 2.0
"""Poses that are late are told of again when they are so many times as late."""
QUIET_S = 2.0
"""An outbreak is over when nothing has been dropped for its reason for this long [s]."""
HINTS = {
    "not_tracked": "the tracker does not see the body: markers hidden?",
    "frozen": "the same to the last bit: the body is hidden, or the tracker rounds (gate.drop_frozen)",
    "no_such_body": "the stream does not hold the vehicle's body: is its name right, has it been switched off?",
    "no_such_object": "the stream does not hold the vehicle's object: is its name right, has it been switched off?",
    "jump": "further from the last one than it can have flown (gate.jump_m): markers mixed up, or another body",
    "spin": "turned faster than it can have (gate.rate_deg_s): markers mixed up",
    "too_fast": "faster than the vehicle can be (gate.speed_m_s)",
    "tilted": "on its back (gate.tilt_deg): are pose.world and pose.body right?",
    "not_finite": "NaN or infinity in it",
    "not_unit": "its quaternion has not length 1",
    "absurd": "numbers that no room holds",
    "out_of_order": "older than one before: is more than one sender on this address?",
    "duplicate": "sent twice: is more than one sender on this address?",
    "other_address": "somebody else sends to this address",
    "late": "older as it came than a command may rest on one (flight.coast_s)",
}
"""What a reason may mean, and what to look at."""
LATE = (
    "they wait on their way (network, tracking computer); or the tracker's clock was set back, its frame counter "
    "paused or its rate changed, which looks the same. Where they are not that old: on the ground, stop the "
    "tracker's stream for 5 s, or start this program anew"
)
"""What late poses may mean, and what to do."""


class Outbreaks:
    """Compares counters with those of the look before; times are on the event loop's clock [s]."""

    def __init__(self, lost_s: float) -> None:
        """Poses count as lost after ``lost_s`` [s] without one."""
        self._lost_s = lost_s
        self._counts: dict[str, int] = {}
        self._running: dict[str, _Outbreak] = {}
        self._looked_s: float | None = None
        self._newest: Pose | None = None
        self._lost = False
        self._late_s = 0.0
        self._late_until_s = 0.0

    def look(
        self, now_s: float, dropped: Mapping[str, int], newest: Pose | None, late_s: float = 0.0
    ) -> list[PoseEvent]:
        """What has happened since the last look: ``dropped`` by reason, and the ``newest`` pose that has passed.

        ``late_s`` is how much later than at their best poses come now [s].
        """
        events = self._lateness(now_s, late_s)
        for reason, count in dropped.items():
            before = self._counts.get(reason, 0)
            if count == before:
                continue
            if reason not in self._running:
                self._running[reason] = _Outbreak(before, now_s if self._looked_s is None else self._looked_s)
                events.append(PoseEvent("dropping", reason, f"poses are dropped: {_named(reason)}"))
            self._running[reason].newest_s = now_s
        self._counts, self._looked_s = dict(dropped), now_s
        for reason, outbreak in [*self._running.items()]:
            if now_s - outbreak.newest_s >= QUIET_S:
                del self._running[reason]
                count, lasted = dropped[reason] - outbreak.before, outbreak.newest_s - outbreak.begun_s
                events.append(PoseEvent("passed", reason, f"{reason} is over: {count} dropped within {lasted:.2f} s"))
        if newest is not None:
            events += self._presence(now_s, newest)
        return events

    def _lateness(self, now_s: float, late_s: float) -> list[PoseEvent]:
        if late_s > 0.0:
            self._late_until_s = now_s + QUIET_S
            if late_s > MORE * self._late_s:
                self._late_s = late_s
                return [PoseEvent("late", "", f"poses come {1e3 * late_s:.0f} ms later than they did: {LATE}")]
        elif self._late_s and now_s >= self._late_until_s:
            self._late_s = 0.0
            return [PoseEvent("punctual", "", "poses come as early as before, or their source has begun anew")]
        return []

    def _presence(self, now_s: float, newest: Pose) -> list[PoseEvent]:
        before, self._newest = self._newest, newest
        lost = now_s - newest.time_s > self._lost_s
        if lost == self._lost:
            return []
        self._lost = lost
        if lost:
            return [PoseEvent("lost", "", f"poses are lost: none for {1e3 * (now_s - newest.time_s):.0f} ms")]
        gap = newest.time_s - before.time_s if before is not None else 0.0
        return [PoseEvent("back", "", f"poses are back after {gap:.2f} s")]


class _Outbreak:
    def __init__(self, before: int, begun_s: float) -> None:
        self.before = before
        self.begun_s = self.newest_s = begun_s


def _named(reason: str) -> str:
    hint = HINTS.get(reason)
    return reason if hint is None else f"{reason} ({hint})"
