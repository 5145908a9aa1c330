"""The faults: what each does to a flight, how it is flown there, and what can't be asked of it afterwards."""

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any, NamedTuple

from groundstation.flight import Flight
from groundstation.interrupts import Interrupts
from sim.autopilot import Px4Autopilot
from sim.deck.meddler import Meddler, Mishap
from sim.stage import Stage

GUST_M_S2, GUST_S = (3.0, 2.0, 1.0), 1.5
"""A gust, as the acceleration that it gives, and how long it lasts."""
MOTORS_SHARE = 0.7
"""What is left of the thrust of motors that are weak."""
SAG_SHARE, SAG_S, SAG_STEP_S = 0.75, 6.0, 0.1
"""What a battery that collapses leaves of the thrust, and how fast."""
FULL_V, EMPTY_V = 3.9, 3.1
LOST_FRAMES = 0.7
"""Share of the command frames that get lost on a bad radio."""
STALL_S = 1.5
"""How long nothing passes either way on a link that stalls [s]."""
REBOOT_S = 2.0
"""How long an autopilot takes to restart [s]."""


class Scene:
    """One flight, and what may be broken in it."""

    def __init__(self, flight: Flight, stage: Stage, meddler: Meddler) -> None:
        """Nothing is broken."""
        self.flight = flight
        self.stage = stage
        self.meddler = meddler
        self.controller_raises = False
        """The next step of the controller raises."""
        self.recorder_raises = False
        """Whatever is given to the recorder raises."""

    @property
    def now_s(self) -> float:
        """Event loop's clock [s]."""
        return asyncio.get_running_loop().time()


Strike = Callable[[Scene], Coroutine[Any, Any, None]]


class Fault(NamedTuple):
    """One fault."""

    says: str
    """What happens, for people."""
    strike: Strike | None = None
    """Lets it happen; None where it needs processes of its own (:mod:`sim.deck.live`)."""
    link: str = "mavlink"
    source: str = "vicon"
    overrides: tuple[str, ...] = ()
    """``--set`` of the flight that it happens to."""
    blinds: bool = False
    """Whether no pose is true from then on."""
    robs: str = ""
    """What is gone that a soft touchdown would need; empty where it is still there."""
    frees: bool = False
    """Whether nobody steers any more: then how far it leans is the fault's, too."""
    silences: bool = False
    """Whether nothing may leave once the autopilot has told of it."""
    live: tuple[str, ...] = ()
    """States in which it is flown by processes of their own in real time."""
    states: tuple[str, ...] = ()
    """The only states that it is flown in; empty for all."""


def _sees(mishap: Mishap) -> Strike:
    async def strike(scene: Scene) -> None:
        scene.meddler.mishap = mishap

    return strike


async def _dropout(scene: Scene) -> None:
    assert scene.stage.mocap is not None, "the deck flies with cameras"
    scene.stage.mocap.cover(True)


async def _frame_loss(scene: Scene) -> None:
    scene.stage.frame_loss = LOST_FRAMES


async def _stall(scene: Scene) -> None:
    scene.stage.peer.cut(True)
    await asyncio.sleep(STALL_S)
    scene.stage.peer.cut(False)


async def _unplug(scene: Scene) -> None:
    scene.stage.port.cut = True


async def _reboot(scene: Scene) -> None:
    scene.stage.peer.reboot(REBOOT_S)


async def _steal(scene: Scene) -> None:
    autopilot = scene.stage.autopilot
    assert isinstance(autopilot, Px4Autopilot), "the deck flies with a PX4"
    autopilot.take_over(scene.now_s)


async def _weak_motors(scene: Scene) -> None:
    scene.stage.plant.weaken(scene.now_s, MOTORS_SHARE)


async def _sag(scene: Scene) -> None:
    steps = round(SAG_S / SAG_STEP_S)
    for step in range(1, steps + 1):
        share = 1.0 - step / steps
        scene.stage.plant.weaken(scene.now_s, SAG_SHARE + (1.0 - SAG_SHARE) * share)
        scene.stage.autopilot.battery = EMPTY_V + (FULL_V - EMPTY_V) * share, share
        await asyncio.sleep(SAG_STEP_S)


async def _gust(scene: Scene) -> None:
    scene.stage.wind.push = GUST_M_S2
    await asyncio.sleep(GUST_S)
    scene.stage.wind.push = (0.0, 0.0, 0.0)


async def _controller(scene: Scene) -> None:
    scene.controller_raises = True


async def _recorder(scene: Scene) -> None:
    scene.recorder_raises = True


async def _terminate(scene: Scene) -> None:
    request, _ = Interrupts().press("SIGTERM", scene.now_s)
    if request is not None:
        scene.flight.ask(request)


IN_AIR = ("arming", "spool-up", "take-off", "hold", "tracking", "returning", "landing", "descent")
BLIND_RADIO = "neither a pose nor an attitude loop that would land: a bounded bring-down, then motors off"
ROBBED_RADIO = "the plug was the only way: the receiver stops the motors by itself"

FAULTS: dict[str, Fault] = {
    "freeze": Fault("frames go on, the picture stands still", _sees(Mishap.FREEZE), blinds=True),
    "dropout": Fault("no more poses", _dropout, blinds=True),
    "dropout, radio": Fault(
        "no more poses, on a vehicle behind a radio", _dropout, link="dsm", blinds=True, robs=BLIND_RADIO
    ),
    "teleport": Fault("the vehicle is seen 1 m away from where it is", _sees(Mishap.TELEPORT), blinds=True),
    "yaw flip": Fault("the vehicle is seen turned by 180°", _sees(Mishap.YAW_FLIP), blinds=True),
    "marker swap": Fault(
        "our body and another change names", _sees(Mishap.SWAP), overrides=("sim.other_bodies=1",), blinds=True
    ),
    "duplicates": Fault("every datagram comes three times", _sees(Mishap.DUPLICATES)),
    "reorder": Fault("each second datagram overtakes the one before", _sees(Mishap.REORDER)),
    "clock step": Fault("the trackers' clock leaps by 5 s", _sees(Mishap.CLOCK_STEP), source="json"),
    "latency step": Fault("poses come 60 ms later than they did", _sees(Mishap.LATENCY_STEP)),
    "frame loss": Fault("70 % of the command frames get lost", _frame_loss),
    "link stall": Fault("for 1.5 s nothing passes on the link", _stall),
    "serial unplug": Fault("the radio module's plug is out", _unplug, link="dsm", robs=ROBBED_RADIO, frees=True),
    "autopilot reboot": Fault(
        "the autopilot restarts in flight", _reboot, robs="a restart stops the motors", frees=True
    ),
    "mode stolen": Fault("a pilot takes over by the remote control, and lands", _steal, silences=True),
    "motor at 70 %": Fault("the rotors give 70 % of their thrust", _weak_motors),
    "battery sag": Fault("within 6 s the battery is empty, and thrust falls to 75 %", _sag),
    "gust": Fault("for 1.5 s the wind pushes with 3.7 m/s² more", _gust),
    "controller exception": Fault("the controller raises", _controller),
    "recorder failure": Fault("the recorder raises; its process is killed", _recorder, live=("tracking",)),
    "MQTT broker gone": Fault("the broker ends", live=("take-off", "tracking"), states=("take-off", "tracking")),
    "TUI crash": Fault(
        "the screen's process is killed", live=("take-off", "tracking"), states=("take-off", "tracking")
    ),
    "SIGTERM": Fault("the process is told to end", _terminate),
    "SIGKILL": Fault("the process is killed", live=IN_AIR, states=IN_AIR),
    "SIGKILL, radio": Fault(
        "the process is killed, on a vehicle behind a radio whose frames another process paces",
        link="dsm",
        robs=BLIND_RADIO,
        live=("hold", "tracking"),
        states=("hold", "tracking"),
    ),
}
"""By name."""
