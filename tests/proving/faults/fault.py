"""Fault: how it strikes, at which moment of a mission, and what its judge must know of it.

A closed list of words says what is not asked of a vehicle after a fault; all else is.
"""

import asyncio
import math
from collections.abc import Callable, Coroutine, Sequence
from enum import StrEnum
from typing import Any, NamedTuple

from groundstation.core.mission import State
from groundstation.flight import Flight
from sim.runs import Stage
from sim.trackers import TrackedBody, Tracker
from sim.world import normals
from tests.proving.faults.pictures import Picture, Struck, Way


class Meddler:
    """Tracker around another one, between the cameras and the network: it spoils the poses."""

    def __init__(self, tracker: Tracker) -> None:
        self.picture: Picture | None = None
        """Change of the seen poses; None: they are true."""
        self.way: Way | None = None
        """Change of the frames' way; None: each is sent at once, as it is."""
        self.shown: TrackedBody | None = None
        """Our body in the newest frame."""
        self._tracker = tracker

    async def open(self) -> None:
        """Join the network."""
        await self._tracker.open()

    def close(self) -> None:
        """Leave the network."""
        self._tracker.close()

    def send(self, frame: int, exposure_s: float, bodies: Sequence[TrackedBody]) -> None:
        """Send one frame, as it has become."""
        if self.picture is not None:
            bodies = self.picture(exposure_s, bodies)
        self.shown = bodies[0]
        if self.way is not None:
            self.way(self._tracker.send, frame, exposure_s, bodies)
        else:
            self._tracker.send(frame, exposure_s, bodies)


def stand_between(stage: Stage) -> Meddler | None:
    """Return the meddler behind the cameras of ``stage`` from now on; None without cameras."""
    return None if stage.mocap is None else stage.mocap.through(Meddler)


class Kind(StrEnum):
    """Rule by which the rows of a family are judged."""

    REQUIRED = "required"
    """False or missing poses: :data:`REQUIRED_SHARE` of the cells are within the limits."""
    KNOWN_LIMIT = "known limit"
    """False poses that are found late or never: wider limits, and a smaller share of the cells."""
    HONEST = "honest"
    """True poses of a vehicle that something moves: compared with the same flight unguarded."""
    OTHER = "other"
    """Something else breaks: every cell within the limits."""


class Exemption(StrEnum):
    """Why some limits do not hold for a row; empty where all do."""

    NONE = ""
    NO_LINK = "no link"
    NO_MOTORS = "no motors"
    WEAK = "weak rotors"
    NOT_OBSERVABLE = "not observable"


def name_of(case: str) -> str:
    """Return the name of the fault that ``case`` belongs to: what stands before its colon."""
    return case.partition(": ")[0]


FALLS = (Exemption.NO_LINK, Exemption.NO_MOTORS, Exemption.WEAK)
"""Nothing that anybody could tell the vehicle holds it up."""
TUMBLES = (Exemption.NO_LINK, Exemption.NO_MOTORS)
"""Exemptions of vehicles that need not stay upright either."""

REASONS = {
    Exemption.NO_LINK: "the radio module's plug is out: no command reaches the vehicle any more, "
    "and its receiver holds the last frame for 1 s and stops the motors; distance sideways, lean, "
    "speed and touchdown are not judged",
    Exemption.NO_MOTORS: "the autopilot restarts, which stops the motors: it falls whatever "
    "anybody does; lean, speed and touchdown are not judged",
    Exemption.WEAK: "the rotors at their fullest give less than weight and wind pull: nobody could "
    "land it softly; speed and touchdown are not judged",
    Exemption.NOT_OBSERVABLE: "poses alone can't tell it from a true flight; the row is judged as "
    "it is 5 s after the strike, or after lift-off. What bounds it: telemetry that knows its own "
    "velocity, the fence, and the flight's time",
}
"""Where each holds, and which limits it lifts."""


class Poses(StrEnum):
    """Effect on the poses."""

    TRUE = "true"
    """They are true, and come; perhaps late, seldom or twice."""
    FALSE = "false"
    """They look like true ones, and are not."""
    GONE = "gone"
    """None comes, or none that could pass for true beside those before."""


class Scene:
    """One flight with a seed, and what may be broken in it."""

    def __init__(
        self, flight: Flight, stage: Stage, meddler: Meddler | None, seed: int = 0
    ) -> None:
        """Nothing is broken; ``meddler`` stands behind the cameras, where there are any."""
        self.flight, self.stage, self.seed = flight, stage, seed
        self._meddler = meddler
        self.normals = normals(seed, "fault", 6)
        """Rows of six standard normal numbers for what a fault draws."""
        self.controller_raises = False
        """The next step of the controller raises."""
        self.recorder_raises = False
        """Whatever is given to the recorder raises."""

    @property
    def now_s(self) -> float:
        """Event loop's clock [s]."""
        return asyncio.get_running_loop().time()

    @property
    def between(self) -> Meddler:
        """The meddler between the cameras and the network."""
        assert self._meddler is not None, "this one needs cameras"
        return self._meddler

    @property
    def struck(self) -> Struck:
        """Return the state at which a wrong picture begins, now."""
        truth = self.stage.plant.truth(self.now_s)
        seen = self.between.shown or truth
        return Struck(self.now_s, seen.position_ned, seen.attitude, self.normals)


Strike = Callable[[Scene], Coroutine[Any, Any, None]]


class Fault(NamedTuple):
    """One case of a fault: a fault and the value that it is flown with."""

    strike: Strike
    """Lets it happen."""
    link: str = "mavlink"
    """Link that it is flown on."""
    also: dict[str, tuple[str, ...]] = {}  # noqa: RUF012  # read only
    """Further links, and the states that it is flown in there."""
    source: str = "vicon"
    overrides: tuple[str, ...] = ()
    """``--set`` of the flight that it happens to."""
    poses: Poses = Poses.TRUE
    """The poses from then on."""
    obeys: bool = False
    """Whether the vehicle goes on obeying, as the poses show: then to convict them is wrong."""
    exemption: Exemption = Exemption.NONE
    """Demands that can't be made in the air."""
    silences: bool = False
    """Whether nothing may leave once the autopilot has told of it."""
    states: tuple[str, ...] = ()
    """The only states that it is flown in; empty for all in which a mission can be struck."""
    family: str = ""
    """Family that it is counted in."""
    kind: Kind = Kind.OTHER
    """Rule by which it is judged."""
    flies_on: tuple[str, ...] = ()
    """States in which the mission must go on as planned."""


PLANNED = {
    (State.IDLE, State.CONNECTING), (State.CONNECTING, State.READY), (State.READY, State.ARMING),
    (State.ARMING, State.TAKEOFF), (State.TAKEOFF, State.HOLD), (State.HOLD, State.TRACKING),
    (State.TRACKING, State.RETURNING), (State.HOLD, State.MOVING), (State.MOVING, State.HOLD),
    (State.HOLD, State.RETURNING), (State.LANDING, State.DISARMING),
    (State.DESCENT, State.DISARMING), (State.DISARMING, State.LANDED),
}  # fmt: skip
"""Moves that a flight makes by itself, or as the deck asks, whatever their reason."""
PLANNED_REASONS = (
    "over the place of take-off",
    "the autopilot has detected touchdown and disarmed",
)
"""Reasons of other moves that would have come without any fault."""


class Moves:
    """The states of one flight, and which of them answer a fault."""

    def __init__(self, now: Callable[[], float]) -> None:
        """``now`` tells the time [s]."""
        self.state = State.IDLE
        self.since_s = 0.0
        """When it began."""
        self.reason = ""
        """Why it is there."""
        self.struck = False
        """True from the fault on."""
        self.answers: list[tuple[float, State, str]] = []
        """When, what and why."""
        self._now = now

    def lasts(self, state: State, for_s: float) -> bool:
        """Whether it has been in ``state`` for ``for_s`` [s]."""
        return self.state is state and self._now() >= self.since_s + for_s - 1e-9

    def enter(self, state: State, reason: str) -> None:
        """A state has begun."""
        before, self.state, self.since_s, self.reason = self.state, state, self._now(), reason
        if self.struck and (before, state) not in PLANNED and reason not in PLANNED_REASONS:
            self.answers.append((self.since_s, state, reason))


class Moment(NamedTuple):
    """A place in the mission: so long after the begin of a state, and not below a height."""

    state: State
    after_s: float
    flying: bool = True
    """Whether it is in the air then."""
    climbed_m: float = -math.inf
    """Least height above the floor [m]."""

    def has_lasted(self, moves: Moves) -> bool:
        """Whether a flight with ``moves`` has been in its state for as long."""
        return moves.lasts(self.state, self.after_s)

    def is_now(self, moves: Moves, height_m: float) -> bool:
        """Whether it has come for a flight with ``moves``, ``height_m`` above the floor [m]."""
        return height_m >= self.climbed_m and self.has_lasted(moves)


MOMENTS = {
    "start": Moment(State.IDLE, 0.0, flying=False),
    "ready": Moment(State.READY, 0.3, flying=False),
    "arming": Moment(State.ARMING, 0.4, flying=False),
    "spool-up": Moment(State.TAKEOFF, 1.0, flying=False),
    "lift-off": Moment(State.TAKEOFF, 0.0, climbed_m=0.1),
    "take-off": Moment(State.TAKEOFF, 0.0, climbed_m=0.3),
    "hold": Moment(State.HOLD, 0.5),
    "tracking": Moment(State.TRACKING, 1.0),
    "moving": Moment(State.MOVING, 2.0),
    "returning": Moment(State.RETURNING, 1.0),
    "landing": Moment(State.LANDING, 0.7),
    "descent": Moment(State.DESCENT, 0.3),
}
"""Moments by their names: ``spool-up``, ``lift-off`` and ``take-off`` are parts of one state."""
