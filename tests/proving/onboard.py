"""PX4's and ArduCopter's own firmware on our rotors, in a lab's own wiring: ``autopilots --lockstep``.

The rotor-level plant of ``rotors_quad1kg`` is the firmware's simulator. Poses come from the
simulated tracker alone, and go on to the autopilot by ``link.forward``; there is no GPS. Of its
parameters, airframe, mixer, rate gains and arming without a transmitter come from
sim/autopilots/px4.params or ardupilot.parm, and all others are what ``groundstation doctor`` asks
for. Time is the plant's; errors are the truth's.
"""

import asyncio
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from groundstation.lab import DoctorOrders, run_doctor
from groundstation.settings import Config
from sim.autopilots import Airworthy, make_ardupilot, make_px4
from sim.runs import Stage, from_floor
from sim.scenarios import SCENARIOS, prepare
from sim.time import in_virtual_time
from sim.world import World

NAMES = {"px4": "PX4", "ardupilot": "ArduCopter"}
MAKERS: Mapping[str, Callable[[Path], Any]] = {"px4": make_px4, "ardupilot": make_ardupilot}
WIRED = ("link.forward.enabled=true",)
"""What a lab says that forwards its poses."""
ALIGNED_S = 25.0
"""When arming is confirmed: its estimator has taken in the poses by then [s]."""
SAVED_S = 4.0
"""How long parameters that were set take to reach its memory, and more [s]."""
VISITS = 5
"""After so many restarts the doctor has nothing left to ask for."""


class Change(NamedTuple):
    """One parameter that the doctor changed."""

    name: str
    before: float
    now: float


def set_up(overrides: Sequence[str], figure_s: float | None, source: str = "vicon") -> tuple[World, Config]:
    """The vehicle on the floor, and what is told of it."""
    return from_floor(*prepare(SCENARIOS["rotors_quad1kg"], [*WIRED, *overrides], source=source), figure_s)


@in_virtual_time
async def visit(airworthy: Airworthy) -> tuple[list[Change], Path]:
    """What the doctor finds wrong on one firmware and sets; it is switched off then. And its folder."""
    world, config = set_up((), 1.0)
    stage = Stage(world, config, 0, autopilot=airworthy)
    assert stage.onboard is not None, "real firmware"
    folder, said = stage.onboard.firmware.folder, list[str]()
    running = asyncio.ensure_future(stage.run())
    orders = DoctorOrders("groundstation doctor", as_json=True, yes=True, folder=folder)
    try:
        await run_doctor(config, orders._replace(yes=False), None, said.append)
        findings = json.loads(said[-1])["findings"]
        wrong = tuple(finding["name"] for finding in findings if finding["recommended"] is not None)
        if wrong:
            await run_doctor(config, orders._replace(fix=wrong), None, said.append)
            await asyncio.sleep(SAVED_S)
        return [Change(one["name"], one["old"], one["new"]) for one in json.loads(said[-1])["fixed"]], folder
    finally:
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)


class Workshop:
    """A firmware whose parameters are as the doctor wants them. Use it in ``with``."""

    def __init__(self, make: Any) -> None:
        self.changes = list[Change]()
        """What the doctor changed, in order."""
        self._make = make
        self._kept = list[Airworthy]()

    def __enter__(self) -> Airworthy:
        folder = None
        for _ in range(VISITS):
            airworthy = self._keep(folder)
            changed, folder = visit(airworthy)
            if not changed:
                return airworthy
            self.changes += changed
        raise AssertionError(f"after {VISITS} restarts the doctor still asks for {self.changes[-1]}")

    def _keep(self, prepared: Path | None) -> Airworthy:
        self._kept.append(Airworthy(self._make, prepared))
        return self._kept[-1]

    def __exit__(self, *_: object) -> None:
        for one in self._kept:
            one.__exit__()
