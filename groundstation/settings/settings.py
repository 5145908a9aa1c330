"""Settings: the whole configuration of a ground station, one TOML file.

Most sections are defined in their rooms.

In a rehearsal every address is turned to one host of this machine's loopback network, the file's
own, where `groundstation-sim serve --config` plays tracker and autopilot of that file.
``ADDRESSES`` lists the keys that may hold an address, with their replacement, ``TEXTS`` every other
text; a test compares both with the schema.
"""

import asyncio
import hashlib
import re
import socket
from collections.abc import Callable, Mapping
from enum import IntEnum
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeAlias

import msgspec

from groundstation.config import NAME, NAME_FORM, NAME_LETTERS, ConfigError, is_name, texts_of
from groundstation.core.control import ControllerConfig, Gains, Law
from groundstation.core.geometry import Coordinate
from groundstation.core.messages import RemoteAsk, notice
from groundstation.core.safety import (
    FenceConfig,
    GuardsConfig,
    LandingConfig,
    SeparationConfig,
    TakeoffConfig,
)
from groundstation.core.trajectory import LemniscateConfig, TrajectoryConfig
from groundstation.core.vehicle import LimitsConfig, Vehicle
from groundstation.machine import RecordingConfig, StatusConfig, folder_of, socket_folder
from groundstation.pose import PoseConfig
from groundstation.pose.sources import GateConfig, JsonConfig, LibmotioncaptureConfig, ViconConfig
from links.bridge import BridgeLinkConfig
from links.core import full_thrust_n
from links.io import is_loopback, is_pseudo_terminal, parse_address
from links.mavlink.protocol import ForwardConfig, MavlinkLinkConfig
from links.rf import RfConfig

REHEARSAL = "rehearsal"
"""Name of a rehearsed vehicle, which no other may have: arming by name then confirms that nothing
real moves."""
FIRST_PORT = 25000
"""Start of the range that every port is moved into: no tracker, autopilot or broker uses it."""
PORTS = 5000
"""Number of ports in that range; a port keeps its last digits."""
FOLDER = "rehearsals"
"""Folder of the recordings of rehearsals: they do not count among those of real flights."""


class RehearsalConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Place of a rehearsal; ``--rehearse`` writes it. Config section ``[rehearsal]``."""

    host: Annotated[
        str,
        msgspec.Meta(
            pattern=r"\A127\.(6[4-9]|[7-9]\d|1[01]\d|12[0-7])(\.\d{1,3}){2}\Z",
            description="Host on the loopback network that every address is turned to.",
        ),
    ]
    ports: Annotated[
        str, msgspec.Meta(description="Folder of the pseudo-terminals that replace serial ports.")
    ]
    vehicle: Annotated[str, msgspec.Meta(description="The name of the vehicle that is rehearsed.")]
    name: Annotated[
        str,
        msgspec.Meta(
            pattern=rf"\A{REHEARSAL}(-[A-Za-z0-9_.-]+)?\Z",
            max_length=NAME_LETTERS,
            description="What the vehicle is called meanwhile: `rehearsal`; in a fleet "
            "`rehearsal-` and its own name.",
        ),
    ] = REHEARSAL

    @property
    def serial(self) -> str:
        """The pseudo-terminal."""
        return str(Path(self.ports) / f"{self.name}.tty")


def is_rehearsal(vehicle: str) -> bool:
    """Whether a vehicle of this name flies in a rehearsal: no other may have the name."""
    return vehicle == REHEARSAL or vehicle.startswith(f"{REHEARSAL}-")


def _address(value: Any, room: RehearsalConfig) -> Any:
    return None if value is None else f"{room.host}:{_port(parse_address(value)[1], room)}"


def _port(value: Any, _room: RehearsalConfig) -> Any:
    return None if value is None else FIRST_PORT + value % PORTS


def _host(_value: Any, room: RehearsalConfig) -> Any:
    return room.host


def _serial(value: Any, room: RehearsalConfig) -> Any:
    return None if value is None else room.serial


def _be(fixed: Any) -> "Turn":
    return lambda _value, _room: fixed


def _name(_value: Any, room: RehearsalConfig) -> Any:
    return room.name


def _apart(value: Any, _room: RehearsalConfig) -> Any:
    folder = folder_of(RecordingConfig(folder=value))
    return str(folder if folder.name == FOLDER else folder / FOLDER)


Turn = Callable[[Any, RehearsalConfig], Any]
"""Takes a key's value and the place of the rehearsal; returns the new value. Applying it twice
changes nothing more."""

ADDRESSES: Mapping[str, Turn] = {
    "link.listen": _address,
    "link.remote": _address,
    "link.local_port": _be(None),  # of a remote alone
    "link.tcp": _address,
    "link.serial": _serial,
    "link.port": _serial,
    "link.simulated": _be(True),
    "pose.listen": _address,
    "pose.server": _address,
    "pose.interface": _host,
    "pose.hostname": _host,
    "pose.options": _be({}),
    "pose.multicast": _be(
        False
    ),  # a group is received from every network on which any program has joined it
    "mqtt.host": _host,
    "mqtt.port": _port,
    "mqtt.insecure": _be(False),
    "mqtt.username": _be(""),  # the broker there knows no passwords and has no certificate
    "mqtt.password_file": _be(""),
    "status.path": _be(""),
    "recording.folder": _apart,
    "vehicle.name": _name,
}
"""Keys that may hold an address, and those that depend on them."""

TEXTS = frozenset({
    "controller.factory", "controller.options", "link.key_file", "link.map.fixed",
    "link.signing_key_file",
    "mqtt.prefix", "mqtt.requests.clients", "mqtt.tls.ca_file", "mqtt.tls.cert_file",
    "mqtt.tls.key_file",
    "operator.device", "operator.hold", "pose.group", "pose.name", "pose.object",
    "separation.others",
    "rehearsal.host", "rehearsal.name", "rehearsal.ports", "rehearsal.vehicle",
    "trajectory.factory", "trajectory.file",
    "trajectory.options", "vehicle.file", "vehicle.preset",
})  # fmt: skip
"""Keys of free text that hold no address: names, files of this machine, the operator's own control;
the group of a multicast that is off."""


def _as_datagrams(pose: LibmotioncaptureConfig) -> JsonConfig:
    """Return the JSON source that replaces ``pose``: the library has its own protocols."""
    kept = {key: getattr(pose, key) for key in ("name", "world", "body", "alignment", "latency_s")}
    return JsonConfig(**kept)


def turn_sections(config: "Config", room: RehearsalConfig) -> dict[str, msgspec.Struct]:
    """Return the sections of ``config`` that may hold addresses, turned to ``room``."""
    turned = dict[str, tuple[Any, dict[str, Any]]]()
    for section in dict.fromkeys(key.partition(".")[0] for key in ADDRESSES):
        old: Any = getattr(config, section)
        if isinstance(old, LibmotioncaptureConfig):
            old = _as_datagrams(old)
        changes = {
            name: turn(getattr(old, name), room)
            for key, turn in ADDRESSES.items()
            for name in [key.partition(".")[2]]
            if key.startswith(f"{section}.") and name in old.__struct_fields__
        }
        turned[section] = old, changes
    link, changes = turned["link"]
    if "serial" in changes and not any(
        changes[way] for way in ("listen", "remote", "tcp", "serial")
    ):
        changes["listen"] = _address(link.endpoint, room)
    mqtt, changes = turned["mqtt"]
    changes |= {"tls": type(mqtt.tls)(), "port": _port(mqtt.tcp_port, room)}
    return {
        section: msgspec.structs.replace(old, **changes)
        for section, (old, changes) in turned.items()
    }


def find_way_out(config: "Config") -> str:
    """Describe what leaves the rehearsal or brings another flight into it; empty: nothing."""
    room = config.rehearsal
    if room is None:
        says = (
            f"vehicle.name: {config.vehicle.name!r} is kept for rehearsals (--rehearse): call it "
            "otherwise"
        )
        return says if is_rehearsal(config.vehicle.name) else ""
    for section, turned in turn_sections(config, room).items():
        old = getattr(config, section)
        for name in turned.__struct_fields__ if old != turned else ():
            value, wanted = getattr(old, name, None), getattr(turned, name)
            if value != wanted:
                return (
                    f"{section}.{name}: leads out of the rehearsal at {room.host}: expected "
                    f"{wanted!r}, got {value!r}"
                )
    return ""


def rehearse(config: "Config", file: Path, *, fleet: bool = False) -> "Config":
    """Return ``config`` with every address turned to the host of ``file`` on the loopback network.

    Args:
        config: the configuration of the real flight.
        file: its file, of a ``fleet`` the fleet file: both sides of a rehearsal name the same.
        fleet: whether the vehicle is one of several, and keeps its name behind the word.

    Raises:
        ConfigError: a key may hold an address without a replacement; or two addresses become one.
    """
    unknown = [key for key in texts_of(type(config)) if key not in ADDRESSES and key not in TEXTS]
    if unknown:
        raise ConfigError(unknown[0], notice("rehearse.unknown_key"))
    a, b, c = hashlib.sha256(str(file.resolve()).encode()).digest()[:3]
    name = config.vehicle.name
    room = RehearsalConfig(
        host=f"127.{64 + a % 64}.{b}.{1 + c % 254}",
        ports=str(socket_folder()),
        vehicle=name,
        name=f"{REHEARSAL}-{name}"[:NAME_LETTERS] if fleet else REHEARSAL,
    )
    turned = turn_sections(config, room)
    link, pose = (getattr(turned[section], "listen", None) for section in ("link", "pose"))
    if pose is not None and link == pose:
        raise ConfigError("pose.listen", notice("rehearse.same_address", address=pose))
    return msgspec.structs.replace(config, rehearsal=room, **turned)


def describe_rehearsal(room: RehearsalConfig) -> str:
    """Describe the rehearsal in one line for the operator."""
    return (
        f"REHEARSAL of {room.vehicle}: nothing real is reached or moves; every address is turned "
        f"to {room.host}"
    )


def beacon(room: RehearsalConfig) -> str:
    """Return the abstract socket name that the simulated side of ``room`` holds.

    It ends with its process (unix(7)).
    """
    return f"\0groundstation rehearsal at {room.host}"


def ensure_served(room: RehearsalConfig, file: Path) -> None:
    """Require the simulated side before anything is opened: the first message must not go to an
    unknown program.

    Raises:
        ConfigError: it does not run, or a pseudo-terminal of it is something else.
    """

    async def look() -> None:
        loop = asyncio.get_running_loop()
        wire, _ = await loop.create_datagram_endpoint(
            asyncio.DatagramProtocol, remote_addr=beacon(room), family=socket.AF_UNIX
        )
        wire.close()

    try:
        asyncio.run(look())
    except OSError:
        raise ConfigError("--rehearse", notice("rehearse.unserved", file=file)) from None
    if Path(room.serial).exists() and not is_pseudo_terminal(room.serial):
        raise ConfigError("--rehearse", notice("rehearse.no_terminal", path=room.serial, file=file))


class MqttPort(IntEnum):
    """Ports of a broker (IANA)."""

    PLAIN = 1883
    TLS = 8883


class TlsConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Encryption, and who the broker proves to be."""

    enabled: Annotated[bool, msgspec.Meta(description="Speak TLS.")] = False
    ca_file: Annotated[
        str,
        msgspec.Meta(
            description="PEM file of the authority that has signed the broker's certificate; empty "
            "for those that the system trusts."
        ),
    ] = ""
    cert_file: Annotated[
        str,
        msgspec.Meta(
            description="PEM file of our own certificate, where the broker asks for one; empty for "
            "none."
        ),
    ] = ""
    key_file: Annotated[
        str, msgspec.Meta(description="PEM file of its private key, mode 0600.")
    ] = ""
    verify: Annotated[
        bool,
        msgspec.Meta(
            description="Check the broker's certificate and name. Without it anybody may pose as "
            "the broker: a warning at each start."
        ),
    ] = True

    def __post_init__(self) -> None:
        if bool(self.cert_file) != bool(self.key_file):
            raise ValueError(notice("keys.certificate"))
        if not self.enabled and (self.ca_file or self.cert_file or not self.verify):
            raise ValueError(notice("keys.tls"))


class ClientConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One client that may ask by MQTT."""

    key_file: Annotated[
        str,
        msgspec.Meta(
            description="File with the key that it shares with us, mode 0600; `groundstation "
            "config key FILE` writes one."
        ),
    ]
    may: Annotated[
        tuple[RemoteAsk, ...], msgspec.Meta(min_length=1, description="What it may ask.")
    ]


class RequestsConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Requests by MQTT."""

    enabled: Annotated[bool, msgspec.Meta(description="Take any at all.")] = False
    authority: Annotated[
        Literal["ask", "move"],
        msgspec.Meta(
            description="`move`: a client may ask to go to points of its own choice, if its `may` "
            "lists `goto`."
        ),
    ] = "ask"
    clients: Annotated[
        dict[str, ClientConfig], msgspec.Meta(description="Who may ask, by name.")
    ] = {}

    def __post_init__(self) -> None:
        if self.enabled and not self.clients:
            raise ValueError(notice("keys.no_clients"))
        for name, client in self.clients.items():
            if "goto" in client.may and self.authority != "move":
                raise ValueError(notice("keys.authority", client=name, found=self.authority))
            if not is_name(name):
                raise ValueError(notice("keys.client", form=NAME_FORM, found=name))


class MqttConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The broker to publish to."""

    enabled: Annotated[bool, msgspec.Meta(description="Publish at all.")] = False
    host: Annotated[
        str,
        msgspec.Meta(
            min_length=1, description="Name or address of the broker, as in its certificate."
        ),
    ] = "127.0.0.1"
    port: Annotated[
        Annotated[int, msgspec.Meta(ge=1, le=65535)] | None,
        msgspec.Meta(description="TCP port of the broker; without it 8883 with TLS, 1883 without."),
    ] = None
    tls: TlsConfig = TlsConfig()
    insecure: Annotated[
        bool,
        msgspec.Meta(
            description="Speak to another machine without TLS: whoever is on the network reads "
            "everything, passwords too."
        ),
    ] = False
    username: Annotated[str, msgspec.Meta(description="Name to log in with; empty for none.")] = ""
    password_file: Annotated[
        str,
        msgspec.Meta(
            description="File whose first line is the password, mode 0600; empty for none."
        ),
    ] = ""
    prefix: Annotated[
        str,
        msgspec.Meta(
            pattern=rf"\A{NAME}(/{NAME})*\Z",
            max_length=64,
            description="First part of every topic.",
        ),
    ] = "groundstation"
    rate_hz: Annotated[
        float, msgspec.Meta(ge=0.01, le=50.0, description="Most snapshots a second [1/s].")
    ] = 5.0
    health_period_s: Annotated[
        float,
        msgspec.Meta(
            ge=0.1, le=3600.0, description="Time between two words about the connection itself [s]."
        ),
    ] = 5.0
    requests: RequestsConfig = RequestsConfig()

    def __post_init__(self) -> None:
        if (
            self.enabled
            and not self.tls.enabled
            and not self.insecure
            and not is_loopback(self.host)
        ):
            raise ValueError(notice("keys.unencrypted", host=self.host))
        if self.password_file and not self.username:
            raise ValueError(notice("keys.username"))

    @property
    def tcp_port(self) -> int:
        """The port in force."""
        return self.port or (MqttPort.TLS if self.tls.enabled else MqttPort.PLAIN).value


_INPUT = re.compile(r"(?:KEY|BTN|ABS)_[A-Z0-9_]+")
_CHANNEL = re.compile(r"rc:([1-9]|1[0-8])")


class OperatorConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The operator's dead-man control: if it is released or lost, the vehicle lands. Config section
    ``[operator]``.
    """

    hold: Annotated[
        str,
        msgspec.Meta(
            description="What is held to fly: a key, button or axis as evtest(1) names it "
            "(`BTN_TR`, `KEY_B`, `ABS_RZ`), or `rc:1` to `rc:18`, a channel of the "
            "transmitter as the autopilot receives it (link.kind mavlink). Empty: none."
        ),
    ] = ""
    device: Annotated[
        str,
        msgspec.Meta(
            description="The input device that has it: its path "
            "(/dev/input/by-id/…-event-joystick), or a part of its name. Empty: the "
            "only one that has it."
        ),
    ] = ""
    above: Annotated[
        float,
        msgspec.Meta(
            ge=0.2,
            le=0.95,
            description="An axis or a channel is held from this share of its travel on [-], and "
            "let go 0.1 below it; a centred stick is at 0.5, and a channel goes from 1000 to 2000 "
            "µs.",
        ),
    ] = 0.75
    grab: Annotated[
        bool,
        msgspec.Meta(
            description="Keep what the device sends from everybody else, as for a pedal that types "
            "letters. Never for the keyboard in use: its Ctrl-C would reach nobody."
        ),
    ] = False

    def ensure_named(self) -> None:
        """Check what the types cannot.

        Raises:
            ValueError: ``hold`` names nothing that can be held.
        """
        if self.hold and not _INPUT.fullmatch(self.hold) and not _CHANNEL.fullmatch(self.hold):
            raise ValueError(notice("keys.hold", found=self.hold))

    @property
    def channel(self) -> int | None:
        """The transmitter's channel, from 1 on; None where it is none."""
        found = _CHANNEL.fullmatch(self.hold)
        return None if found is None else int(found[1])


LEAST_B_BOUND_M_S2 = 5.0
"""Least bound of adaptation [m/s²]: thrust 30 % weaker than configured appears as 4.2."""
HOVER_TOLERANCE = 0.02
"""Share by which the full thrust may fall short [-]: autopilots show a rounded hover thrust."""

LARGEST_LIFT = 30.0
"""Largest plausible full thrust [weights]: a racing quadrotor has 15. Mass in grams, or thrust
in grams or millinewtons, gives more than 100."""

LEAST_LIFT = 0.03
"""Least plausible full thrust [weights]: mass in grams gives 0.002. The trajectory's check finds a
thrust that is too weak for it."""

LinkConfig: TypeAlias = MavlinkLinkConfig | RfConfig | BridgeLinkConfig
"""The configuration of one link, picked by its ``kind``; see ``links.make.LINKS``."""


class FlightConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Start of a flight, age of its poses, and its end."""

    start: Annotated[
        Literal["floor", "air"],
        msgspec.Meta(
            description="`floor`: take off, hold, then fly onto the trajectory. `air`: only for a "
            "simulated vehicle that is held in the air until it responds; it follows the "
            "trajectory at once."
        ),
    ] = "floor"
    duration_s: Annotated[
        Annotated[float, msgspec.Meta(ge=0.01, le=86400.0)] | None,
        msgspec.Meta(
            description="Fly back and land after this time on the trajectory [s]; without it, only "
            "on request."
        ),
    ] = None
    coast_s: Annotated[
        float,
        msgspec.Meta(
            ge=0.02,
            le=1.0,
            description="Longest age of the pose of a command [s]. After it comes the descent on "
            "the model (`guards.level_s`), where it took off from the floor, then the "
            "link's bring-down, and then nothing leaves.",
        ),
    ] = 0.25
    pose_wait_s: Annotated[
        float,
        msgspec.Meta(ge=0.1, le=600.0, description="How long to wait for the first pose [s]."),
    ] = 5.0
    idle_thrust: Annotated[
        float,
        msgspec.Meta(
            ge=0.0,
            le=0.9,
            description="Thrust streamed until the vehicle is armed, as a share of its weight [-].",
        ),
    ] = 0.0
    descent_m_s: Annotated[
        float, msgspec.Meta(ge=0.05, le=1.0, description="Fastest speed of the landing [m/s].")
    ] = 0.4
    floor_z_m: Annotated[
        Coordinate,
        msgspec.Meta(
            description="Down coordinate of the vehicle's pose on the floor [m, NED: down is "
            "positive]; landing aims at it."
        ),
    ] = 0.0


class Config(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One vehicle, its controller, its poses, its link, what it flies, and who may watch."""

    FOREIGN_KEYS: ClassVar = dict.fromkeys(("config", "vehicles"), str(notice("fleet.is_one")))
    vehicle: Vehicle = Vehicle()
    controller: ControllerConfig = Gains()
    pose: PoseConfig = ViconConfig()
    gate: GateConfig = GateConfig()
    link: LinkConfig = MavlinkLinkConfig()
    trajectory: TrajectoryConfig = LemniscateConfig()
    limits: LimitsConfig = LimitsConfig()
    takeoff: TakeoffConfig = TakeoffConfig()
    flight: FlightConfig = FlightConfig()
    landing: LandingConfig = LandingConfig()
    guards: GuardsConfig = GuardsConfig()
    fence: Annotated[
        FenceConfig | None,
        msgspec.Meta(
            description="The room to stay in; a real flight needs one, and `limits.max_speed_m_s`."
        ),
    ] = None
    separation: SeparationConfig = SeparationConfig()
    operator: OperatorConfig = OperatorConfig()
    status: StatusConfig = StatusConfig()
    mqtt: MqttConfig = MqttConfig()
    recording: RecordingConfig = RecordingConfig()
    rehearsal: Annotated[
        RehearsalConfig | None,
        msgspec.Meta(
            description="Where everything is simulated instead; `--rehearse` alone writes it, and "
            "no address may lead elsewhere."
        ),
    ] = None

    def __post_init__(self) -> None:
        """Check the sections against each other.

        Raises:
            ValueError: the controller would count on more thrust than the full signal gives.
        """
        law, wind = self.controller, self.vehicle.wind_bound_m_s2(self.controller.gravity)
        if isinstance(law, Law) and law.b_bound == Law().b_bound:
            bound = max(wind, LEAST_B_BOUND_M_S2)
            law = msgspec.structs.replace(law, b_bound=bound)
        if isinstance(law, Gains) and law.k_omega == Gains().k_omega:
            k_omega = max(law.k_omega, self.vehicle.rate_response_per_s)
            law = msgspec.structs.replace(law, k_omega=k_omega)
        msgspec.structs.force_setattr(self, "controller", law)
        blind_s = self.flight.coast_s + self.guards.level_s
        if blind_s > 1.0:
            raise ValueError(notice("keys.blind", blind_s=blind_s))
        if self.pose.by_autopilot and self.forwards is not None:
            raise ValueError(notice("keys.forward"))
        others = self.separation.others
        if others and not self.pose.shows_others:
            raise ValueError(notice("keys.others_unseen", kind=self.pose.kind))
        if self.body in others or len(set(others)) < len(others):
            raise ValueError(notice("keys.others_twice"))
        self.operator.ensure_named()
        if self.operator.channel is not None and not self.link.has_autopilot:
            raise ValueError(notice("keys.hold_channel"))
        full, most = self.full_thrust_n, self.vehicle.thrust_max_n
        if full < (1.0 - HOVER_TOLERANCE) * most:
            raise ValueError(
                notice("vehicle.full_thrust", most_n=most, full_n=full, curve=self.thrust_curve)
            )
        self._ensure_thrusts_fit()
        if way_out := find_way_out(self):
            raise ValueError(way_out)

    def _ensure_thrusts_fit(self) -> None:
        """Check the vehicle's thrusts and weight against each other: each may be within its range
        in a wrong unit.

        Raises:
            ValueError: one of them can't be in the unit that its name says.
        """
        vehicle, weight_n = self.vehicle, self.weight_n
        most_n = vehicle.thrust_max_n if vehicle.hover_thrust is None else self.full_thrust_n
        key = "thrust_max_n" if vehicle.hover_thrust is None else "hover_thrust"
        if not LEAST_LIFT * weight_n <= most_n <= LARGEST_LIFT * weight_n:
            raise ValueError(
                notice(
                    "vehicle.lift",
                    key=key,
                    most_n=most_n,
                    times=most_n / weight_n,
                    weight_n=weight_n,
                    mass_kg=vehicle.mass_kg,
                    least=LEAST_LIFT,
                    most=LARGEST_LIFT,
                )
            )
        if vehicle.thrust_min_n >= weight_n:
            found_n = vehicle.thrust_min_n
            raise ValueError(
                notice(
                    "vehicle.least_thrust",
                    weight_n=weight_n,
                    mass_kg=vehicle.mass_kg,
                    found_n=found_n,
                )
            )
        least, most = vehicle.hover_range
        if not least < 1.0 < most:
            raise ValueError(notice("vehicle.hover_range", found=[least, most]))
        if (
            vehicle.hover_n is not None
            and not least * weight_n <= vehicle.hover_n <= most * weight_n
        ):
            least_n, most_n = least * weight_n, most * weight_n
            raise ValueError(
                notice("vehicle.hover", least_n=least_n, most_n=most_n, found_n=vehicle.hover_n)
            )

    @property
    def body(self) -> str:
        """The vehicle's object in the capture system; empty for a source of a single body."""
        return self.pose.body_name

    @property
    def thrust_curve(self) -> float:
        """The thrust curve in force (links/core/deadman.py): the link's, or else the vehicle's."""
        return (
            self.vehicle.thrust_curve if self.link.thrust_curve is None else self.link.thrust_curve
        )

    @property
    def forwards(self) -> ForwardConfig | None:
        """Forwarding of our poses to the autopilot's own estimator; None if it gets none."""
        if isinstance(self.link, MavlinkLinkConfig) and self.link.forward.enabled:
            return self.link.forward
        return None

    @property
    def full_thrust_n(self) -> float:
        """Thrust of the full signal [N]: by the hover thrust, if it is configured."""
        vehicle = self.vehicle
        if vehicle.hover_thrust is None:
            return vehicle.thrust_max_n
        return full_thrust_n(
            vehicle.mass_kg * self.controller.gravity, vehicle.hover_thrust, self.thrust_curve
        )

    @property
    def weight_n(self) -> float:
        """The vehicle's configured weight [N]."""
        return self.vehicle.mass_kg * self.controller.gravity
