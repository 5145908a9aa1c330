"""Fault: how it strikes, in which states, and what its judge must know of it.

What can't be asked of a vehicle after a fault is a closed list of words; everything else is asked of all.
"""

import asyncio
from collections.abc import Callable, Coroutine
from enum import StrEnum
from typing import Any, NamedTuple

from groundstation.flight import Flight
from sim.runs import Stage
from sim.world import rows, stream
from tests.proving.faults.deck.meddler import Meddler
from tests.proving.faults.deck.pictures import Struck


class Exemption(StrEnum):
    """Why some limits do not hold for a row; empty where all do."""

    NONE = ""
    NO_LINK = "no link"
    NO_MOTORS = "no motors"
    WEAK = "weak rotors"
    NOT_OBSERVABLE = "not observable"


FALLS = (Exemption.NO_LINK, Exemption.NO_MOTORS, Exemption.WEAK)
"""Nothing that anybody could tell the vehicle holds it up."""
TUMBLES = (Exemption.NO_LINK, Exemption.NO_MOTORS)
"""Nor upright."""

REASONS: dict[Exemption, str] = {
    Exemption.NO_LINK: (
        "the radio module's plug is out: no command reaches the vehicle any more, and its receiver holds the last "
        "frame for 1 s and stops the motors; distance sideways, lean, speed and touchdown are not judged"
    ),
    Exemption.NO_MOTORS: (
        "the autopilot restarts, which stops the motors: it falls whatever anybody does; "
        "lean, speed and touchdown are not judged"
    ),
    Exemption.WEAK: (
        "the rotors at their fullest give less than weight and wind pull: nobody could land it softly; "
        "speed and touchdown are not judged"
    ),
    Exemption.NOT_OBSERVABLE: (
        "poses alone can't tell it from a true flight; the row is judged as it is 5 s after the strike, or after "
        "lift-off. What bounds it: telemetry that knows its own velocity, the fence, and the flight's time"
    ),
}
"""Where each holds, and which limits it lifts."""


class Poses(StrEnum):
    """What becomes of the poses."""

    TRUE = "true"
    """They are true, and come; perhaps late, seldom or twice."""
    FALSE = "false"
    """They look like true ones, and are not."""
    GONE = "gone"
    """None comes, or none that could pass for true beside those before."""


class Scene:
    """One flight, and what may be broken in it."""

    def __init__(self, flight: Flight, stage: Stage, meddler: Meddler | None, seed: int = 0) -> None:
        """Nothing is broken; ``meddler`` stands behind the cameras, where there are any."""
        self.flight = flight
        self.stage = stage
        self._meddler = meddler
        self.normals = rows(stream(seed, "fault").standard_normal, 6)
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
        """What stands between the cameras and the network."""
        assert self._meddler is not None, "this one needs cameras"
        return self._meddler

    @property
    def struck(self) -> Struck:
        """What a wrong picture begins with, now."""
        truth, shown = self.stage.plant.truth(self.now_s), self.between.shown
        place = (truth.position_ned, truth.attitude) if shown is None else (shown.position_ned, shown.attitude)
        return Struck(self.now_s, *place, self.normals)


Strike = Callable[[Scene], Coroutine[Any, Any, None]]


class Fault(NamedTuple):
    """One fault."""

    says: str
    """What happens, for people."""
    strike: Strike | None = None
    """Lets it happen; None where it needs processes of its own (:mod:`tests.proving.faults.live.live`)."""
    link: str = "mavlink"
    source: str = "vicon"
    overrides: tuple[str, ...] = ()
    """``--set`` of the flight that it happens to."""
    poses: Poses = Poses.TRUE
    """What they are from then on."""
    obeys: bool = False
    """Whether the vehicle goes on doing what it is told, and the poses say so: then to convict them is wrong."""
    exemption: Exemption = Exemption.NONE
    """What can't be asked of it in the air."""
    silences: bool = False
    """Whether nothing may leave once the autopilot has told of it."""
    live: tuple[str, ...] = ()
    """States in which it is flown by processes of their own in real time."""
    states: tuple[str, ...] = ()
    """The only states that it is flown in; empty for all in which a mission can be struck."""
