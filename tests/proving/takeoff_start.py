"""Take-off's first second: whether anything jumps as the law takes over."""

import asyncio
import math
from collections.abc import Sequence

import msgspec

from groundstation.core.control import Adaptive
from groundstation.core.geometry import so3
from groundstation.core.messages import CommandSent, FlightEvent
from groundstation.flight import Flight
from groundstation.settings import Config
from sim.autopilots import Airworthy
from sim.runs import MISSION_CONFIRM_S, MissionResult, Stage, fly_mission
from sim.world import World

SEEDS = range(3)
"""Seeds of a firmware's flights in the air."""


class TakeoffStart(msgspec.Struct):
    """True motion in the first second of a flight's law after the floor, at each command."""

    thrust: list[float] = []
    """Thrust of the rotors as a share of the weight [-]."""
    climb: list[float] = []
    """Upward speed above the reference's [m/s]."""
    tilt_deg: list[float] = []
    b: list[float] = []
    """|b̂| as a share of its bound."""
    off_m: list[float] = []
    """Distance from the reference [m]."""
    aside_m: list[float] = []
    """And from over where it stood [m]."""
    begun_s: float | None = None
    """When the law gave its first command."""

    @property
    def smooth(self) -> bool:
        """Whether nothing jumped."""
        return (
            bool(self.thrust)
            and min(self.thrust) >= 0.75
            and max(self.thrust) <= 1.25
            and max(self.climb) < 0.3
            and max(self.tilt_deg) < 8.0
            and max(self.b) < 0.5
        )

    def watch(self, flight: Flight, stage: Stage, world: World) -> None:
        """Look at each command of ``flight``, which begins on the floor of ``world``."""
        weight_n = world.mass_kg * world.gravity

        def hear(event: FlightEvent) -> None:
            if not isinstance(event, CommandSent):
                return
            tick = event.tick
            self.begun_s = tick.time_s if self.begun_s is None else self.begun_s
            if tick.time_s - self.begun_s > 1.0:
                return
            truth = stage.plant.truth(asyncio.get_running_loop().time())
            self.thrust.append(truth.thrust_n / weight_n)
            self.climb.append(abs(truth.velocity_ned[2] - tick.reference.velocity_ned[2]))
            self.tilt_deg.append(so3.angle_deg(so3.third_column(truth.attitude)[2]))
            law = flight._pilot._controller
            assert isinstance(law, Adaptive), "ours flies"
            self.b.append(math.hypot(*law.b_hat) / law.gains.b_bound)
            self.off_m.append(math.dist(truth.position_ned, tick.reference.position_ned))
            self.aside_m.append(math.dist(truth.position_ned[:2], world.start_ned[:2]))

        flight._subscribers += (hear,)


class TakeOff(msgspec.Struct, frozen=True):
    """Mission from the floor and back, and its first second."""

    mission: MissionResult
    start: TakeoffStart


def fly_take_off(
    world: World,
    config: Config,
    seed: int,
    autopilot: str | Airworthy,
    confirm_s: float = MISSION_CONFIRM_S,
) -> TakeOff:
    """Fly a mission from the floor of ``world``; arming is confirmed at ``confirm_s`` [s]."""
    start = TakeoffStart()

    async def script(flight: Flight, stage: Stage) -> None:
        start.watch(flight, stage, world)

    mission = fly_mission(
        world, config, seed=seed, autopilot=autopilot, script=script, confirm_s=confirm_s
    )
    return TakeOff(mission, start)


HEAD = (
    "| from the floor and back | landed | within all limits at lift-off | rotors, share of the "
    "weight | climb off by | tilt | b̂ of its bound | worst touchdown | off the place of take-off "
    "|",
    "|---" * 9 + "|",
    "| must | all | all | 0.75 to 1.25 | 0.3 m/s | 8° | 0.5 | – | – |",
)
"""First lines of the table of take-offs."""


def describe(name: str, flown: Sequence[TakeOff]) -> str:
    """The line of the table for ``flown``: counts, and the worst of each figure."""
    missions, starts = [one.mission for one in flown], [one.start for one in flown]
    landed = f"| {name} | {sum(one.landed for one in missions)} of {len(missions)} "
    seen = [one for one in starts if one.thrust]
    if not seen:  # none left the floor
        return f"{landed}| 0 of {len(missions)} " + "| – " * 6 + "|"
    return (
        f"{landed}| {sum(one.smooth for one in starts)} of {len(starts)} | "
        f"{min(min(one.thrust) for one in seen):.2f} to {max(max(one.thrust) for one in seen):.2f} "
        f"| {max(max(one.climb) for one in seen):.2f} m/s | "
        f"{max(max(one.tilt_deg) for one in seen):.1f}° | {max(max(one.b) for one in seen):.2f} | "
        f"{max(one.touchdown_m_s or 0.0 for one in missions):.2f} m/s | "
        f"{100.0 * max(one.home_m for one in missions):.1f} cm |"
    )
