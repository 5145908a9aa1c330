"""Scenarios by name, and a flight's preparation by one: what is true, and what the controller is
told.

Exact definitions, so numbers compare. ``--set`` changes what the controller is told, ``sim.…``
overrides the truth.

A user's own configuration flies at the desk in a scenario's air and before its sensors. The
simulated vehicle is then exactly what the controller is told, so what is seen is the trajectory,
the gains and the air; ``sim.…`` overrides make the truth differ. Poses and commands take the
simulator's own way, whatever the lab uses.
"""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec

import sim.scenarios.gale as gale  # noqa: PLR0402  # not through the face that imports this
from groundstation.config import ConfigError, from_dict, load, parse_toml
from groundstation.core.geometry import Vec3
from groundstation.core.trajectory import LemniscateConfig
from groundstation.core.vehicle import Vehicle
from groundstation.flight.preflight import examine_trajectory
from groundstation.pose import PoseConfig
from groundstation.pose.sources import GateConfig, ViconConfig
from groundstation.settings import Config, FlightConfig
from links.mavlink import MavlinkLinkConfig
from sim.text import notice
from sim.world import RotorConstants, WindTunnel, World

BETAFLIGHT = "betaflight"
"""Name of Betaflight's firmware for ``--autopilot``."""
NO_LIMIT = (1e5, 1e5, 1e5)
"""Body rates that nothing reaches [deg/s]."""
MQX = World()
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
"""In this wind its battery hovers it only at 1.24 (`adverse`) to 1.34 (`storm`) of the told
weight."""
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
# What these three are told is what `identify` found on one flight of `trajectory.kind=excitation`
# each, 42 s, seed 0, in which they were told their best pure lags (thrust and rates: 43 and 42, 41
# and 54, 109 and
# 104 ms).
_ROTORS_QUAD1KG = msgspec.structs.replace(
    _QUAD1KG,
    plant="rotors",
    step_s=0.001,
    rotors=RotorConstants(
        arm_m=0.175,
        inertia_kg_m2=(0.0075, 0.0075, 0.013),
        torque_per_thrust_m=0.016,
        p=40.0,
        i=40.0,
        d=0.8,
    ),
)
_ROTORS_MQX = msgspec.structs.replace(MQX, plant="rotors", step_s=MQX.frame_period_s / 23)
"""1 kHz, in whole steps a frame."""


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
    """Additional settings of the controller, as for ``--set``."""

    figure: Callable[[], dict[str, Any]] | None = None
    """Makes the trajectory, as in ``[trajectory]``; None for the paper's figure of eight."""
    variants: tuple[tuple[str, ...], ...] = ()
    """Overrides of the truth; ``compare`` flies it with each, and the worst of them counts."""
    betaflight: bool = False
    """Whether it is flown by Betaflight, behind a radio: see :func:`by_betaflight`."""

    def config(
        self, world: World, overrides: list[str], source: str, link: str = "mavlink"
    ) -> Config:
        """The application's configuration for ``world`` (this scenario's, perhaps overridden).

        The reference's speed and the period of the frames are facts of the flight and follow
        ``world``; all else is what the scenario tells the controller. A radio ``link`` takes full
        stick for the vehicle's limits.
        """
        config = Config(
            vehicle=self.told,
            link=MavlinkLinkConfig(period_s=world.frame_period_s, pace="period"),
            trajectory=LemniscateConfig(speed_m_s=world.speed_m_s),
            flight=FlightConfig(
                start="air", idle_thrust=world.start_thrust, floor_z_m=world.floor_z_m
            ),
        )
        data: dict[str, Any] = msgspec.to_builtins(config)
        # All default, and the defaults depend on the kind that ``overrides`` may choose.
        del data["controller"]
        data["pose"] = self._told_poses(source, world)
        if self.figure is not None:
            data["trajectory"] = self.figure()
        data["gate"]["drop_frozen"] = _is_noisy(world)
        for key in ("vehicle.preset", "vehicle.file", "trajectory.kind", "pose.kind"):
            if any(override.partition("=")[0].strip() == key for override in overrides):
                # Another vehicle, another trajectory: nothing of this one.
                data.pop(key.partition(".")[0], None)
        overrides = [*self.told_more, *overrides]
        if link != "mavlink":
            from sim.radio import (
                module,
                section,
            )  # a radio's modules are imported only where there is one

            data["link"] = section(link, world, self.told, betaflight=self.betaflight)
            # Only the codec that results knows how long a frame is on its way.
            radio = module(from_dict(data, Config, overrides), world, betaflight=self.betaflight)
            data.setdefault("vehicle", {})["command_delay_s"] = radio.lead_s + radio.frame_s
        return from_dict(data, Config, overrides)

    def _told_poses(self, source: str, world: World) -> dict[str, Any]:
        """Configuration of the pose source ``source`` for this scenario."""
        latency = {"latency_s": self.told_latency_s}
        rate = {"rate_hz": self.world.pose_rate_hz}
        return {
            "vicon": {
                "kind": "vicon",
                "object": "quad",
                "drop_frozen": _is_noisy(world),
                **latency,
                **rate,
            },
            "natnet": {
                "kind": "natnet",
                "network_s": 0.0,
            },  # all else of its latency it tells itself
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
    drag_per_s=0.998,  # what `groundstation identify` finds on an excitation flight of it
    frame_period_s=0.010,
    size_m=0.8,
    wind_share=1.0,
)

DIRECTIONS = 8
"""Horizontal directions in which large pushes come; the worst of them counts."""
PUSH_S = (0.4, 1.0)
"""Lengths of the half sines [s]."""


def _blow(acceleration: float) -> list[str]:
    """The wind's step [m/s²] in each horizontal direction, as overrides of the truth."""
    angles = [2.0 * math.pi * k / DIRECTIONS for k in range(DIRECTIONS)]
    pushes = [(acceleration * math.cos(a), acceleration * math.sin(a)) for a in angles]
    return [f"sim.wind_step=[{x:.9f}, {y:.9f}, 0.0]" for x, y in pushes]


def _with_step(acceleration: float, *, vertical: bool = False) -> Scenario:
    """A ``vertical`` step comes from above and from below, too."""
    steps = _blow(acceleration)
    if vertical:
        steps += [f"sim.wind_step=[0.0, 0.0, {z}]" for z in (acceleration, -acceleration)]
    return Scenario(
        name=f"step_{acceleration:g}",
        summary=f"paper, and at 30 s the wind steps by {acceleration:g} m/s²",
        world=msgspec.structs.replace(MQX, wind_step=(acceleration, 0.0, 0.0)),
        variants=tuple((step,) for step in steps),
    )


def _with_push(acceleration: float) -> Scenario:
    world = msgspec.structs.replace(MQX, wind_step=(acceleration, 0.0, 0.0), wind_push_s=PUSH_S[0])
    return Scenario(
        name=f"push_{acceleration:g}",
        summary=f"paper, and at 30 s a push: half a sine of {acceleration:g} m/s² for 0.4 s",
        world=world,
        variants=tuple(
            (step, f"sim.wind_push_s={push_s}") for push_s in PUSH_S for step in _blow(acceleration)
        ),
    )


_TOLD_GALE = Vehicle(
    name="gale",
    mass_kg=gale.VEHICLE.mass_kg,
    thrust_max_n=0.98 * gale.VEHICLE.full_n,
    thrust_min_n=1.0,
    thrust_curve=gale.VEHICLE.thrust_curve,
    hover_thrust=gale.VEHICLE.hover,
    rate_limits_deg_s=(220.0, 220.0, 200.0),
    thrust_lag_s=gale.VEHICLE.thrust_lag_s,
    thrust_delay_s=gale.VEHICLE.thrust_delay_s,
    rate_lag_s=1.0 / gale.VEHICLE.attitude_rad_s,
    drag_per_s=0.34,
    # what `groundstation identify` finds on an excitation flight of it in still air
    frame_period_s=1.0 / gale.VEHICLE.pose_hz,
    size_m=0.8,
    wind_share=0.553,  # 12 m/s²
)
_DOUBTED = (
    "controller.acceleration_noise=0.16",
    "controller.wind_noise=0.6",
    "controller.wind_rate_noise=1.6",
)
"""Its poses are so good (0.03 mm) that an observer of the default noises takes each error of the
model for wind within two poses, and what it learns drives a thrust that acts 0.1 s later: with lags
and delay told 20 ms wrong it rings at 2 to 4 Hz. A model that is told to err by chance, too, is not
believed to show wind at once. More of it costs error where told right, less has it ring."""


def _gale(name: str, wind: gale.GaleWind) -> Scenario:
    """The wind tunnel at one setting of its fans: north is x there, west is y."""
    begun = wind.speed_m_s + wind.gust_m_s * math.sin(gale.GUST_PHASE)
    lean, push = gale.trim(begun)
    (x, y, z), (i, j, k), kg = gale.course(0.0)[0], gale.VEHICLE.rest_n, gale.VEHICLE.mass_kg
    air = gale.VEHICLE.drag / kg
    world = World(
        mass_kg=kg,
        thrust_max_n=gale.VEHICLE.full_n,
        thrust_curve=gale.VEHICLE.thrust_curve,
        rate_limits_deg_s=_TOLD_GALE.rate_limits_deg_s,
        thrust_lag_s=gale.VEHICLE.thrust_lag_s,
        thrust_delay_s=gale.VEHICLE.thrust_delay_s,
        rate_lag_s=1.0 / gale.VEHICLE.attitude_rad_s,
        drag_body_per_s=(air, air, gale.VEHICLE.sink_drag / kg),
        inflow_drag_per_m=(gale.VEHICLE.drag_inflow / kg, gale.VEHICLE.sink_inflow / kg),
        inflow_lift_per_m=gale.VEHICLE.lift / kg,
        air_velocity=(-wind.speed_m_s, 0.0, 0.0),
        wind_mean=(gale.VEHICLE.bias_n[0] / kg, -gale.VEHICLE.bias_n[1] / kg, 0.0),
        pose_rate_hz=gale.VEHICLE.pose_hz,
        pose_latency_s=gale.VEHICLE.pose_latency_s,
        pose_noise_m=gale.VEHICLE.pose_noise_m,
        pose_jitter_s=wind.jitter_s,
        attitude_noise_rad=gale.VEHICLE.attitude_noise_rad,
        frame_period_s=1.0 / gale.VEHICLE.pose_hz,
        start_ned=(x, -y, -z),
        start_thrust=min(push, 0.9),  # no more is told before the flight
        tunnel=WindTunnel(
            gust_m_s=-wind.gust_m_s,
            gust_phase_rad=gale.GUST_PHASE,
            rest_m_s2=(i / kg, j / kg, k / kg),
            rest_s=gale.VEHICLE.rest_s,
            pitch_gain=wind.gain,
            pitch_per_climb=gale.VEHICLE.attitude_rad_s * gale.VEHICLE.pitch_per_m_s
            if wind.speed_m_s
            else 0.0,
            start_pitch_deg=-math.degrees(lean),
        ),
    )
    return Scenario(
        name=name,
        summary=f"a 2.6 kg quadrotor in a fan array, wind {wind.speed_m_s:g} m/s"
        + (f" + {wind.gust_m_s:g} sin(t + {gale.GUST_PHASE:g})" if wind.gust_m_s else ""),
        world=world,
        told=_TOLD_GALE,
        told_latency_s=gale.VEHICLE.pose_latency_s,
        told_more=_DOUBTED,
        figure=_gale_course,
    )


def _gale_course() -> dict[str, Any]:
    steps = [k / 10.0 for k in range(621)]
    points = [gale.course(step) for step in steps]
    return {
        "kind": "samples",
        "times_s": steps,
        "points_ned": [(x, -y, -z) for (x, y, z), _, _ in points],
        "velocities_ned": [(x, -y, -z) for _, (x, y, z), _ in points],
    }


SCENARIOS: dict[str, Scenario] = {
    s.name: s
    for s in (
        Scenario(
            name="ideal",
            summary="no lag, noise, latency or rate limit, 500 Hz: checks the theory",
            world=msgspec.structs.replace(
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
            ),
            told=Vehicle(
                thrust_lag_s=0.0, rate_lag_s=0.0, rate_limits_deg_s=NO_LIMIT, frame_period_s=0.002
            ),
            told_latency_s=0.0,
            told_more=(
                "controller.effectiveness_deviation=0",
            ),  # V's floor is of a law that knows its thrust
        ),
        Scenario(
            name="paper",
            summary="the paper's vehicle and figure eight in a constant wind",
            world=MQX,
        ),
        Scenario(
            name="fast",
            summary="paper at 1.5 m/s",
            world=msgspec.structs.replace(MQX, speed_m_s=1.5),
        ),
        Scenario(
            name="adverse",
            summary="wrong thrust and lags, wind, gusts, turbulence, drag, lost poses and frames, "
            "sagging battery",
            world=_ADVERSE,
            told_more=_WEAK,
        ),
        Scenario(
            name="storm",
            summary="adverse with wind and gusts doubled and 40 ms of latency",
            world=msgspec.structs.replace(
                _ADVERSE,
                wind_mean=(2.0, -1.6, 1.0),
                wind_gust=(1.0, 1.0, 0.4),
                pose_latency_s=0.040,
            ),
            told_latency_s=0.040,
            told_more=_WEAK,
        ),
        Scenario(
            name="gust_front",
            summary="paper, and at 30 s the wind steps by 1.5 m/s²",
            world=msgspec.structs.replace(MQX, wind_step=(1.5, 0.0, 0.0)),
        ),
        _with_step(3.0),
        _with_step(5.0, vertical=True),
        _with_step(8.0),
        _with_push(6.0),
        _with_push(10.0),
        Scenario(
            name="quad1kg",
            summary="a 1 kg vehicle with fast actuators, 100 Hz, 10 ms, drag 1 N per m/s",
            world=_QUAD1KG,
            told=_TOLD_QUAD1KG,
            told_latency_s=0.010,
        ),
        Scenario(
            name="rotors_quad1kg",
            summary="quad1kg that turns by four rotors of 40 ms and a 1 kHz rate loop with gyro "
            "noise",
            world=_ROTORS_QUAD1KG,
            told=msgspec.structs.replace(
                _TOLD_QUAD1KG,
                thrust_lag_s=0.0397,
                thrust_delay_s=0.0002,
                rate_lag_s=0.0160,
                rate_delay_s=0.0301,
            ),
            told_latency_s=0.010,
        ),
        Scenario(
            name="rotors_mqx",
            summary="paper on four rotors of 40 ms and a 1 kHz rate loop with gyro noise",
            world=_ROTORS_MQX,
            told=Vehicle(
                thrust_lag_s=0.0398, thrust_delay_s=0.0, rate_lag_s=0.0284, rate_delay_s=0.0350
            ),
        ),
        Scenario(
            name="rotors_mqx_radio",
            summary="rotors_mqx behind a radio's filters of 56 ms on rates and 66 ms on thrust",
            world=msgspec.structs.replace(
                _ROTORS_MQX,
                rotors=msgspec.structs.replace(
                    _ROTORS_MQX.rotors, rate_filter_s=0.056, thrust_filter_s=0.066
                ),
            ),
            told=Vehicle(
                thrust_lag_s=0.0808, thrust_delay_s=0.0276, rate_lag_s=0.0537, rate_delay_s=0.0599
            ),
        ),
        *(_gale(name, wind) for name, wind in gale.WINDS.items()),
    )
}


class _Overridden(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Wrapper that makes errors about the truth name their keys as ``sim.…``."""

    sim: World


def scenario_of(name: str) -> Scenario:
    """The scenario that a command names.

    Raises:
        ConfigError: there is no such scenario.
    """
    if name not in list(SCENARIOS):
        raise ConfigError("scenario", notice("value.choice", choices=sorted(SCENARIOS), found=name))
    return SCENARIOS[name]


def by_betaflight(scenario: Scenario) -> Scenario:
    """``scenario`` flown by Betaflight: on rotors, told as the firmware was found to answer."""
    world, told = scenario.world, scenario.told
    slower = world.thrust_lag_s / MQX.thrust_lag_s
    rotors = msgspec.structs.replace(
        world.rotors,
        curve=1.0,
        spin_up_s=slower * world.rotors.spin_up_s,
        spin_down_s=slower * world.rotors.spin_down_s,
    )
    return msgspec.structs.replace(
        scenario,
        world=msgspec.structs.replace(world, plant="rotors", rotors=rotors, step_s=0.001),
        told=msgspec.structs.replace(
            told,
            thrust_curve=0.893,
            thrust_lag_s=0.035,
            rate_lag_s=0.0236,
            rate_delay_s=0.0105,
            thrust_delay_s=0.003,
        ),
        betaflight=True,
    )


ENDS = {
    "source": ("vicon", "natnet", "qualisys", "odometry", "vision", "json"),
    "link": ("mavlink", "dsm", "crsf", "rf_bridge"),
    "autopilot": ("px4", "ardupilot", BETAFLIGHT),
}
"""Simulated parts by option: sources of poses, links, and autopilots."""


def choose(
    name: str, autopilot: str, link: str | None, source: str = "vicon"
) -> tuple[Scenario, str]:
    """The scenario called ``name`` as ``autopilot`` flies it, and the link: ``link``, or the usual
    one.

    Raises:
        ConfigError: there is no such scenario, source, link or autopilot, or Betaflight does not
            hear that link.
    """
    scenario = scenario_of(name)
    for end, told in (("source", source), ("link", link or "mavlink"), ("autopilot", autopilot)):
        if told not in ENDS[end]:
            raise ConfigError(
                f"--{end}", notice("value.choice", choices=list(ENDS[end]), found=told)
            )
    if autopilot != BETAFLIGHT:
        return scenario, link or "mavlink"
    if link == "mavlink":
        raise ConfigError("--link", notice("sim.betaflight_link"))
    return by_betaflight(scenario), link or "crsf"


def prepare(
    scenario: Scenario,
    overrides: list[str],
    *,
    controller: str | None = None,
    source: str = "vicon",
    link: str = "mavlink",
) -> tuple[World, Config]:
    """The truth and the configuration of ``scenario`` after ``--set``: ``sim.…`` is truth, all else
    is told.

    Raises:
        ConfigError: an unknown key or a bad value, by its dotted key.
    """
    truth, told = by_side(overrides, controller)
    world = overridden(scenario.world, truth) if truth else scenario.world
    with _option(controller):
        return world, _on_udp(scenario.config(world, told, source, link))


def prepare_own(
    scenario: Scenario, path: Path | None, overrides: list[str], *, controller: str | None = None
) -> tuple[World, Config, float | None]:
    """The truth and the configuration for the file at ``path``, in the air of ``scenario``, from
    its first point on.

    Without a file it is the default configuration, for which ``overrides`` may tell another
    vehicle. The third value is how long the configuration wants to fly [s], if it says: the landing
    is left out, as what is judged is how well the trajectory is followed.

    Raises:
        ConfigError: as :func:`prepare`.
    """
    truth, overrides_told = by_side(overrides, controller)
    with _option(controller):
        told = load(path, Config, overrides_told)
        return *at_desk(
            scenario.world, told, lambda world: overridden(world, truth)
        ), told.flight.duration_s


def by_side(overrides: list[str], controller: str | None) -> tuple[list[str], list[str]]:
    """Overrides of the truth, and of what is told."""
    told = [o for o in overrides if not o.startswith("sim.")]
    if controller is not None:
        told.append(f"controller.kind={controller}")
    return [o for o in overrides if o.startswith("sim.")], told


@contextmanager
def _option(controller: str | None) -> Iterator[None]:
    """Say of a wrong ``controller`` by which option it was given."""
    try:
        yield
    except ConfigError as error:
        if controller is None or error.key != "controller.kind":
            raise
        raise ConfigError("--controller", error.problem) from None


def overridden(world: World, truth: list[str]) -> World:
    """``world``, changed by overrides of the truth.

    Raises:
        ConfigError: as :func:`prepare`.
    """
    return from_dict({"sim": msgspec.to_builtins(world)}, _Overridden, truth).sim


def world_from(text: str) -> World:
    """The truth as a recording has it, as TOML.

    Raises:
        ConfigError, ValueError: it has none that this program knows.
    """
    return from_dict({"sim": parse_toml(text)}, _Overridden, []).sim


def _on_udp(config: Config) -> Config:
    """``config``, where its link is one that the simulated network has."""
    if config.link.address_key in ("tcp", "serial"):
        raise ConfigError(f"link.{config.link.address_key}", notice("sim.udp_only"))
    return config


LEAST_HEIGHT_M = 0.5
"""The vehicle is let go at least so high above the floor [m]."""


def timing(pose: PoseConfig, rate_hz: float, latency_s: float) -> tuple[float, float]:
    """Rate [1/s] and latency [s] that ``pose`` tells.

    The others where its protocol tells them itself.
    """
    return pose.rate_hz or rate_hz, latency_s if pose.latency_s is None else pose.latency_s


def world_of(air: World, told: Config) -> World:
    """``air`` around a true vehicle that is as ``told``."""
    vehicle = told.vehicle
    return msgspec.structs.replace(
        air,
        mass_kg=vehicle.mass_kg,
        thrust_max_n=told.full_thrust_n,
        thrust_curve=told.thrust_curve,
        rate_limits_deg_s=vehicle.rate_limits_deg_s,
        thrust_lag_s=vehicle.thrust_lag_s,
        rate_lag_s=vehicle.rate_lag_s,
        command_delay_s=vehicle.command_delay_s,
        thrust_delay_s=vehicle.thrust_delay_s,
        rate_delay_s=vehicle.rate_delay_s,
        drag_per_s=vehicle.drag_per_s or air.drag_per_s,
        frame_period_s=vehicle.frame_period_s,
    )


def world_as_told(air: World, told: Config, truth: list[str]) -> World:
    """The truth for a rehearsal of ``told``: ``air`` around a vehicle, floor, rates and latency
    exactly as told.

    ``truth`` are overrides (``sim.…``).

    Raises:
        ConfigError: as :func:`prepare`.
    """
    rate_hz, latency_s = timing(told.pose, air.pose_rate_hz, air.pose_latency_s)
    north, east, down = told.trajectory.build().position_at(0.0)
    stands = told.flight.start == "floor"
    own_estimate = told.pose.by_autopilot or told.link.own_position
    world = msgspec.structs.replace(
        world_of(air, told),
        pose_rate_hz=rate_hz,
        pose_latency_s=latency_s,
        start_ned=(north, east, told.flight.floor_z_m if stands else down),
        floor_z_m=told.flight.floor_z_m,
        start_thrust=0.0 if stands else told.flight.idle_thrust,
        ground_effect=stands,
        own_estimate=own_estimate,
    )
    return overridden(world, truth)


def others_of(told: Config) -> list[tuple[str, Vec3]]:
    """The other vehicles that ``told`` keeps away from, standing beside the trajectory: names and
    places [m, NED].
    """
    report = examine_trajectory(told)
    east = report.highest_ned[1] + told.separation.distance_m + 1.0
    floor = told.flight.floor_z_m
    return [
        (name, (report.lowest_ned[0] + number, east, floor))
        for number, name in enumerate(told.separation.others)
    ]


def at_desk(air: World, told: Config, overridden: Callable[[World], World]) -> tuple[World, Config]:
    """The vehicle of ``told`` in ``air`` from its trajectory's first point on, on the simulator's
    wires.
    """
    rate_hz, latency_s = timing(told.pose, air.pose_rate_hz, air.pose_latency_s)
    floor = told.flight.floor_z_m
    north, east, down = told.trajectory.build().position_at(0.0)
    world = overridden(
        msgspec.structs.replace(
            world_of(air, told),
            pose_rate_hz=rate_hz,
            pose_latency_s=latency_s,
            start_ned=(north, east, min(down, floor - LEAST_HEIGHT_M)),
            floor_z_m=floor,
        )
    )
    config = msgspec.structs.replace(
        told,
        pose=ViconConfig(object="quad", latency_s=latency_s, rate_hz=rate_hz, drop_frozen=False),
        gate=GateConfig(drop_frozen=False),
        link=MavlinkLinkConfig(
            period_s=told.vehicle.frame_period_s, thrust_curve=told.link.thrust_curve
        ),
        flight=msgspec.structs.replace(
            told.flight, start="air", idle_thrust=min(world.start_thrust, 0.9), duration_s=None
        ),
    )
    return world, config
