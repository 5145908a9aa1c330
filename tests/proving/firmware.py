"""Flights of Betaflight's firmware, ``groundstation-sim dev firmware``, for docs/evidence.md.

In virtual time, through the RF link's bytes, on the rotor-level plant.
"""

import argparse
import asyncio
import math
from collections.abc import Callable, Sequence
from functools import partial
from statistics import median
from typing import Any, NamedTuple

import msgspec

from groundstation.core.mission import State
from groundstation.flight import make_flight
from groundstation.machine import fill_markers, replace_between_markers
from groundstation.runtime import Exit
from sim.radio import Failsafe, PulseReceiver
from sim.runs import Stage, confirm_at, fly, from_floor
from sim.scenarios import BETAFLIGHT, SCENARIOS, prepare, with_betaflight
from sim.time import in_virtual_time
from sim.world import FourRotors
from tests.known import known
from tests.loops import running
from tests.proving.takeoff_start import HEAD, SEEDS, TakeOff, describe, fly_take_off

SHORT = (
    "takeoff.height_m=0.5",
    "takeoff.hold_s=1.0",
    "trajectory.altitude_m=-0.5",
    "takeoff.climb_m_s=1.0",
)
HOLD = "trajectory.kind=hold"
WATCHED_S = 5.0
"""Time that the world goes on after a strike [s]."""
TAKE_OFFS = {"paper": range(20), "adverse": range(10)}
"""Seeds; every other take-off is over CRSF."""


class StrikeOutcome(NamedTuple):
    """Outcome of a strike in flight."""

    motors: list[tuple[float, FourRotors]]
    """The firmware's own motor signals (0..1), and when since the strike [s]."""
    hit_m_s: float | None
    """Speed at which it met the floor [m/s]."""

    @property
    def off_s(self) -> float:
        """When the motors turned for the last time [s since the strike]."""
        return max(time_s for time_s, signals in self.motors if any(signals))


@in_virtual_time
async def strike_down(strike: Callable[[Stage], None], link: str) -> StrikeOutcome:
    """Fly until tracking has lasted half a second, have ``strike`` fall, and look at the motors."""
    world, config = prepare(with_betaflight(SCENARIOS["paper"]), list(SHORT), link=link)
    world, config = from_floor(world, config, 30.0)
    motors: list[tuple[float, FourRotors]] = []
    loop = asyncio.get_running_loop()
    stage = Stage(world, config, 0, autopilot=BETAFLIGHT)
    flight = make_flight(config, confirm=confirm_at(2.0), wires=stage.wires)
    async with running(stage), running(flight):
        while flight.state is not State.TRACKING:  # noqa: ASYNC110  # no event tells it
            await asyncio.sleep(0.001)
        await asyncio.sleep(0.503)
        board = known(stage.board)
        struck_s = loop.time()
        board.on_motors = lambda time_s, signals: motors.append((time_s - struck_s, signals))
        strike(stage)
        await asyncio.sleep(WATCHED_S)
    return StrikeOutcome(motors, stage.plant.floor.hardest_m_s)


def interrupt_bridge(stage: Stage) -> None:
    """The bridge's operator presses Ctrl-C."""
    known(stage.bridge_task).cancel()


def cut_bridge_off(stage: Stage) -> None:
    """The bridge's network is gone."""
    known(known(stage._bridge)._wire).abort()


def cut_wire(stage: Stage, failsafe: Failsafe = "cut") -> None:
    """No frame leaves any more, as without pacer and stand-by; the receiver has a ``failsafe``."""
    receiver = known(stage.radio).receiver
    assert isinstance(receiver, PulseReceiver), "before Betaflight"
    receiver.failsafe_gives = failsafe
    stage.port.cut = True


hold_for_ever = partial(cut_wire, failsafe="hold")
give_invalid = partial(cut_wire, failsafe="invalid")


STRIKES: tuple[tuple[str, Callable[[Stage], None], str], ...] = (
    ("pacer killed", lambda stage: known(stage.port.pacer).strike(), "crsf"),
    ("pacer stopped", lambda stage: known(stage.port.pacer).strike(stopped=True), "dsm"),
    ("station killed", lambda stage: known(stage.port.pacer).lose_commander(), "crsf"),
    ("station stopped", lambda stage: known(stage.port.pacer).lose_commander(stopped=True), "dsm"),
    ("bridge interrupted", interrupt_bridge, "rf_bridge"),
    ("bridge's network gone", cut_bridge_off, "rf_bridge"),
    ("port cut, or pacer and stand-by killed", cut_wire, "crsf"),
    ("the same, receiver gives invalid pulses", give_invalid, "dsm"),
    ("the same, receiver holds its last pulses", hold_for_ever, "dsm"),
)

FLIGHTS: tuple[tuple[str, str, Sequence[str], float, str], ...] = (
    ("hover", "paper", [HOLD], 30.0, "0.25"),
    ("eight, 0.5 m/s", "paper", ["sim.speed_m_s=0.5"], 40.0, "0.35"),
    ("eight, 1.0 m/s", "paper", ["sim.speed_m_s=1.0"], 40.0, "0.60"),
    ("adverse, 0.5 m/s", "adverse", [], 60.0, "2.0"),
    ("hover, rotors 15 % weak", "paper", [HOLD, "sim.thrust_gain=0.85"], 30.0, "–"),
)
"""Flights, and their limits [cm RMS]."""


def gust(seed: int) -> tuple[float, float]:
    """Largest error in `gust_front`'s hover [cm], and the time from there to under 5 cm [s]."""
    told = [HOLD, "sim.wind_step_time_s=16.0"]
    world, config = prepare(with_betaflight(SCENARIOS["gust_front"]), told, link="dsm")
    verdict = fly(world, config, seed=seed, duration_s=22.0, autopilot=BETAFLIGHT).verdict
    back_s = math.inf if verdict.gust_back_s is None else verdict.gust_back_s
    return verdict.gust_peak_cm or math.inf, back_s


def take_off(scenario: str, seed: int) -> TakeOff:
    """One whole flight from the floor and back."""
    link = ("dsm", "crsf")[seed % 2]
    world, config = prepare(with_betaflight(SCENARIOS[scenario]), list(SHORT), link=link)
    return fly_take_off(*from_floor(world, config, 1.0), seed, BETAFLIGHT)


def firmware(args: argparse.Namespace) -> Exit:
    """Measure, and print or write the tables."""
    if args.write is not None:
        fill_markers(args.write, {"firmware": ""})  # before minutes go by
    facts: dict[str, Any] = {"flights": {}, "strikes": {}}
    for name, scenario, told, lasts_s, must in FLIGHTS:
        world, config = prepare(with_betaflight(SCENARIOS[scenario]), list(told), link="dsm")
        flown = [
            fly(world, config, seed=seed, duration_s=lasts_s, autopilot=BETAFLIGHT).verdict.rms_cm
            for seed in SEEDS
        ]
        rms_cm = [math.inf if one is None else one for one in flown]
        facts["flights"][name] = {"rms_cm": rms_cm, "must": must}
    facts["gust"] = [gust(seed) for seed in SEEDS]
    for name, strike, link in STRIKES:
        struck = strike_down(strike, link)
        facts["strikes"][name] = {"link": link, "off_s": struck.off_s, "hit_m_s": struck.hit_m_s}
    facts["take_offs"] = {
        name: [take_off(name, seed) for seed in seeds] for name, seeds in TAKE_OFFS.items()
    }
    text = tables(facts)
    print(msgspec.json.encode(facts).decode() if args.json else text)
    if args.write is not None:
        replace_between_markers(args.write, text, "firmware")
    return Exit.DONE


def tables(facts: dict[str, Any]) -> str:
    """The facts as Markdown."""
    lines = [
        "| flown over DSM, 50 Hz poses, 20 ms | RMS cm, median of 3 seeds (worst) | must |",
        "|---|---|---|",
    ]
    for name, row in facts["flights"].items():
        rms_cm = row["rms_cm"]
        lines.append(f"| {name} | {median(rms_cm):.2f} ({max(rms_cm):.2f}) | {row['must']} |")
    peak, back = max(p for p, _ in facts["gust"]), max(b for _, b in facts["gust"])
    lines.append(
        f"| a step of wind of 1.5 m/s² in the hover | {peak:.1f} cm at most, under 5 cm after "
        f"{back:.2f} s | 8, 1.5 s |"
    )
    starts = facts["take_offs"].items()
    lines += ["", *HEAD, *(describe(f"`{name}`", flown) for name, flown in starts)]
    lines += [
        "",
        "| struck in flight | over | firmware's motors off after | met the floor at |",
        "|---|---|---|---|",
    ]
    for name, row in facts["strikes"].items():
        off = "never" if row["off_s"] > WATCHED_S - 0.1 else f"{row['off_s']:.2f} s"
        hit = "–" if row["hit_m_s"] is None else f"{row['hit_m_s']:.2f} m/s"
        lines.append(f"| {name} | {row['link']} | {off} | {hit} |")
    return "\n".join(lines)
