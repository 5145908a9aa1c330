"""Flights of Betaflight's firmware, ``groundstation-sim dev firmware``, for docs/evidence.md.

All of it in virtual time, through the RF link's bytes, on the rotor-level plant.
"""

import argparse
import asyncio
import json
import math
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np

from groundstation.analysis.identify import identify, read_stretch
from groundstation.core.geometry import Vec3
from groundstation.core.mission import State
from groundstation.flight import Flight, make_flight
from groundstation.machine import replace_between_markers, split_at_markers
from groundstation.runtime import Exit
from sim import autopilots
from sim.autopilots import GAINS, STEP_S, FlightBoard, describe_settings
from sim.radio import InlinePacer, PulseReceiver
from sim.runs import RECORDING, MissionResult, Stage, confirm_at, fly, fly_mission, from_floor, simulate
from sim.scenarios import BETAFLIGHT, SCENARIOS, by_betaflight, prepare
from sim.time import in_virtual_time
from sim.world import FourRotors, Quadrotor, Wind, World, generator, rows
from tests.proving.takeoff_start import TakeoffStart

SHORT = ("takeoff.height_m=0.5", "takeoff.hold_s=1.0", "trajectory.altitude_m=-0.5", "takeoff.climb_m_s=1.0")
WATCHED_S = 5.0
"""Time that the world goes on after a strike [s]."""
TAKE_OFFS = {"paper": range(20), "adverse": range(10)}
"""Seeds; every other take-off is over CRSF."""
SEEDS = range(3)
"""Seeds of the flights."""


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


def strike_down(strike: Callable[[Stage], None], link: str) -> StrikeOutcome:
    """Fly until tracking has lasted half a second, have ``strike`` fall, and look at the motors."""

    @in_virtual_time
    async def watch() -> StrikeOutcome:
        motors: list[tuple[float, FourRotors]] = []
        loop = asyncio.get_running_loop()
        stage = Stage(world, config, 0, autopilot=BETAFLIGHT)
        flight = make_flight(config, confirm=confirm_at(2.0), wires=stage.wires)
        running = [asyncio.ensure_future(stage.run()), asyncio.ensure_future(flight.run())]
        while flight.state is not State.TRACKING:  # noqa: ASYNC110  # no event tells it
            await asyncio.sleep(0.001)
        await asyncio.sleep(0.503)
        assert stage.board is not None, "Betaflight flies it"
        struck_s = loop.time()
        stage.board.on_motors = lambda time_s, signals: motors.append((time_s - struck_s, signals))
        strike(stage)
        await asyncio.sleep(WATCHED_S)
        for task in running:
            task.cancel()
        await asyncio.gather(*running, return_exceptions=True)
        return StrikeOutcome(motors, stage.plant.floor.hardest_m_s)

    world, config = prepare(by_betaflight(SCENARIOS["paper"]), list(SHORT), link=link)
    world, config = from_floor(world, config, 30.0)
    return watch()


def _pacer_of(stage: Stage) -> InlinePacer:
    assert stage.port.pacer is not None, "a radio has one"
    return stage.port.pacer


def interrupt_bridge(stage: Stage) -> None:
    """The bridge's operator presses Ctrl-C."""
    assert stage.bridge_task is not None, "there is a bridge"
    stage.bridge_task.cancel()


def cut_bridge_off(stage: Stage) -> None:
    """The bridge's network is gone."""
    assert stage._bridge is not None, "there is a bridge"
    assert stage._bridge._wire is not None, "it listens"
    stage._bridge._wire.abort()


def cut_wire(stage: Stage) -> None:
    """No frame leaves any more: the port is gone, or pacer and stand-by are."""
    stage.port.cut = True


def hold_for_ever(stage: Stage) -> None:
    """Cut the wire before a receiver that holds its last pulses."""
    _set_failsafe(stage).failsafe_gives = "hold"
    cut_wire(stage)


def give_invalid(stage: Stage) -> None:
    """Cut the wire before a receiver whose pulses then mean nothing."""
    _set_failsafe(stage).failsafe_gives = "invalid"
    cut_wire(stage)


def _set_failsafe(stage: Stage) -> PulseReceiver:
    assert stage.radio is not None, "there is a radio"
    assert isinstance(stage.radio.receiver, PulseReceiver), "before Betaflight"
    return stage.radio.receiver


STRIKES: tuple[tuple[str, Callable[[Stage], None], str], ...] = (
    ("pacer killed", lambda stage: _pacer_of(stage).strike(), "crsf"),
    ("pacer stopped", lambda stage: _pacer_of(stage).strike(stopped=True), "dsm"),
    ("station killed", lambda stage: _pacer_of(stage).lose_commander(), "crsf"),
    ("station stopped", lambda stage: _pacer_of(stage).lose_commander(stopped=True), "dsm"),
    ("bridge interrupted", interrupt_bridge, "rf_bridge"),
    ("bridge's network gone", cut_bridge_off, "rf_bridge"),
    ("port cut, or pacer and stand-by killed", cut_wire, "crsf"),
    ("the same, receiver gives invalid pulses", give_invalid, "dsm"),
    ("the same, receiver holds its last pulses", hold_for_ever, "dsm"),
)


def respond(axis: int, rate_deg_s: float, gains: Sequence[str] = GAINS) -> tuple[float, float, float]:
    """Lag and delay [s] that fit its body rate best after steps of the stick, and the overshoot [-]."""
    world, _ = prepare(by_betaflight(SCENARIOS["paper"]), ["sim.wind_mean=[0,0,0]", "sim.floor_z_m=1000"], link="crsf")
    plant = Quadrotor(world, Wind(world, rows(generator(0, "turbulence").standard_normal, 3)))
    full = (200.0, 200.0, 300.0)
    board = FlightBoard(plant, [*describe_settings(512.0, "AETR1234", full), *gains], _quiet(), 0.0)
    seen, told = list[float](), list[float]()
    sign = (1.0, -1.0, 1.0)[axis]

    @in_virtual_time
    async def run() -> None:
        loop = asyncio.get_running_loop()
        flying = asyncio.ensure_future(board.run())
        pulses = [1500.0, 1500.0, 988.0, 1500.0, 988.0]
        board.hear(pulses)
        await asyncio.sleep(0.5)
        for thrust, arm, lasts in ((988.0, 2012.0, 0.5), (HOVER_US, 2012.0, 0.7)):
            pulses[2], pulses[4] = thrust, arm
            board.hear(pulses)
            await asyncio.sleep(lasts)
        for level in (1.0, 0.0, -1.0, 0.0):
            pulses[(0, 1, 3)[axis]] = 1500.0 + 512.0 * sign * level * rate_deg_s / full[axis]
            board.hear(pulses)
            for _ in range(500):
                await asyncio.sleep(STEP_S)
                seen.append(math.degrees(plant.truth(loop.time()).rates_rad_s[axis]))
                told.append(level * rate_deg_s)
        flying.cancel()
        await asyncio.gather(flying, return_exceptions=True)

    run()
    lag, delay = _fit(np.array(told), np.array(seen))
    return lag, delay, max(seen[:500]) / rate_deg_s - 1.0


HOVER_US = 1725.0
"""About what carries the vehicle of 80 g."""


def _quiet() -> Any:
    while True:
        yield [0.0, 0.0, 0.0]


def _fit(told: Any, seen: Any) -> tuple[float, float]:
    """Least squares over all lags of 2 to 100 ms and delays of 0 to 80 ms, by milliseconds."""
    best = (math.inf, 0.0, 0.0)
    for lag in np.arange(0.002, 0.1, 0.001):
        keep, level, answer = math.exp(-STEP_S / lag), 0.0, np.empty(len(told))
        for k, wanted in enumerate(told):
            level = wanted + keep * (level - wanted)
            answer[k] = level
        for late in range(80):
            error = float(np.sum((np.concatenate((np.zeros(late), answer[: len(answer) - late])) - seen) ** 2))
            best = min(best, (error, float(lag), late * STEP_S))
    return best[1], best[2]


TO_RECEIVER_S = 0.005 + 14 * 10 / 125000
"""Time from a command's leaving to the receiver's last bit of it [s]: the link's lead, and DSM's
frame on the wire."""


def measure_rates() -> dict[str, Any]:
    """Lag + delay of the rates, by steps on the plant and as ``identify`` finds them in a flight of excitation.

    Those of ``identify`` count from a command's leaving; ``responses`` are their sums from the receiver on, with their
    95 % intervals [s].
    """
    steps = {name: respond(axis, 100.0) for axis, name in enumerate(("roll", "pitch", "yaw"))}
    with tempfile.TemporaryDirectory() as folder:
        told = ["trajectory.kind=excitation", "sim.start_ned=[0,0,-1]"]  # where it begins: a pull-in would clip thrust
        simulate("paper", autopilot=BETAFLIGHT, link="dsm", duration=40.0, overrides=told, out=folder)
        found = identify(read_stretch(Path(folder) / RECORDING)).parameters
    timing = ("rate_lag", "rate_delay", "yaw_rate_lag", "yaw_rate_delay", "thrust_lag", "thrust_delay")
    responses = {
        axis: None if one.value is None else [x - TO_RECEIVER_S for x in (one.value, *(one.interval or ()))]
        for axis, one in ((axis, found[f"{'yaw_' * (axis == 'yaw')}rate_response"]) for axis in steps)
    }
    return {"steps": steps, "responses": responses, "identified": {name: found[name].value for name in timing}}


FLIGHTS: tuple[tuple[str, str, Sequence[str], float, str], ...] = (
    ("hover", "paper", ["trajectory.kind=hold"], 30.0, "0.25"),
    ("eight, 0.5 m/s", "paper", ["sim.speed_m_s=0.5"], 40.0, "0.35"),
    ("eight, 1.0 m/s", "paper", ["sim.speed_m_s=1.0"], 40.0, "0.60"),
    ("adverse, 0.5 m/s", "adverse", [], 60.0, "2.0"),
    ("hover, rotors 15 % weak", "paper", ["trajectory.kind=hold", "sim.thrust_gain=0.85"], 30.0, "–"),
)
"""Flights, and their limits [cm RMS]."""


OWN_GAINS: tuple[tuple[str, Sequence[str]], ...] = (
    ("hover, the firmware's own gains", ()),
    ("… all of them but i_yaw, which is 10", ("set simplified_pids_mode = OFF", "set i_yaw = 10")),
)


def hover_on(gains: Sequence[str], seed: int) -> tuple[float | None, float]:
    """RMS [cm] of 30 s of hover on other gains, None where the flight was lost; and how long it lasted [s]."""
    world, config = prepare(by_betaflight(SCENARIOS["paper"]), ["trajectory.kind=hold"], link="dsm")
    with patch.object(autopilots, "GAINS", gains, create=True):
        result = fly(world, config, seed=seed, duration_s=30.0, autopilot=BETAFLIGHT)
    return (result.verdict.rms_cm if result.completed else None), result.duration_s


def gust(seed: int) -> tuple[float, float]:
    """The largest error in `gust_front`'s hover [cm], and how long it then takes to get under 5 cm [s]."""
    at_s, lasts_s, errors = 16.0, 22.0, list[tuple[float, float]]()
    world, config = prepare(
        by_betaflight(SCENARIOS["gust_front"]), ["trajectory.kind=hold", f"sim.wind_step_time_s={at_s}"], link="dsm"
    )
    place = config.trajectory.build().position_at(0.0)

    def see(time_s: float, at: Vec3) -> None:
        errors.append((time_s, math.dist(at, place)))

    fly(world, config, seed=seed, duration_s=lasts_s, autopilot=BETAFLIGHT, on_step=see)
    begun_s = errors[-1][0] - lasts_s + at_s
    after = [(time_s - begun_s, error) for time_s, error in errors if time_s > begun_s]
    return 100.0 * max(error for _, error in after), max((t for t, error in after if error > 0.05), default=0.0)


def take_off(scenario: str, seeds: Sequence[int]) -> dict[str, Any]:
    """Whole flights from the floor and back: how many landed, began smoothly, and the worst of each figure."""
    missions, starts = list[MissionResult](), list[TakeoffStart]()
    for seed in seeds:
        world, config = prepare(by_betaflight(SCENARIOS[scenario]), list(SHORT), link=("dsm", "crsf")[seed % 2])
        world, config = from_floor(world, config, 1.0)
        start = TakeoffStart()

        async def script(flight: Flight, stage: Stage, start: TakeoffStart = start, world: World = world) -> None:
            start.watch(flight, stage, world)

        missions.append(fly_mission(world, config, seed=seed, autopilot=BETAFLIGHT, script=script))
        starts.append(start)
    wind = SCENARIOS[scenario].world.wind_mean
    return {
        "of": len(missions),
        "landed": sum(one.landed for one in missions),
        "smooth": sum(one.smooth for one in starts),
        "thrust_low": min(min(one.thrust) for one in starts),
        "thrust_high": max(max(one.thrust) for one in starts),
        "climb_m_s": max(max(one.climb) for one in starts),
        "tilt_deg": max(max(one.tilt_deg) for one in starts),
        "b": max(max(one.b) for one in starts),
        "least_tilt_deg": [one.least_tilt_deg for one in starts],
        "wind_tilt_deg": math.degrees(math.atan2(math.hypot(*wind[:2]), SCENARIOS[scenario].world.gravity)),
        "touchdown_m_s": max(one.touchdown_m_s or 0.0 for one in missions),
        "home_m": max(one.home_m for one in missions),
    }


def firmware(args: argparse.Namespace) -> Exit:
    """Measure, and print or write the tables."""
    if args.write is not None:
        split_at_markers(args.write, "firmware")  # before minutes go by
    facts: dict[str, Any] = {"flights": {}, "strikes": {}}
    for name, scenario, told, lasts_s, must in FLIGHTS:
        world, config = prepare(by_betaflight(SCENARIOS[scenario]), list(told), link="dsm")
        verdicts = [
            fly(world, config, seed=seed, duration_s=lasts_s, autopilot=BETAFLIGHT).verdict.rms_cm for seed in SEEDS
        ]
        facts["flights"][name] = {"rms_cm": [v if v is not None else math.inf for v in verdicts], "must": must}
    facts["own_gains"] = {name: [hover_on(gains, seed) for seed in SEEDS] for name, gains in OWN_GAINS}
    facts["gust"] = [gust(seed) for seed in SEEDS]
    for name, strike, link in STRIKES:
        struck = strike_down(strike, link)
        facts["strikes"][name] = {"link": link, "off_s": struck.off_s, "hit_m_s": struck.hit_m_s}
    facts["take_offs"] = {name: take_off(name, seeds) for name, seeds in TAKE_OFFS.items()}
    facts["rates"] = measure_rates()
    facts["default_gains"] = [respond(axis, 100.0, ()) for axis in range(3)]
    text = tables(facts)
    print(json.dumps(facts) if args.json else text)
    if args.write is not None:
        replace_between_markers(args.write, text, "firmware")
    return Exit.DONE


def tables(facts: dict[str, Any]) -> str:
    """The facts as Markdown."""
    lines = ["| flown over DSM, 50 Hz poses, 20 ms | RMS cm, median of 3 seeds (worst) | must |", "|---|---|---|"]
    for name, row in facts["flights"].items():
        lines.append(f"| {name} | {median(row['rms_cm']):.2f} ({max(row['rms_cm']):.2f}) | {row['must']} |")
    for name, flown in facts["own_gains"].items():
        rms = [one for one, _ in flown if one is not None]
        lost = [lasted for one, lasted in flown if one is None]
        told = f"{median(rms):.2f} ({max(rms):.2f})" if rms and not lost else f"{len(lost)} of {len(flown)} lost"
        lines.append(f"| {name} | {told}{f', within {max(lost):.1f} s' if lost else ''} | – |")
    peak, back = max(p for p, _ in facts["gust"]), max(b for _, b in facts["gust"])
    lines.append(
        f"| a step of wind of 1.5 m/s² in the hover | {peak:.1f} cm at most, under 5 cm after {back:.2f} s | 8, 1.5 s |"
    )
    lines += [
        "",
        "| from the floor and back, DSM and CRSF | landed | within all limits at lift-off "
        "| rotors, share of the weight | climb off by | tilt | least tilt of any law | b̂ of its bound "
        "| worst touchdown | off the place of take-off |",
        "|---" * 10 + "|",
        "| must | all | all | 0.75 to 1.25 | 0.3 m/s | 8° | – | 0.5 | – | – |",
    ]
    for name, took in facts["take_offs"].items():
        lines.append(
            f"| `{name}`, whose wind asks for {took['wind_tilt_deg']:.1f}° | {took['landed']} of {took['of']} "
            f"| {took['smooth']} of {took['of']} | {took['thrust_low']:.2f} to {took['thrust_high']:.2f} "
            f"| {took['climb_m_s']:.2f} m/s | {took['tilt_deg']:.1f}° "
            f"| {min(took['least_tilt_deg']):.1f} to {max(took['least_tilt_deg']):.1f}° | {took['b']:.2f} "
            f"| {took['touchdown_m_s']:.2f} m/s | {100.0 * took['home_m']:.1f} cm |"
        )
    lines += [
        "",
        "| struck in flight | over | firmware's motors off after | met the floor at |\n|---|---|---|---|",
    ]
    for name, row in facts["strikes"].items():
        off = "never" if row["off_s"] > WATCHED_S - 0.1 else f"{row['off_s']:.2f} s"
        hit = "–" if row["hit_m_s"] is None else f"{row['hit_m_s']:.2f} m/s"
        lines.append(f"| {name} | {row['link']} | {off} | {hit} |")
    lines += [
        "",
        "| rate | lag + delay, steps on the plant | `identify`, in flight (95 %) | apart | overshoot "
        "| with the firmware's own gains |",
        "|---" * 6 + "|",
    ]
    rates = facts["rates"]
    for (name, (lag, delay, over)), own in zip(rates["steps"].items(), facts["default_gains"], strict=True):
        told, apart = "–", "–"
        if (response := rates["responses"][name]) is not None:
            value, low, high = (1e3 * x for x in response)
            told, apart = f"{value:.0f} ms ({low:.0f} to {high:.0f})", f"{0.1 * value / (lag + delay) - 100.0:+.0f} %"
        lines.append(
            f"| {name} | {1e3 * lag:.0f} + {1e3 * delay:.0f} = {1e3 * (lag + delay):.0f} ms | {told} | {apart} "
            f"| {100.0 * over:.0f} % | {1e3 * own[0]:.0f} + {1e3 * own[1]:.0f} ms, overshoot {100.0 * own[2]:.0f} % |"
        )
    found = rates["identified"]
    lines += [
        "",
        f"In flight less the {1e3 * TO_RECEIVER_S:.0f} ms from a command's leaving to the receiver. "
        "`identify`'s parts, from leaving: "
        + ", ".join(f"{key} {1e3 * value:.0f} ms" for key, value in found.items() if value is not None)
        + ".",
    ]
    return "\n".join(lines)
