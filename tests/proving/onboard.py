"""Flights of PX4's and ArduCopter's firmware, ``groundstation-sim dev autopilots``.

The rotor-level plant of ``rotors_quad1kg`` is the firmware's simulator. Poses come from the
simulated tracker alone, and go on to the autopilot by ``link.forward``; there is no GPS. Parameters
that are not in sim/autopilots/px4.params or ardupilot.parm are what ``groundstation doctor`` asks
for. Time is the plant's; errors are the truth's.
"""

import argparse
import asyncio
import json
import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from contextvars import ContextVar, copy_context
from pathlib import Path
from statistics import median

import msgspec

from groundstation.config import ConfigError
from groundstation.core.geometry import Vec3
from groundstation.core.mission import State
from groundstation.flight import make_flight
from groundstation.lab import DoctorOrders, run_doctor
from groundstation.machine import fill_markers, replace_between_markers
from groundstation.runtime import Exit
from groundstation.settings import Config
from links.mavlink.protocol import MavCommand, MavlinkCodec, load_dialect
from sim.autopilots import Airworthy, Make, Px4, make_ardupilot, make_px4
from sim.runs import MissionResult, Stage, confirm_at, fly_mission, from_floor
from sim.scenarios import SCENARIOS, prepare
from sim.text import notice
from sim.time import in_virtual_time
from sim.world import FourRotors, World
from tests.known import known
from tests.loops import SuspendableLoop, in_suspendable_time
from tests.proving.faults import (
    STRICT,
    TOUCHDOWN_M_S,
    Scene,
    Strike,
    comes_late,
    shows,
    stand_between,
    still,
)
from tests.proving.takeoff_start import HEAD, SEEDS, TakeOff, describe, fly_take_off

NAMES = {"px4": "PX4", "ardupilot": "ArduCopter"}
MAKERS: Mapping[str, Callable[[Path], Make]] = {"px4": make_px4, "ardupilot": make_ardupilot}
WIRED = ("link.forward.enabled=true",)
"""Settings of a lab that forwards its poses."""
ALIGNED_S = 12.0
"""When arming is confirmed: its estimator has taken in the poses by then [s]."""
SAVED_S = 4.0
"""Time for parameters to reach the autopilot's memory, and more [s]."""
VISITS = 5
"""After so many restarts the doctor has nothing left to ask for."""


class Change(msgspec.Struct, frozen=True):
    """One parameter that the doctor changed."""

    name: str
    before: float
    now: float


def set_up(
    overrides: Sequence[str], figure_s: float | None, source: str = "vicon"
) -> tuple[World, Config]:
    """The vehicle on the floor, and what is told of it."""
    prepared = prepare(SCENARIOS["rotors_quad1kg"], [*WIRED, *overrides], source=source)
    return from_floor(*prepared, figure_s)


@in_virtual_time
async def visit(airworthy: Airworthy) -> tuple[list[Change], Path]:
    """Have the doctor mend one firmware, and switch it off; return the changes and its folder."""
    world, config = set_up((), 1.0)
    stage = Stage(world, config, 0, autopilot=airworthy)
    folder, said = known(stage.onboard).firmware.folder, list[str]()
    running = asyncio.ensure_future(stage.run())
    orders = DoctorOrders("groundstation doctor", as_json=True, yes=True, folder=folder)
    try:
        await run_doctor(config, orders._replace(yes=False), None, said.append)
        findings = json.loads(said[-1])["findings"]
        wrong = tuple(finding["name"] for finding in findings if finding["recommended"] is not None)
        if wrong:
            await run_doctor(config, orders._replace(fix=wrong), None, said.append)
            await asyncio.sleep(SAVED_S)
        fixed = json.loads(said[-1])["fixed"]
        return [Change(one["name"], one["old"], one["new"]) for one in fixed], folder
    finally:
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)


@contextmanager
def set_parameters(make: Make) -> Iterator[tuple[Airworthy, list[Change]]]:
    """A firmware with the parameters that the doctor wants, and the doctor's changes in order."""
    changes, folder = list[Change](), None
    with ExitStack() as kept:
        for _ in range(VISITS):
            airworthy = kept.enter_context(Airworthy(make, folder))
            changed, folder = visit(airworthy)
            if not changed:
                yield airworthy, changes
                return
            changes += changed
        raise AssertionError(f"after {VISITS} restarts the doctor still asks for {changes[-1]}")


ADVERSE = tuple(
    f"sim.{key}={json.dumps(getattr(SCENARIOS['adverse'].world, key))}"
    for key in ("wind_mean", "wind_gust", "wind_turbulence")
)
"""The air of `adverse`."""
HOLD = ("trajectory.kind=hold",)


def step_of(acceleration: float) -> tuple[str, ...]:
    """A step of the wind while it hovers, after the steady part has begun."""
    return (*HOLD, f"sim.wind_step=[{acceleration}, 0, 0]", f"sim.wind_step_time_s={STEP_AT_S}")


STEP_AT_S = 35.0
"""When the wind steps [s after the floor was left]."""
FIGURE_S = 40.0
"""Duration of each figure; errors count from 15 s on [s]."""
TOLD: Mapping[str, tuple[str, ...]] = {
    "px4": (
        "vehicle.thrust_lag_s=0.0399",
        "vehicle.thrust_delay_s=0.0030",
        "vehicle.rate_lag_s=0.0199",
        "vehicle.rate_delay_s=0.0257",
    ),
    "ardupilot": (
        "vehicle.hover_thrust=0.4436",
        "vehicle.thrust_lag_s=0.0427",
        "vehicle.thrust_delay_s=0.0052",
        "vehicle.rate_lag_s=0.0127",
        "vehicle.rate_delay_s=0.0345",
    ),
}
"""Found by `identify` on one flight of each: `trajectory.kind=excitation`, 42 s, seed 0."""
FLIGHTS: Mapping[str, tuple[tuple[str, ...], str]] = {
    "hover": (HOLD, "0.3"),
    "eight, 0.5 m/s": (("sim.speed_m_s=0.5",), "0.5"),
    "eight, 1.0 m/s": (("sim.speed_m_s=1.0",), "0.8"),
    "eight, 0.5 m/s, wind of `adverse`": (("sim.speed_m_s=0.5", *ADVERSE), "2.0"),
    "hover, rotors 15 % weak": ((*HOLD, "sim.thrust_gain=0.85"), "–"),
    "hover, wind steps by 3 m/s²": (step_of(3.0), "–"),
    "hover, wind steps by 5 m/s²": (step_of(5.0), "–"),
}
"""Flights by name: their settings, and the RMS aimed at [cm]."""
SOURCES = ("vicon", "natnet")
"""Trackers in turn."""


def take_off(airworthy: Airworthy, told: Sequence[str], seed: int) -> TakeOff:
    """One short flight."""
    world, config = set_up((*told, *HOLD), 1.0, SOURCES[seed % len(SOURCES)])
    return fly_take_off(world, config, seed, airworthy, ALIGNED_S)


def fly_figure(
    airworthy: Airworthy, told: Sequence[str], figure: Sequence[str], seed: int
) -> MissionResult:
    """One figure, from the floor and back."""
    world, config = set_up((*told, *figure), FIGURE_S, SOURCES[seed % len(SOURCES)])
    return fly_mission(world, config, seed=seed, autopilot=airworthy, confirm_s=ALIGNED_S)


class StrikeResult(msgspec.Struct, frozen=True):
    """Outcome of a strike in flight, by the truth and the firmware's own motor outputs."""

    state: str
    """Last state of the flight; empty where its process was killed."""
    off_s: float | None
    """When the rotors last turned faster than idling [s since the strike]; None: they still do."""
    up_m: float
    """Largest rise above the place of the strike [m]."""
    aside_m: float
    """Largest distance sideways from there [m]."""
    speed_m_s: float
    hit_m_s: float | None
    """Speed at which it met the floor [m/s]; None where it did not."""
    height_m: float
    """Above the floor when it was struck."""

    def beyond(self, *, ends: bool) -> list[str]:
        """The limits that it did not keep; a flight that ``ends`` stops its rotors."""
        kept = {
            f"up {STRICT.up_m:g} m": self.up_m <= STRICT.up_m,
            f"aside {STRICT.aside_m:g} m": self.aside_m <= STRICT.aside_m,
            f"{STRICT.speed_m_s:g} m/s": self.speed_m_s <= STRICT.speed_m_s,
            f"floor {TOUCHDOWN_M_S:g} m/s": self.hit_m_s is None or self.hit_m_s <= TOUCHDOWN_M_S,
            "rotors off": self.off_s is not None or not ends,
        }
        return [limit for limit, is_kept in kept.items() if not is_kept]


IDLES = 0.12
"""Mean motor output of rotors that lift nothing [-]."""
WATCHED_S = 20.0
"""Time that the world goes on after a strike [s]."""
STOPPED_S = 1.5
"""Duration of a stopped process's standstill [s]."""
PROCESS: ContextVar[bool] = ContextVar("process", default=False)
"""True in what belongs to the ground station's process."""


async def kill(scene: Scene) -> None:
    """Nothing of the process is left: neither commands nor poses."""
    _loop().suspend(PROCESS)


async def stop(scene: Scene) -> None:
    """The process stands still, and wakes again: what came meanwhile is read at once."""
    await kill(scene)
    await asyncio.sleep(STOPPED_S)
    _loop().resume()


async def interrupt(scene: Scene) -> None:
    """Ctrl-C, once."""
    scene.flight.stop("Ctrl-C")


async def stop_forwarding(scene: Scene) -> None:
    """No pose reaches the autopilot any more; commands do. ODOMETRY forwards poses."""
    odometry = load_dialect().MAVLINK_MSG_ID_ODOMETRY.to_bytes(3, "little")
    known(scene.stage.onboard).passes = lambda datagram: datagram[7:10] != odometry


def _loop() -> SuspendableLoop:
    loop = asyncio.get_running_loop()
    assert isinstance(loop, SuspendableLoop), "in virtual time"
    return loop


async def take_over(scene: Scene) -> None:
    """A pilot's ground station sets a mode that stops: hold of PX4, BRAKE of ArduCopter."""
    codec = MavlinkCodec(250, 190)
    firmware = known(scene.stage.onboard).firmware
    modes = (4.0, 3.0) if isinstance(firmware, Px4) else (17.0, 0.0)
    message = codec.dialect.MAVLink_command_long_message(
        1, 1, MavCommand.DO_SET_MODE, 0, 1.0, *modes, 0.0, 0.0, 0.0, 0.0
    )
    firmware.say(codec.pack(message))


STRIKES: Mapping[str, tuple[Strike, bool]] = {
    "kill -9": (kill, True),
    "SIGSTOP for 1.5 s": (stop, True),
    "Ctrl-C": (interrupt, True),
    "poses frozen": (shows(still), True),
    "poses 200 ms late": (comes_late(0.2, fresh=False), True),
    "forwarder dead": (stop_forwarding, False),
    "a pilot takes over": (take_over, False),
}
"""Strikes by name, and whether the flight ends by them."""
STRUCK_S = 6.0
"""Duration of the figure before the strike [s]."""
STRUCK_FIGURE = ("sim.speed_m_s=1.0",)
"""Settings of the figure that is struck: an eight of 1 m/s."""


@in_suspendable_time
async def strike_down(
    airworthy: Airworthy, told: Sequence[str], strike: Strike, seed: int
) -> StrikeResult:
    """Fly the figure, have ``strike`` fall, and look on."""
    world, config = set_up((*told, *STRUCK_FIGURE), 60.0, SOURCES[seed % len(SOURCES)])
    loop, path = asyncio.get_running_loop(), list[tuple[float, Vec3]]()
    motors = list[tuple[float, FourRotors]]()
    stage = Stage(
        world, config, seed, lambda time_s, at: path.append((time_s, at)), autopilot=airworthy
    )
    assert stage.onboard is not None
    between = stand_between(stage)
    flight = make_flight(config, confirm=confirm_at(ALIGNED_S), wires=stage.wires)
    context = copy_context()
    context.run(PROCESS.set, True)
    flying = asyncio.create_task(flight.run(), context=context)
    turning = asyncio.create_task(stage.run())
    while (
        flight.state is not State.TRACKING
        or loop.time() < (flight.started_s or math.inf) + STRUCK_S
    ):
        await asyncio.sleep(0.001)
        if flying.done() or turning.done():
            ended = flying if flying.done() else turning
            raise AssertionError(f"it never flew the figure: {ended}")
    struck_s, at = loop.time(), stage.plant.truth(loop.time()).position_ned
    stage.onboard.on_motors = lambda time_s, signals: motors.append((time_s - struck_s, signals))
    path.clear()
    stage.plant.floor.hardest_m_s = None
    await strike(Scene(flight, stage, between, seed))
    await asyncio.sleep(WATCHED_S)
    _loop().resume()
    state = str(flight.state)
    for task in (flying, turning):
        task.cancel()
    await asyncio.gather(flying, turning, return_exceptions=True)
    return StrikeResult(
        state="" if strike is kill else state,
        off_s=_find_off_s(motors),
        up_m=max(at[2] - place[2] for _, place in path),
        aside_m=max(math.dist(at[:2], place[:2]) for _, place in path),
        speed_m_s=_find_speed_m_s(path),
        hit_m_s=stage.plant.floor.hardest_m_s,
        height_m=world.floor_z_m - at[2],
    )


def _find_off_s(motors: Sequence[tuple[float, FourRotors]]) -> float | None:
    """When rotors last lifted [s]; None where they still do at the end."""
    lifting = [time_s for time_s, signals in motors if sum(signals) > 4.0 * IDLES]
    last_s = max(lifting, default=0.0)
    return None if last_s > motors[-1][0] - 0.5 else last_s


def _find_speed_m_s(path: Sequence[tuple[float, Vec3]]) -> float:
    """The highest speed of a path, over ten of its steps each."""
    pairs = zip(path, path[10:], strict=False)
    return max(math.dist(a, b) / (t - s) for (s, a), (t, b) in pairs if t > s)


class Facts(msgspec.Struct, frozen=True):
    """Results of one firmware."""

    changes: list[Change]
    figures: dict[str, list[MissionResult]]
    take_offs: list[TakeOff]
    strikes: dict[str, list[StrikeResult]]


def fly_all(kind: str, make: Make, take_offs: int) -> Facts:
    """Fly one firmware, of which ``make`` makes copies: all its flights, one after the other."""
    told = TOLD[kind]

    def say(what: str) -> None:
        print(f"{NAMES[kind]}, {what}", file=sys.stderr, flush=True)

    with set_parameters(make) as (airworthy, changes):
        strikes: dict[str, list[StrikeResult]] = {}
        for name, (strike, _) in STRIKES.items():
            say(name)
            strikes[name] = [strike_down(airworthy, told, strike, SEEDS[0])]
        figures: dict[str, list[MissionResult]] = {}
        for name, (figure, _) in FLIGHTS.items():
            say(name)
            figures[name] = [fly_figure(airworthy, told, figure, seed) for seed in SEEDS]
        say(f"{take_offs} take-offs")
        starts = [take_off(airworthy, told, seed) for seed in range(take_offs)]
    return Facts(changes, figures, starts, strikes)


def tables(facts: Mapping[str, Facts]) -> str:
    """The facts as Markdown."""
    lines = [
        "| flown by tracker poses, on our rotors | RMS cm, median (worst) | largest, cm | aim, "
        "RMS cm |",
        "|---|---|---|---|",
    ]
    for name, flown in facts.items():
        for figure, flights in flown.figures.items():
            rms = [one.rms_cm for one in flights if one.rms_cm is not None and one.landed]
            most_cm = [one.max_cm for one in flights if one.max_cm is not None]
            largest = max(most_cm, default=math.nan)
            lost_count = len(flights) - len(rms)
            lost = f", {lost_count} of {len(flights)} lost" if lost_count else ""
            told = f"{median(rms):.2f} ({max(rms):.2f})" if rms else "–"
            lines.append(
                f"| {name}, {figure} | {told}{lost} | {largest:.1f} | {FLIGHTS[figure][1]} |"
            )
    lines += ["", *HEAD, *(describe(name, flown.take_offs) for name, flown in facts.items())]
    lines += [
        "",
        "| struck on the eight, 1 m/s | up | aside | fastest | met the floor at | rotors off after "
        "| within the limits |",
        "|---" * 7 + "|",
        f"| limits | {STRICT.up_m:g} m | {STRICT.aside_m:g} m | {STRICT.speed_m_s:g} m/s "
        f"| {TOUCHDOWN_M_S:g} m/s | – | – |",
    ]
    for name, flown in facts.items():
        for strike, struck in flown.strikes.items():
            _, ends = STRIKES[strike]
            beyond = sorted({limit for one in struck for limit in one.beyond(ends=ends)})
            hits = [one.hit_m_s for one in struck if one.hit_m_s is not None]
            offs = [one.off_s for one in struck if one.off_s is not None]
            lines.append(
                f"| {name}, {strike} | {max(0.0, *(one.up_m for one in struck)):.2f} m | "
                f"{max(one.aside_m for one in struck):.2f} m | "
                f"{max(one.speed_m_s for one in struck):.1f} m/s | "
                f"{f'{max(hits):.2f} m/s' if hits else '–'} | "
                f"{f'{max(offs):.1f} s' if len(offs) == len(struck) else 'flies on'} | "
                f"{'no: ' + ', '.join(beyond) if beyond else 'yes'} |"
            )
    for name, flown in facts.items():
        told = ", ".join(f"`{one.name}` {one.before:g} → {one.now:g}" for one in flown.changes)
        lines += ["", f"The doctor set on {name}: {told}."]
    return "\n".join(lines)


def autopilots(args: argparse.Namespace) -> Exit:
    """Fly, and print or write the tables."""
    if args.px4 is None and args.ardupilot is None:
        raise ConfigError("autopilots", notice("dev.no_autopilot"))
    if args.take_offs < 1:
        raise ConfigError("--take-offs", notice("dev.take_offs", count=args.take_offs))
    # A folder in which nothing was built is refused here, before minutes go by.
    makers = {
        kind: MAKERS[kind](folder) for kind in NAMES if (folder := getattr(args, kind)) is not None
    }
    if args.write is not None:
        fill_markers(args.write, {"onboard": ""})
    facts = {NAMES[kind]: fly_all(kind, make, args.take_offs) for kind, make in makers.items()}
    text = tables(facts)
    print(msgspec.json.encode(facts).decode() if args.json else text)
    if args.write is not None:
        replace_between_markers(args.write, text, "onboard")
    return Exit.DONE
