"""Ranges of keys: other units and nonsense are refused, and no honest vehicle is."""

import math
import re
from pathlib import Path
from typing import Any

import msgspec
import pytest

from groundstation.config import ConfigError, from_dict
from groundstation.core.control import ControllerConfig
from groundstation.settings import Config
from sim.scenarios import SCENARIOS, prepare

TAGS = [str(kind.__struct_config__.tag) for kind in ControllerConfig.__args__]
KINDS = [tag for tag in TAGS if tag != "custom"]
"""The controllers that come along."""


def numbers(kind: str) -> dict[str, float]:
    """The default of each number that a controller of this kind has, except zeros."""
    keys = msgspec.to_builtins(from_dict({"controller": {"kind": kind}}, Config).controller)
    return {key: value for key, value in keys.items() if isinstance(value, float) and value}


@pytest.mark.parametrize("kind", KINDS)
def test_gains_and_noises_that_are_a_thousand_times_too_large_are_refused(kind: str) -> None:
    for key, value in numbers(kind).items():
        with pytest.raises(ConfigError, match=f"^controller.{key}: expected a number "):
            from_dict({"controller": {"kind": kind, key: 1e3 * value}}, Config)


@pytest.mark.parametrize(
    "override",
    [
        # radians and radians per second
        f"controller.tilt_limit_deg={math.radians(45.0)}",
        f"guards.tilt_deg={math.radians(80.0)}",
        f"guards.oscillation_deg={math.radians(40.0)}",
        f"limits.max_tilt_deg={math.radians(45.0)}",
        f"gate.tilt_deg={math.radians(120.0)}",
        f"gate.rate_deg_s={math.radians(1000.0)}",
        "link.forward.noise_deg=0.0087",
        "vehicle.rate_limits_deg_s=[3.5,3.5,5.2]",
        # millimetres
        "controller.pose_noise_m=0.3",
        "vehicle.size_m=300",
        "link.forward.noise_m=5",
        "gate.jump_m=150",
        "gate.speed_m_s=20000",
        "gate.acceleration_m_s2=30000",
        "guards.error_m=1000",
        "separation.distance_m=600",
        "takeoff.height_m=1000",
        "flight.floor_z_m=150",
        "flight.floor_z_m=1500",
        "pose.alignment.lab_origin_m=[0,900,0]",
        "pose.alignment.centre_of_mass_m=[0,0,15]",
        "fence.height_m=900",
        "fence.north_m=[-900,900]",
        "trajectory.scale_m=800",
        "trajectory.altitude_m=900",
        # milliseconds
        "vehicle.thrust_lag_s=50",
        "vehicle.rate_lag_s=106",
        "vehicle.thrust_delay_s=13",
        "vehicle.rate_delay_s=13",
        "vehicle.command_delay_s=5",
        "vehicle.frame_period_s=22.5",
        "controller.pose_jitter_s=2",
        *("flight.pose_wait_s=5000", "flight.duration_s=120000"),
        "flight.coast_s=250",
        "gate.frozen_s=100",
        # seconds where a rate is meant, and the other way round
        "vehicle.frame_period_s=44.4",
        "link.forward.rate_hz=0.025",
        # g
        "controller.gravity=0.00981",
        "controller.gravity=1e-3",
        "controller.gravity=981",
        "takeoff.transit_m_s2=0.001",
        # kilometres per second, as from a slip of the decimal point
        "flight.descent_m_s=0.0004",
        "takeoff.climb_m_s=0.0005",
        # grams, millinewtons and percent
        "vehicle.mass_kg=800",
        "vehicle.mass_kg=8e-5",
        *(f"vehicle.{key}" for key in ("thrust_max_n=13700", "thrust_min_n=13700", "hover_n=7848")),
        *("vehicle.hover_range=[70,145]", "vehicle.drag_per_s=998"),
        # beyond anything
        *("controller.wind_noise=1e9", "gate.rate_deg_s=1e6"),
        # nearer to zero than anything
        *("controller.attitude_gain=1e-300", "gate.jump_m=1e-300", "fence.height_m=1e-300"),
    ],
)
def test_a_number_in_another_unit_is_refused_with_what_is_accepted(override: str) -> None:
    key, _, _ = override.partition("=")
    fence = {"kind": "box", "north_m": [-2, 2], "east_m": [-2, 2], "height_m": 2.5}
    base = {"controller": {"kind": "pid"}, "link": {"forward": {}}, "fence": fence}
    with pytest.raises(ConfigError, match=rf"^--set: {key}(\[\d\])?: expected a number "):
        from_dict(base, Config, [override])


def test_every_number_that_must_not_be_zero_has_a_least_value() -> None:
    page = Path(__file__).parents[4] / "docs" / "reference" / "configuration.md"
    assert not re.findall(r"^\| `(.*?)` \| [^|]*a number > 0\b", page.read_text("utf-8"), re.M)


HEAVY = "times the weight, .* by mass_kg = "


@pytest.mark.parametrize(
    ("override", "says"),
    [
        ("mass_kg=8", HEAVY),
        ("mass_kg=80", HEAVY),
        ("thrust_max_n=137", HEAVY),
        ("thrust_max_n=1370", HEAVY),
        ("hover_thrust=0.0045", HEAVY),
        ("thrust_min_n=20", "expected less than the weight"),
        ("hover_n=80", "expected 0.5494 to 1.138 N"),
        ("hover_n=0.08", "expected 0.5494 to 1.138 N"),
        ("hover_range=[1.45,0.7]", "expected a share below 1 and one above 1"),
        ("hover_range=[0.7,0.9]", "expected a share below 1 and one above 1"),
    ],
)
def test_a_figure_in_another_unit_is_refused_by_the_weight_that_it_does_not_fit(
    override: str, says: str
) -> None:
    with pytest.raises(ConfigError, match=rf"vehicle\..*: .*{says}"):
        from_dict({}, Config, [f"vehicle.{override}"])


Refused = list[tuple[dict[str, Any], str]]
BOX: dict[str, Any] = {"kind": "box", "north_m": [-2, 2], "east_m": [-2, 2], "height_m": 2}
NO_FENCE: Refused = [
    ({**BOX, "north_m": [2, -2]}, "fence.*smaller number first"),
    ({key: value for key, value in BOX.items() if key != "height_m"}, r"fence\.height_m"),
    ({"kind": "round"}, "fence.*box"),
    ({**BOX, "north_m": [-2, math.inf]}, r"fence\.north_m"),
]
NO_POSE: Refused = [
    ({"server": "motive.lab:1510"}, "server: expected a numeric IPv4 address, got 'motive.lab'"),
    ({"server": "239.1.1.1:1510"}, "server: expected no multicast address"),
    ({"interface": "eth0"}, "interface: expected a numeric IPv4 address, got 'eth0'"),
    ({"group": "192.168.1.5"}, "group: expected a multicast address, .* got '192.168.1.5'"),
    ({"server": "127.0.0.1"}, "is not an address"),
    ({"name": ""}, "name: expected a string of 1 to 256 characters"),
    ({"kind": "vicon", "object": ""}, "1 to 24 bytes"),
    ({"kind": "vicon", "latency_s": math.nan}, "latency_s: expected a number >= 0"),
    # mirrored or unknown axes
    *(
        ({"world": world}, rf"pose\.world: expected one of \[.*'nwu'.*\], got '{world}'")
        for world in ("zup", "neu", "nwd", "enz", "", "NED")
    ),
]
NO_CLIENT: Refused = [
    ({"key_file": "k", "may": ["arm"]}, r"clients\.a\.may\[0\]: expected one of"),
    ({"key_file": "k", "may": ["goto"]}, "authority: expected move, as a may goto"),
    ({"key_file": "k", "may": []}, r"clients\.a\.may: expected an array"),
    ({"may": ["land"]}, r"clients\.a\.key_file: missing"),
]
NO_MQTT: Refused = [
    ({"host": "lab.example"}, r"mqtt\.host: 'lab\.example' is .*mqtt\.insecure = true"),
    ({"tls": {"verify": False}}, "enabled: expected true"),
    ({"tls": {"enabled": True, "cert_file": "a"}}, "cert_file and key_file"),
    ({"password_file": "a"}, "username: expected a name"),
    ({"requests": {"enabled": True}}, "clients: expected at least one"),
    ({"requests": {"clients": {"a b": {"key_file": "k", "may": ["land"]}}}}, "got 'a b'"),
    *(({"requests": {"clients": {"a": client}}}, words) for client, words in NO_CLIENT),
]
BEE = {"kind": "vicon", "object": "bee"}
CRSF = {"kind": "crsf", "port": "/dev/ttyUSB0"}
REFUSED: Refused = [
    *(({"fence": fence}, words) for fence, words in NO_FENCE),
    *(({"pose": {"kind": "natnet", **pose}}, words) for pose, words in NO_POSE),
    *(({"mqtt": {"enabled": True, **mqtt}}, words) for mqtt, words in NO_MQTT),
    ({"pose": {"kind": "mavlink"}, "separation": {"others": ["bee"]}}, r"separation\.others"),
    ({"pose": BEE, "separation": {"others": ["bee"]}}, r"separation\.others"),
    ({"separation": {"others": ["bee", "bee"]}}, r"separation\.others"),
    ({"separation": {"distance_m": 0.0}}, r"separation\.distance_m"),
    ({"operator": {"hold": "rc:7"}, "link": CRSF}, r"operator\.hold: a channel"),
]


@pytest.mark.parametrize(("data", "words"), REFUSED)
def test_a_setting_that_makes_no_sense_is_refused_by_its_key(
    data: dict[str, Any], words: str
) -> None:
    with pytest.raises(ConfigError, match=words):
        from_dict(data, Config)


def test_a_swing_of_the_heading_in_radians_is_refused_and_none_is_not() -> None:
    def swinging(degrees: float) -> Config:
        return from_dict({"trajectory": {"kind": "excitation", "yaw_swing_deg": degrees}}, Config)

    says = r"yaw_swing_deg: expected 0 or from 1.6 to 90 \[deg\], got 0.17: is it in"
    with pytest.raises(ConfigError, match=says):
        swinging(0.17)
    assert swinging(0.0) != swinging(2.0)


VEHICLES = {
    "mass_kg": (0.02, 25.0),
    "thrust_max_n": (0.35, 600.0),
    "thrust_min_n": (0.002, 10.0),
    "size_m": (0.06, 2.0),
    "thrust_lag_s": (0.02, 0.3),
}


@pytest.mark.parametrize("number", [0, 1], ids=["20 g", "25 kg"])
@pytest.mark.parametrize("kind", KINDS)
def test_the_lightest_and_the_heaviest_vehicle_are_accepted(number: int, kind: str) -> None:
    told = {key: figures[number] for key, figures in VEHICLES.items()}
    config = from_dict({"vehicle": told, "controller": {"kind": kind}}, Config)
    assert config.vehicle.mass_kg == told["mass_kg"]


# ---- keys of the simulator

GRAMS = "mass_kg=800"
MILLISECONDS = (
    "thrust_lag_s=50 rate_delay_s=13 pose_latency_s=20 frame_period_s=22.5 rotors.spin_up_s=40"
)
MILLIMETRES = "pose_noise_m=0.3 start_ned=[800,-800,0] floor_z_m=1500"
DEGREES_AND_RADIANS = "attitude_noise_rad=0.5 rate_limits_deg_s=[3.5,3.5,5.2]"
PERCENT = "thrust_gain=95 pose_loss=5 tunnel.pitch_per_climb=140"
WRONG = " ".join((GRAMS, MILLISECONDS, MILLIMETRES, DEGREES_AND_RADIANS, PERCENT)).split()


@pytest.mark.parametrize("told", WRONG)
def test_a_figure_of_the_world_in_another_unit_is_refused_with_what_is_accepted(told: str) -> None:
    key, _, _ = told.partition("=")
    with pytest.raises(ConfigError, match=rf"sim\.{key}(\[\d\])?: expected a number "):
        prepare(SCENARIOS["paper"], [f"sim.{told}"])


@pytest.mark.parametrize("name", SCENARIOS)
def test_what_a_scenario_flies_is_within_the_ranges(name: str) -> None:
    prepare(SCENARIOS[name], ["sim.pose_loss=0"])
