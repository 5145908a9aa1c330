"""Fleet monitor: what is known of each vehicle from what their stations publish. Sans-IO."""

import math
from collections.abc import Iterator

import msgspec

from groundstation.config import VEHICLE_LETTERS, is_name
from groundstation.core.messages import Snapshot
from groundstation.core.mission import FINAL
from groundstation.interfaces.api import decode
from groundstation.interfaces.mqtt.messages import EVENT, OFFLINE, SNAPSHOT, STATE, EventMessage
from links.core import printable

SILENCE_S = 3.0
"""Without a snapshot for this long, what was true is no longer known [s]."""
DRIFT = 1e-4
"""How fast two clocks may run apart [-]."""
VEHICLES_MAX = 500
"""More are not taken in: a broker may carry anything."""
EVENTS_KEPT = 20
ALARM = frozenset({"descent", "aborted", "handed_over", "killed"})


class VehicleView:
    """One vehicle."""

    def __init__(self, name: str) -> None:
        """Nothing is known yet."""
        self.name = name
        self.state = ""
        """As published; ``offline`` where no station flies it."""
        self.snapshot: Snapshot | None = None
        self.events: list[EventMessage] = []
        """The newest, oldest first."""
        self._arrived_s = -math.inf
        self._offset_s = math.inf

    def hear(self, topic: str, payload: bytes, now_s: float) -> bool:
        """Take what came on ``topic``, below the vehicle's; False where it is nothing that we understand."""
        try:
            if topic == STATE.name:
                self.state = printable(payload.decode()[:32])
                if self.state == OFFLINE:
                    self._offset_s = math.inf  # the next station has another clock
            elif topic == EVENT.name:
                event = msgspec.json.decode(payload, type=EventMessage)
                event = msgspec.structs.replace(event, text=printable(event.text))
                self.events = [*self.events, event][-EVENTS_KEPT:]
            elif topic == SNAPSHOT.name:
                return self._snapshot(decode(b'{"snapshot":%s}' % payload), now_s)
        except (ValueError, msgspec.MsgspecError, UnicodeError, RecursionError):
            return False
        return True

    def _snapshot(self, snapshot: object, now_s: float) -> bool:
        if not isinstance(snapshot, Snapshot) or not math.isfinite(snapshot.time_s):
            return False
        if self.snapshot is not None and snapshot.time_s < self.snapshot.time_s:
            self._offset_s = math.inf  # another run of the station
        elapsed_s = min(now_s - self._arrived_s, 3600.0)
        self._offset_s = min(now_s - snapshot.time_s, self._offset_s + DRIFT * elapsed_s)
        self.snapshot, self._arrived_s = snapshot, now_s
        if self.state == "":
            self.state = snapshot.state
        return True

    def age_s(self, now_s: float) -> float:
        """How old the newest snapshot is: since its arrival, and how much later than others it came [s]."""
        if self.snapshot is None:
            return math.inf
        return max(0.0, now_s - (self.snapshot.time_s + self._offset_s))

    def word(self, now_s: float) -> str:
        """The state, or what is worse than it."""
        if self.state == OFFLINE:
            return "OFFLINE"
        if self.age_s(now_s) > SILENCE_S and self.state not in FINAL:
            return "NO DATA"
        if self.snapshot is not None and self.snapshot.link.state == "lost" and self.state not in FINAL:
            return "LINK LOST"
        return self.state.replace("_", " ").upper()

    def urgency(self, now_s: float) -> int:
        """0 for what needs somebody now, then 1 in the air, 2 on the ground, 3 away."""
        word = self.word(now_s)
        if word in ("NO DATA", "LINK LOST") or self.state in ALARM:
            return 0
        if word == "OFFLINE":
            return 3
        return 2 if self.state in ("idle", "connecting", "ready", "landed") else 1


class FleetMonitor:
    """All vehicles below one prefix."""

    def __init__(self, prefix: str) -> None:
        """Nobody is there yet."""
        self._prefix = prefix + "/"
        self._seen: dict[str, VehicleView] = {}
        self.misunderstood = 0
        """Messages that were not what they should be, or of one vehicle too many, or of none by its name."""

    def __iter__(self) -> Iterator[VehicleView]:
        """The vehicles, as they appeared."""
        return iter(self._seen.values())

    def hear(self, topic: str, payload: bytes, now_s: float) -> None:
        """Take one message of the broker; whatever is not for us is counted."""
        name, _, rest = topic.removeprefix(self._prefix).partition("/")
        if not topic.startswith(self._prefix) or rest not in (STATE.name, EVENT.name, SNAPSHOT.name):
            self.misunderstood += 1
            return
        seen = self._seen.get(name)
        if seen is None:
            if len(self._seen) >= VEHICLES_MAX or not is_name(name, VEHICLE_LETTERS):
                self.misunderstood += 1
                return
            seen = self._seen[name] = VehicleView(name)
        if not seen.hear(rest, payload, now_s):
            self.misunderstood += 1
