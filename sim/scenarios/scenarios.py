"""Scenarios by name, and the preparation of a flight by one: the truth, a :class:`World`, and the
configuration that the ground station flies with, which may differ from it.

Scenarios are defined exactly, so that figures of different flights compare. ``--set KEY=VALUE``
changes the configuration, ``--set sim.KEY=VALUE`` the truth.

A user's own configuration flies at the desk in a scenario's air and before its sensors. The
simulated vehicle is then exactly the configured one, so the flight shows the trajectory, the gains
and the air; ``sim.…`` overrides make the truth differ. Poses and commands travel by the simulator's
own source and link, whatever the lab uses.
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
"""Limits of body rates that no flight reaches [deg/s]."""
IDLE_THRUST_MAX = 0.9
"""Largest ``flight.idle_thrust`` [-]."""
MQX = World()
"""The paper's vehicle, a Blade mQX, in a constant wind."""
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
"""A vehicle that differs from its configuration by 15 % of thrust and by its lags, in gusts, with a
sagging battery, and with poses and frames that get lost. Chosen."""
_WEAK = ("takeoff.thrust_limit=1.7",)
"""Setting of these vehicles: with this wind and battery they hover only at 1.24 (`adverse`) to 1.34
(`storm`) of the configured weight, and a take-off has 1.3 by default."""
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
# The configured lags and delays of the three scenarios on rotors are those that `identify` found on
# one flight of `trajectory.kind=excitation` each, 42 s, seed 0. In that flight each was configured
# with its best pure lags of thrust and rates: 43 and 42 ms, 41 and 54 ms, 109 and 104 ms.
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
"""Steps of 1 kHz, rounded so that a whole number of them makes a frame."""


class Scenario(msgspec.Struct, frozen=True, kw_only=True):
    """A world, and the configuration of a flight in it."""

    name: str
    summary: str
    """One line for people."""
    world: World
    """The truth."""
    vehicle: Vehicle = Vehicle()
    """The configured vehicle."""
    latency_s: float = 0.020
    """The configured latency of the poses [s]."""
    settings: tuple[str, ...] = ()
    """Other keys of the configuration, as for ``--set``."""

    figure: Callable[[], dict[str, Any]] | None = None
    """Makes the section ``[trajectory]``; None for the paper's figure of eight."""
    variants: tuple[tuple[str, ...], ...] = ()
    """Overrides of the truth. ``compare`` flies the scenario with each; the worst flight counts."""
    betaflight: bool = False
    """Whether Betaflight flies it, behind a radio: see :func:`with_betaflight`."""

    def config(
        self, world: World, overrides: list[str], source: str, link: str = "mavlink"
    ) -> Config:
        """Return the ground station's configuration for ``world``, this scenario's after overrides
        of the truth.

        The reference's speed and the period of the frames are facts of the flight and follow
        ``world``; all else is the scenario's. A radio ``link`` takes full stick for the vehicle's
        limits.
        """
        config = Config(
            vehicle=self.vehicle,
            link=MavlinkLinkConfig(period_s=world.frame_period_s, pace="period"),
            trajectory=LemniscateConfig(speed_m_s=world.speed_m_s),
            flight=FlightConfig(
                start="air", idle_thrust=world.start_thrust, floor_z_m=world.floor_z_m
            ),
        )
        data: dict[str, Any] = msgspec.to_builtins(config)
        # All default, and the defaults depend on the kind that ``overrides`` may choose.
        del data["controller"]
        data["pose"] = self._configure_poses(source, world)
        if self.figure is not None:
            data["trajectory"] = self.figure()
        data["gate"]["drop_frozen"] = _is_noisy(world)
        for key in ("vehicle.preset", "vehicle.file", "trajectory.kind", "pose.kind"):
            if any(override.partition("=")[0].strip() == key for override in overrides):
                # Another kind of vehicle or trajectory takes no key of this one.
                data.pop(key.partition(".")[0], None)
        overrides = [*self.settings, *overrides]
        if link != "mavlink":
            # A radio's modules are imported only where there is one.
            from sim.radio import module, section

            data["link"] = section(link, world, self.vehicle, betaflight=self.betaflight)
            # The duration of a frame on the wire follows from the codec that is configured.
            radio = module(from_dict(data, Config, overrides), world, betaflight=self.betaflight)
            data.setdefault("vehicle", {})["command_delay_s"] = radio.lead_s + radio.frame_s
        return from_dict(data, Config, overrides)

    def _configure_poses(self, source: str, world: World) -> dict[str, Any]:
        """Return the section ``[pose]`` for the kind ``source``."""
        latency = {"latency_s": self.latency_s}
        rate = {"rate_hz": self.world.pose_rate_hz}
        return {
            "vicon": {
                "kind": "vicon",
                "object": "quad",
                "drop_frozen": _is_noisy(world),
                **latency,
                **rate,
            },
            # Its protocol reports the rest of its latency.
            "natnet": {"kind": "natnet", "network_s": 0.0},
            "qualisys": {"kind": "qualisys", **latency},
            "odometry": {"kind": "mavlink", **latency, **rate},
            "vision": {"kind": "vision", **latency},
            "json": {"kind": "json", **latency, **rate},
        }[source]


def _is_noisy(world: World) -> bool:
    """Whether poses of a vehicle at rest differ: without noise they look frozen."""
    return world.pose_noise_m > 0.0 or world.attitude_noise_rad > 0.0


_CONFIGURED_QUAD1KG = Vehicle(
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
"""Number of horizontal directions of wind steps and pushes [-]; the worst of them counts.
Chosen."""
PUSH_S = (0.4, 1.0)
"""Durations of the pushes, half sines [s]. Chosen."""


def _make_wind_steps(acceleration: float) -> list[str]:
    """Return a step of the wind by ``acceleration`` [m/s²] in each horizontal direction, as
    overrides of the truth.
    """
    angles = [2.0 * math.pi * k / DIRECTIONS for k in range(DIRECTIONS)]
    pushes = [(acceleration * math.cos(a), acceleration * math.sin(a)) for a in angles]
    return [f"sim.wind_step=[{x:.9f}, {y:.9f}, 0.0]" for x, y in pushes]


def _with_step(acceleration: float, *, vertical: bool = False) -> Scenario:
    """Return the scenario of a wind step by ``acceleration`` [m/s²], in each horizontal direction
    and, with ``vertical``, up and down.
    """
    steps = _make_wind_steps(acceleration)
    if vertical:
        steps += [f"sim.wind_step=[0.0, 0.0, {z}]" for z in (acceleration, -acceleration)]
    return Scenario(
        name=f"step_{acceleration:g}",
        summary=f"paper, and at 30 s the wind steps by {acceleration:g} m/s²",
        world=msgspec.structs.replace(MQX, wind_step=(acceleration, 0.0, 0.0)),
        variants=tuple((step,) for step in steps),
    )


def _with_push(acceleration: float) -> Scenario:
    """Return the scenario of a push by ``acceleration`` [m/s²] at most, of each duration in each
    horizontal direction.
    """
    world = msgspec.structs.replace(MQX, wind_step=(acceleration, 0.0, 0.0), wind_push_s=PUSH_S[0])
    return Scenario(
        name=f"push_{acceleration:g}",
        summary=f"paper, and at 30 s a push: half a sine of {acceleration:g} m/s² for 0.4 s",
        world=world,
        variants=tuple(
            (step, f"sim.wind_push_s={push_s}")
            for push_s in PUSH_S
            for step in _make_wind_steps(acceleration)
        ),
    )


_CONFIGURED_GALE = Vehicle(
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
    # What `groundstation identify` finds on an excitation flight of it in still air.
    drag_per_s=0.34,
    frame_period_s=1.0 / gale.VEHICLE.pose_hz,
    size_m=0.8,
    wind_share=0.553,  # adapts to 12 m/s²
)
_OBSERVER_NOISES = (
    "controller.acceleration_noise=0.16",
    "controller.wind_noise=0.6",
    "controller.wind_rate_noise=1.6",
)
"""Noises of the observer for this vehicle. Its poses are so good (0.03 mm) that with the default
noises each error of the model becomes wind within two poses, and that wind drives a thrust that
acts 0.1 s later: with lags and delay configured 20 ms wrong the flight rings at 2 to 4 Hz. With
noise of the acceleration the observer takes a part of such an error as chance. More of it costs
accuracy where the configuration is right; with less the flight rings."""


def _gale(name: str, wind: gale.GaleWind) -> Scenario:
    """Return the tunnel's scenario for one setting of its fans. Its x is north, y west and z up."""
    initial_m_s = wind.speed_m_s + wind.gust_m_s * math.sin(gale.GUST_PHASE)
    lean, thrust_share = gale.trim(initial_m_s)
    (x, y, z), (i, j, k), kg = gale.course(0.0)[0], gale.VEHICLE.rest_n, gale.VEHICLE.mass_kg
    air = gale.VEHICLE.drag / kg
    world = World(
        mass_kg=kg,
        thrust_max_n=gale.VEHICLE.full_n,
        thrust_curve=gale.VEHICLE.thrust_curve,
        rate_limits_deg_s=_CONFIGURED_GALE.rate_limits_deg_s,
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
        start_thrust=min(thrust_share, IDLE_THRUST_MAX),
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
        vehicle=_CONFIGURED_GALE,
        latency_s=gale.VEHICLE.pose_latency_s,
        settings=_OBSERVER_NOISES,
        figure=_gale_course,
    )


def _gale_course() -> dict[str, Any]:
    """Return the section ``[trajectory]`` of the tunnel's course: samples each 0.1 s, for 62 s."""
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
            vehicle=Vehicle(
                thrust_lag_s=0.0, rate_lag_s=0.0, rate_limits_deg_s=NO_LIMIT, frame_period_s=0.002
            ),
            latency_s=0.0,
            # The floor of V is that of a law that knows its thrust.
            settings=("controller.effectiveness_deviation=0",),
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
            settings=_WEAK,
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
            latency_s=0.040,
            settings=_WEAK,
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
            vehicle=_CONFIGURED_QUAD1KG,
            latency_s=0.010,
        ),
        Scenario(
            name="rotors_quad1kg",
            summary="quad1kg that turns by four rotors of 40 ms and a 1 kHz rate loop with gyro "
            "noise",
            world=_ROTORS_QUAD1KG,
            vehicle=msgspec.structs.replace(
                _CONFIGURED_QUAD1KG,
                thrust_lag_s=0.0397,
                thrust_delay_s=0.0002,
                rate_lag_s=0.0160,
                rate_delay_s=0.0301,
            ),
            latency_s=0.010,
        ),
        Scenario(
            name="rotors_mqx",
            summary="paper on four rotors of 40 ms and a 1 kHz rate loop with gyro noise",
            world=_ROTORS_MQX,
            vehicle=Vehicle(
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
            vehicle=Vehicle(
                thrust_lag_s=0.0808, thrust_delay_s=0.0276, rate_lag_s=0.0537, rate_delay_s=0.0599
            ),
        ),
        *(_gale(name, wind) for name, wind in gale.WINDS.items()),
    )
}


class _Overridden(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Wrapper that makes errors about the truth name their keys as ``sim.…``."""

    sim: World


def find_scenario(name: str) -> Scenario:
    """Return the scenario that a command names.

    Raises:
        ConfigError: there is no such scenario.
    """
    if name not in list(SCENARIOS):
        raise ConfigError("scenario", notice("value.choice", choices=sorted(SCENARIOS), found=name))
    return SCENARIOS[name]


def with_betaflight(scenario: Scenario) -> Scenario:
    """Return ``scenario`` as Betaflight flies it: on rotors, and with the lags, delays and thrust
    curve configured that the firmware was found to have.
    """
    world, vehicle = scenario.world, scenario.vehicle
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
        vehicle=msgspec.structs.replace(
            vehicle,
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


def choose_scenario(
    name: str, autopilot: str, link: str | None, source: str = "vicon"
) -> tuple[Scenario, str]:
    """Return the scenario called ``name`` as ``autopilot`` flies it, and the link: ``link``, or the
    usual one of this autopilot.

    Raises:
        ConfigError: there is no such scenario, source, link or autopilot, or Betaflight has no such
            link.
    """
    scenario = find_scenario(name)
    for end, kind in (("source", source), ("link", link or "mavlink"), ("autopilot", autopilot)):
        if kind not in ENDS[end]:
            raise ConfigError(
                f"--{end}", notice("value.choice", choices=list(ENDS[end]), found=kind)
            )
    if autopilot != BETAFLIGHT:
        return scenario, link or "mavlink"
    if link == "mavlink":
        raise ConfigError("--link", notice("sim.betaflight_link"))
    return with_betaflight(scenario), link or "crsf"


def prepare(
    scenario: Scenario,
    overrides: list[str],
    *,
    controller: str | None = None,
    source: str = "vicon",
    link: str = "mavlink",
) -> tuple[World, Config]:
    """Return the truth and the configuration of ``scenario`` after ``overrides``, as for ``--set``:
    ``sim.…`` changes the truth, any other key the configuration.

    Raises:
        ConfigError: an unknown key or a bad value, by its dotted key.
    """
    truth, configured = split_overrides(overrides, controller)
    world = override_world(scenario.world, truth) if truth else scenario.world
    with _naming_option(controller):
        return world, _ensure_udp(scenario.config(world, configured, source, link))


def prepare_own(
    scenario: Scenario, path: Path | None, overrides: list[str], *, controller: str | None = None
) -> tuple[World, Config, float | None]:
    """Return the truth, the configuration of the file at ``path`` in the air of ``scenario``, and
    the configured duration [s], if there is one.

    The flight begins at the first point of its trajectory. Without a file the default configuration
    is changed by ``overrides``. The duration is apart, as there is no landing after it: such a
    flight shows how well the trajectory is followed.

    Raises:
        ConfigError: as :func:`prepare`.
    """
    truth, configured = split_overrides(overrides, controller)
    with _naming_option(controller):
        config = load(path, Config, configured)
        world, at_desk = prepare_at_desk(
            scenario.world, config, lambda world: override_world(world, truth)
        )
        return world, at_desk, config.flight.duration_s


def split_overrides(overrides: list[str], controller: str | None) -> tuple[list[str], list[str]]:
    """Split ``overrides`` into those of the truth and those of the configuration, with the kind of
    ``controller`` if one is given.
    """
    configured = [o for o in overrides if not o.startswith("sim.")]
    if controller is not None:
        configured.append(f"controller.kind={controller}")
    return [o for o in overrides if o.startswith("sim.")], configured


@contextmanager
def _naming_option(controller: str | None) -> Iterator[None]:
    """Have the error of a wrong ``controller`` name the option that gave it, not a key."""
    try:
        yield
    except ConfigError as error:
        if controller is None or error.key != "controller.kind":
            raise
        raise ConfigError("--controller", error.problem) from None


def override_world(world: World, truth: list[str]) -> World:
    """Return ``world`` changed by overrides of the truth (``sim.…``).

    Raises:
        ConfigError: as :func:`prepare`.
    """
    return from_dict({"sim": msgspec.to_builtins(world)}, _Overridden, truth).sim


def parse_world(text: str) -> World:
    """Return the truth from its TOML in a recording.

    Raises:
        ConfigError, ValueError: it is not valid for this version.
    """
    return from_dict({"sim": parse_toml(text)}, _Overridden, []).sim


def _ensure_udp(config: Config) -> Config:
    """Return ``config``; refuse a link that the simulated network does not have."""
    if config.link.address_key in ("tcp", "serial"):
        raise ConfigError(f"link.{config.link.address_key}", notice("sim.udp_only"))
    return config


def find_timing(pose: PoseConfig, rate_hz: float, latency_s: float) -> tuple[float, float]:
    """Return the configured rate [1/s] and latency [s] of the poses.

    ``rate_hz`` and ``latency_s`` are taken where none is configured, as the protocol reports it.
    """
    return pose.rate_hz or rate_hz, latency_s if pose.latency_s is None else pose.latency_s


def _make_world(air: World, config: Config) -> World:
    """Return ``air`` around a vehicle that is exactly the configured one."""
    vehicle = config.vehicle
    return msgspec.structs.replace(
        air,
        mass_kg=vehicle.mass_kg,
        thrust_max_n=config.full_thrust_n,
        thrust_curve=config.thrust_curve,
        rate_limits_deg_s=vehicle.rate_limits_deg_s,
        thrust_lag_s=vehicle.thrust_lag_s,
        rate_lag_s=vehicle.rate_lag_s,
        command_delay_s=vehicle.command_delay_s,
        thrust_delay_s=vehicle.thrust_delay_s,
        rate_delay_s=vehicle.rate_delay_s,
        drag_per_s=vehicle.drag_per_s or air.drag_per_s,
        frame_period_s=vehicle.frame_period_s,
    )


def make_configured_world(air: World, config: Config, truth: list[str]) -> World:
    """Return the truth for a rehearsal of ``config``: ``air`` around a vehicle, floor, rates and
    latency exactly as configured, changed by overrides of the ``truth`` (``sim.…``).

    Raises:
        ConfigError: as :func:`prepare`.
    """
    rate_hz, latency_s = find_timing(config.pose, air.pose_rate_hz, air.pose_latency_s)
    north, east, down = config.trajectory.build().position_at(0.0)
    from_floor = config.flight.start == "floor"
    world = msgspec.structs.replace(
        _make_world(air, config),
        pose_rate_hz=rate_hz,
        pose_latency_s=latency_s,
        start_ned=(north, east, config.flight.floor_z_m if from_floor else down),
        floor_z_m=config.flight.floor_z_m,
        start_thrust=0.0 if from_floor else config.flight.idle_thrust,
        ground_effect=from_floor,
        own_estimate=config.pose.by_autopilot or config.link.own_position,
    )
    return override_world(world, truth)


def place_others(config: Config) -> list[tuple[str, Vec3]]:
    """Place the other vehicles of ``config`` on the floor beside the trajectory, 1 m farther east
    than they must be; return names and positions [m, NED].
    """
    report = examine_trajectory(config)
    east = report.highest_ned[1] + config.separation.distance_m + 1.0
    floor = config.flight.floor_z_m
    return [
        (name, (report.lowest_ned[0] + number, east, floor))
        for number, name in enumerate(config.separation.others)
    ]


LEAST_HEIGHT_M = 0.5
"""Least height above the floor at which the vehicle is released at the desk [m]. Chosen."""


def prepare_at_desk(
    air: World, config: Config, override: Callable[[World], World]
) -> tuple[World, Config]:
    """Return the truth and the configuration of a flight of ``config`` at the desk: its vehicle in
    ``air``, from its trajectory's first point on, with the simulator's source and link.

    ``override`` changes the truth.
    """
    rate_hz, latency_s = find_timing(config.pose, air.pose_rate_hz, air.pose_latency_s)
    floor = config.flight.floor_z_m
    north, east, down = config.trajectory.build().position_at(0.0)
    world = override(
        msgspec.structs.replace(
            _make_world(air, config),
            pose_rate_hz=rate_hz,
            pose_latency_s=latency_s,
            start_ned=(north, east, min(down, floor - LEAST_HEIGHT_M)),
            floor_z_m=floor,
        )
    )
    at_desk = msgspec.structs.replace(
        config,
        pose=ViconConfig(object="quad", latency_s=latency_s, rate_hz=rate_hz, drop_frozen=False),
        gate=GateConfig(drop_frozen=False),
        link=MavlinkLinkConfig(
            period_s=config.vehicle.frame_period_s, thrust_curve=config.link.thrust_curve
        ),
        flight=msgspec.structs.replace(
            config.flight,
            start="air",
            idle_thrust=min(world.start_thrust, IDLE_THRUST_MAX),
            duration_s=None,
        ),
    )
    return world, at_desk
