"""Rehearsal: a configuration whose every address is turned to one host of this machine's loopback network.

There `groundstation-sim serve --config` plays tracker and autopilot of that very file. One table decides: a key that
may hold an address stands in ``ADDRESSES`` with what becomes of it, every other text in ``TEXTS``; a test walks the
schema, so that no new key is in neither. The host is the file's own, and its ports are nobody else's, so what listens
on all addresses of this machine, as a router to a vehicle does, hears nothing of a rehearsal either.
"""

import asyncio
import hashlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import msgspec

from groundstation.config import VEHICLE_LETTERS, ConfigError, texts_of
from groundstation.pose.sources import JsonConfig, LibmotioncaptureConfig
from groundstation.runtime import RecordingConfig, folder_of, socket_folder
from links.io import is_pseudo_terminal, parse_address

if TYPE_CHECKING:
    from groundstation.settings.settings import Config

REHEARSAL = "rehearsal"
"""The name of a rehearsed vehicle, which no other may have: whoever arms by name says that nothing real moves."""
FIRST_PORT, PORTS = 25000, 5000
"""Every port becomes one of these, by its own last digits: none is a tracker's, an autopilot's or a broker's usual."""
FOLDER = "rehearsals"
"""Recordings of rehearsals stand apart, in this folder: no real flight is tidied away for them."""


class RehearsalConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where a rehearsal takes place; ``--rehearse`` writes it. Config section ``[rehearsal]``."""

    host: Annotated[str, msgspec.Meta(pattern=r"\A127\.(6[4-9]|[7-9]\d|1[01]\d|12[0-7])(\.\d{1,3}){2}\Z")]
    """Host on the loopback network that every address is turned to."""
    ports: str
    """Folder of the pseudo-terminals that stand for serial ports."""
    vehicle: str
    """The name of the vehicle that is rehearsed."""
    name: Annotated[str, msgspec.Meta(pattern=rf"\A{REHEARSAL}(-[A-Za-z0-9_.-]+)?\Z", max_length=VEHICLE_LETTERS)] = (
        REHEARSAL
    )
    """What the vehicle is called meanwhile: ``rehearsal``; in a fleet ``rehearsal-`` and its own name."""

    @property
    def serial(self) -> str:
        """The pseudo-terminal."""
        return str(Path(self.ports) / f"{self.name}.tty")


def is_rehearsal(vehicle: str) -> bool:
    """Whether a vehicle of this name flies in a rehearsal: no configuration gives the name to another."""
    return vehicle == REHEARSAL or vehicle.startswith(f"{REHEARSAL}-")


def _address(value: Any, room: RehearsalConfig) -> Any:
    return None if value is None else f"{room.host}:{_port(parse_address(value)[1], room)}"


def _port(value: Any, room: RehearsalConfig) -> Any:
    del room
    return None if value is None else FIRST_PORT + value % PORTS


def _host(value: Any, room: RehearsalConfig) -> Any:
    del value
    return room.host


def _serial(value: Any, room: RehearsalConfig) -> Any:
    return None if value is None else room.serial


def _be(fixed: Any) -> "Turn":
    return lambda value, room: fixed


def _name(value: Any, room: RehearsalConfig) -> Any:
    del value
    return room.name


def _apart(value: Any, room: RehearsalConfig) -> Any:
    del room
    folder = folder_of(RecordingConfig(folder=value))
    return str(folder if folder.name == FOLDER else folder / FOLDER)


Turn = Callable[[Any, RehearsalConfig], Any]
"""Takes a key's value and the place of the rehearsal; returns what the value becomes. Twice is as once."""

ADDRESSES: Mapping[str, Turn] = {
    "link.listen": _address,
    "link.remote": _address,
    "link.tcp": _address,
    "link.serial": _serial,
    "link.port": _serial,
    "link.simulated": _be(True),
    "pose.listen": _address,
    "pose.server": _address,
    "pose.interface": _host,
    "pose.hostname": _host,
    "pose.options": _be({}),
    "pose.multicast": _be(False),  # a group is heard from every network that any program has joined it on
    "mqtt.host": _host,
    "mqtt.port": _port,
    "mqtt.insecure": _be(False),
    "mqtt.username": _be(""),  # the broker there knows no passwords and has no certificate
    "mqtt.password_file": _be(""),
    "status.path": _be(""),
    "recording.folder": _apart,
    "vehicle.name": _name,
}
"""Keys that may hold an address, and those that go with them."""

TEXTS = frozenset({
    "controller.factory", "controller.options", "link.key_file", "link.map.fixed", "link.signing_key_file",
    "mqtt.prefix", "mqtt.requests.clients", "mqtt.tls.ca_file", "mqtt.tls.cert_file", "mqtt.tls.key_file",
    "operator.device", "operator.hold", "pose.group", "pose.name", "pose.object", "pose.path", "separation.others",
    "rehearsal.host", "rehearsal.name", "rehearsal.ports", "rehearsal.vehicle", "trajectory.factory", "trajectory.file",
    "trajectory.options", "vehicle.file", "vehicle.preset",
})  # fmt: skip
"""Keys of free text that lead nowhere: names, files of this machine, what the operator holds in their own hand; the
group of a multicast that is off."""


def _as_datagrams(pose: LibmotioncaptureConfig) -> JsonConfig:
    """What is played in its place: its servers' protocols are the library's own."""
    told = {key: getattr(pose, key) for key in ("name", "world", "body", "alignment", "latency_s")}
    return JsonConfig(**told)


def turn_sections(config: "Config", room: RehearsalConfig) -> dict[str, msgspec.Struct]:
    """The sections of ``config`` in which something may be an address, with all of that turned to ``room``."""
    turned = dict[str, tuple[Any, dict[str, Any]]]()
    for section in dict.fromkeys(key.partition(".")[0] for key in ADDRESSES):
        told: Any = getattr(config, section)
        if isinstance(told, LibmotioncaptureConfig):
            told = _as_datagrams(told)
        changes = {
            name: turn(getattr(told, name), room)
            for key, turn in ADDRESSES.items()
            for name in [key.partition(".")[2]]
            if key.startswith(f"{section}.") and hasattr(told, name)
        }
        turned[section] = told, changes
    link, changes = turned["link"]
    if "serial" in changes and not any(changes[way] for way in ("listen", "remote", "tcp", "serial")):
        changes["listen"] = _address(link.address, room)
    mqtt, changes = turned["mqtt"]
    changes |= {"tls": type(mqtt.tls)(), "port": _port(mqtt.tcp_port, room)}
    return {section: msgspec.structs.replace(told, **changes) for section, (told, changes) in turned.items()}


def find_way_out(config: "Config") -> str:
    """What leads out of the rehearsal that ``config`` says it is, or brings another flight into it; empty: nothing."""
    room = config.rehearsal
    if room is None:
        says = f"vehicle.name: {config.vehicle.name!r} is kept for rehearsals (--rehearse): call it otherwise"
        return says if is_rehearsal(config.vehicle.name) else ""
    for section, turned in turn_sections(config, room).items():
        told = getattr(config, section)
        for name in turned.__struct_fields__ if told != turned else ():
            value, wanted = getattr(told, name, None), getattr(turned, name)
            if value != wanted:
                return (
                    f"{section}.{name}: leads out of the rehearsal at {room.host}: expected {wanted!r}, got {value!r}"
                )
    return ""


def rehearse(config: "Config", file: Path, *, fleet: bool = False) -> "Config":
    """``config``, which ``file`` says, with every address turned to that file's own host of the loopback network.

    Args:
        config: as it would fly in earnest.
        file: where it comes from, of a ``fleet`` the fleet file: both sides of a rehearsal name the same.
        fleet: the vehicle is one of several, and keeps its name behind the word.

    Raises:
        ConfigError: a key may hold an address, and nobody has told what becomes of it.
    """
    unknown = [key for key in texts_of(type(config)) if key not in ADDRESSES and key not in TEXTS]
    if unknown:
        raise ConfigError(
            unknown[0], "--rehearse does not know what becomes of this key: it stays unused until it does"
        )
    a, b, c = hashlib.sha256(str(file.resolve()).encode()).digest()[:3]
    name = config.vehicle.name
    room = RehearsalConfig(
        host=f"127.{64 + a % 64}.{b}.{1 + c % 254}",
        ports=str(socket_folder()),
        vehicle=name,
        name=f"{REHEARSAL}-{name}"[:VEHICLE_LETTERS] if fleet else REHEARSAL,
    )
    return msgspec.structs.replace(config, rehearsal=room, **turn_sections(config, room))


def describe_rehearsal(config: "Config", before: "Config") -> str:
    """One line for the operator: that it is one, and where the addresses of ``before`` lead now."""
    room = config.rehearsal
    assert room is not None, "the caller has looked"
    turned = []
    for key in ADDRESSES:
        section, _, name = key.partition(".")
        old, new = (getattr(getattr(one, section), name, None) for one in (before, config))
        off = section == "mqtt" and not config.mqtt.enabled
        if new != old and section in ("link", "pose", "mqtt") and isinstance(new, str) and new and not off:
            turned.append(f"{key} {new}")
    return f"REHEARSAL of {room.vehicle}: nothing real is reached or moves. Turned: {', '.join(turned) or 'nothing'}"


AF_UNIX = 1
"""A number of Linux."""


def beacon(room: RehearsalConfig) -> str:
    """The name that the simulated side of ``room`` holds: in no folder, and gone with its process (unix(7))."""
    return f"\0groundstation rehearsal at {room.host}"


def ensure_served(room: RehearsalConfig, file: Path) -> None:
    """The simulated side must be there before anything is opened: what speaks first would speak to nobody we know.

    Raises:
        ConfigError: it is not, or something that is no pseudo-terminal stands where one should.
    """
    serve = f"start it: groundstation-sim serve --config {file}"

    async def look() -> None:
        loop = asyncio.get_running_loop()
        wire, _ = await loop.create_datagram_endpoint(
            asyncio.DatagramProtocol, remote_addr=beacon(room), family=AF_UNIX
        )
        wire.close()

    try:
        asyncio.run(look())
    except OSError:
        raise ConfigError("--rehearse", f"nobody plays the other side of {file}; {serve}") from None
    if Path(room.serial).exists() and not is_pseudo_terminal(room.serial):
        raise ConfigError("--rehearse", f"{room.serial} is no pseudo-terminal: remove it, and {serve}")
