"""The scenarios by name: what is true, and what the controller is told. Exact definitions, so numbers compare."""

from typing import Any

import msgspec

from groundstation.config import from_dict
from groundstation.core.trajectory import LemniscateConfig
from groundstation.core.vehicle import Vehicle
from groundstation.settings import Config, FlightConfig
from links.mavlink import MavlinkLinkConfig
from sim.world import World

NO_LIMIT = (1e5, 1e5, 1e5)
MQX = World()
_IDEAL = msgspec.structs.replace(
    MQX,
    thrust_lag_s=0.0,
    rate_lag_s=0.0,
    rate_limits_deg_s=NO_LIMIT,
    pose_noise_m=0.0,
    attitude_noise_rad=0.0,
    pose_latency_s=0.0,
    pose_rate_hz=500.0,
    frame_period_s=0.002,
    step_s=0.002,
    wind_mean=(0.4, -0.3, 0.5),
)
_ADVERSE = msgspec.structs.replace(
    MQX,
    thrust_gain=0.85,
    thrust_sag=0.05,
    thrust_lag_s=1.13 * MQX.thrust_lag_s,
    rate_lag_s=0.85 * MQX.rate_lag_s,
    wind_mean=(1.0, -0.8, 0.5),
    wind_gust=(0.5, 0.5, 0.2),
    wind_turbulence=0.2,
    drag_per_s=0.1,
    rate_leak=0.02,
    pose_noise_m=0.0006,
    attitude_noise_rad=0.004,
    pose_loss=0.02,
    outage_s=0.15,
    frame_loss=0.02,
)
_WEAK = ("takeoff.thrust_limit=1.7",)
"""In this wind its battery hovers it only at 1.24 (`adverse`) to 1.34 (`storm`) of the told weight."""
_QUAD1KG = msgspec.structs.replace(
    MQX,
    mass_kg=1.0,
    thrust_max_n=20.0,
    thrust_lag_s=0.030,
    rate_lag_s=0.020,
    rotor_radius_m=0.12,
    drag_per_s=1.0,
    pose_rate_hz=100.0,
    pose_latency_s=0.010,
    frame_period_s=0.010,
)


class Scenario(msgspec.Struct, frozen=True, kw_only=True):
    """A world, and what the controller is told of it."""

    name: str
    summary: str
    """One line for people."""
    world: World
    told: Vehicle = Vehicle()
    """The vehicle as the controller believes it."""
    told_latency_s: float = 0.020
    """The pose latency as the controller believes it [s]."""
    told_more: tuple[str, ...] = ()
    """What else it is told, as in ``--set``."""

    def config(self, world: World, overrides: list[str], source: str, link: str = "mavlink") -> Config:
        """The application's configuration for ``world`` (this scenario's, perhaps overridden).

        The reference's speed and the period of the frames are facts of the flight and follow ``world``; all
        else is what the scenario tells the controller. A radio ``link`` takes full stick for the vehicle's limits.
        """
        config = Config(
            vehicle=self.told,
            link=MavlinkLinkConfig(period_s=world.frame_period_s, pace="period"),
            trajectory=LemniscateConfig(speed_m_s=world.speed_m_s),
            flight=FlightConfig(start="air", idle_thrust=world.start_thrust, floor_z_m=world.floor_z_m),
        )
        data: dict[str, Any] = msgspec.to_builtins(config)
        del data["controller"]  # all default, and the defaults depend on the kind that ``overrides`` may choose
        data["pose"] = self._told_poses(source, world)
        data["gate"]["drop_frozen"] = _is_noisy(world)
        for key in ("vehicle.preset", "vehicle.file", "trajectory.kind", "pose.kind"):
            if any(override.partition("=")[0].strip() == key for override in overrides):
                data.pop(key.partition(".")[0], None)  # another vehicle, another trajectory: nothing of this one
        overrides = [*self.told_more, *overrides]
        if link != "mavlink":
            from sim.radio import module, section  # a radio's modules are imported only where there is one

            data["link"] = section(link, world, self.told)
            # Only the codec that results knows how long a frame is on its way.
            radio = module(from_dict(data, Config, overrides), world)
            data.setdefault("vehicle", {})["command_delay_s"] = radio.lead_s + radio.frame_s
        return from_dict(data, Config, overrides)

    def _told_poses(self, source: str, world: World) -> dict[str, Any]:
        """What the controller is told of its poses when they come from ``source``."""
        latency = {"latency_s": self.told_latency_s}
        rate = {"rate_hz": self.world.pose_rate_hz}
        return {
            "vicon": {"kind": "vicon", "object": "quad", "drop_frozen": _is_noisy(world), **latency, **rate},
            "natnet": {"kind": "natnet", "network_s": 0.0},  # all else of its latency it tells itself
            "qualisys": {"kind": "qualisys", **latency},
            "odometry": {"kind": "mavlink", **latency, **rate},
            "vision": {"kind": "vision", **latency},
            "json": {"kind": "json", **latency, **rate},
        }[source]


def _is_noisy(world: World) -> bool:
    """Without noise a vehicle that is held looks frozen."""
    return world.pose_noise_m > 0.0 or world.attitude_noise_rad > 0.0


_TOLD_QUAD1KG = Vehicle(
    name="quad1kg",
    mass_kg=1.0,
    thrust_max_n=20.0,
    thrust_min_n=0.5,
    thrust_lag_s=0.030,
    rate_lag_s=0.020,
    frame_period_s=0.010,
    size_m=0.8,
)

SCENARIOS: dict[str, Scenario] = {
    s.name: s
    for s in (
        Scenario(
            name="ideal",
            summary="no lag, noise, latency or rate limit, 500 Hz: checks the theory",
            world=_IDEAL,
            told=Vehicle(thrust_lag_s=0.0, rate_lag_s=0.0, rate_limits_deg_s=NO_LIMIT, frame_period_s=0.002),
            told_latency_s=0.0,
            told_more=("controller.effectiveness_deviation=0",),  # V's floor is of a law that knows its thrust
        ),
        Scenario(name="paper", summary="the paper's vehicle and figure eight in a constant wind", world=MQX),
        Scenario(
            name="fast",
            summary="paper at 1.5 m/s",
            world=msgspec.structs.replace(MQX, speed_m_s=1.5),
        ),
        Scenario(
            name="adverse",
            summary="wrong thrust and lags, wind, gusts, turbulence, drag, lost poses and frames, sagging battery",
            world=_ADVERSE,
            told_more=_WEAK,
        ),
        Scenario(
            name="storm",
            summary="adverse with wind and gusts doubled and 40 ms of latency",
            world=msgspec.structs.replace(
                _ADVERSE, wind_mean=(2.0, -1.6, 1.0), wind_gust=(1.0, 1.0, 0.4), pose_latency_s=0.040
            ),
            told_latency_s=0.040,
            told_more=_WEAK,
        ),
        Scenario(
            name="gust_front",
            summary="paper, and at 30 s the wind steps by 1.5 m/s²",
            world=msgspec.structs.replace(MQX, wind_step=(1.5, 0.0, 0.0)),
        ),
        Scenario(
            name="quad1kg",
            summary="a 1 kg vehicle with fast actuators, 100 Hz, 10 ms, drag 1 N per m/s",
            world=_QUAD1KG,
            told=_TOLD_QUAD1KG,
            told_latency_s=0.010,
        ),
    )
}
