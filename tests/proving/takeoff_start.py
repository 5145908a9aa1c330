"""Take-off's first second: whether anything jumps as the law takes over."""

import asyncio
import math
from collections.abc import Sequence

import msgspec

from groundstation.core.control import Adaptive
from groundstation.core.geometry import so3
from groundstation.core.messages import CommandSent, FlightEvent
from groundstation.flight import Flight
from sim.runs import Stage
from sim.world import World


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
    least_tilt_deg: float = 0.0
    """The least lean by which any law, however quick, and told the wind beforehand, has stopped it by the end."""
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
        seen_s, pushed = 0.0, [0.0, 0.0, 0.0]  # by the rotors since it began [m/s, NED]

        def hear(event: FlightEvent) -> None:
            if not isinstance(event, CommandSent):
                return
            nonlocal seen_s
            tick = event.tick
            self.begun_s = tick.time_s if self.begun_s is None else self.begun_s
            if tick.time_s - self.begun_s > 1.0:
                return
            truth = stage.plant.truth(asyncio.get_running_loop().time())
            since_s = tick.time_s - self.begun_s
            for k, down in enumerate(so3.third_column(truth.attitude)):
                pushed[k] -= (since_s - seen_s) * truth.thrust_n / world.mass_kg * down
            seen_s = since_s
            # What the rotors gave sideways less the speed that is left is what had to be given, by whatever law.
            aside = [push - speed for push, speed in zip(pushed[:2], truth.velocity_ned[:2], strict=True)]
            self.least_tilt_deg = math.degrees(math.atan2(math.hypot(*aside), -pushed[2]))
            self.thrust.append(truth.thrust_n / weight_n)
            self.climb.append(abs(truth.velocity_ned[2] - tick.reference.velocity_ned[2]))
            self.tilt_deg.append(so3.angle_deg(so3.third_column(truth.attitude)[2]))
            law = flight._pilot._controller
            assert isinstance(law, Adaptive), "ours flies"
            self.b.append(math.hypot(*law.b_hat) / law.gains.b_bound)
            self.off_m.append(math.dist(truth.position_ned, tick.reference.position_ned))
            self.aside_m.append(math.dist(truth.position_ned[:2], world.start_ned[:2]))

        flight._subscribers += (hear,)


def describe_worst(starts: Sequence[TakeoffStart]) -> str:
    """Cells of a table: range of the thrust, worst climb, tilt and b̂ of ``starts``, which all left the floor."""
    return (
        f"| {min(min(one.thrust) for one in starts):.2f} to {max(max(one.thrust) for one in starts):.2f} "
        f"| {max(max(one.climb) for one in starts):.2f} m/s | {max(max(one.tilt_deg) for one in starts):.1f}° "
        f"| {max(max(one.b) for one in starts):.2f} "
    )
