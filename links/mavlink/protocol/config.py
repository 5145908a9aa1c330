"""Configuration of a MAVLink link."""

from typing import Annotated, ClassVar, Literal
from zlib import crc32

import msgspec

from links.core import LinkKind
from links.io import is_loopback, parse_address, remote_setting
from links.text import link_notice

DEFAULT_LISTEN = "127.0.0.1:14540"
"""Address that PX4 sends to for an offboard computer."""
LOCAL_PORTS = range(20_000, 30_000)
"""Local ports for ``remote``: unprivileged, and below those that Linux assigns itself (from
32768)."""
ODOMETRY_BYTES = 258
"""Longest frame of forwarding [bytes]: an ODOMETRY of 233, with header, checksum and signature."""
FORWARD_SHARE = 0.3
"""Limit of forwarding as a share of a serial port's rate [-]: the rest is for other frames.
Chosen."""


class ForwardConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Our poses to the autopilot's own estimator, as ODOMETRY
    (links/mavlink/protocol/odometry_codec.py).
    """

    enabled: Annotated[
        bool,
        msgspec.Meta(
            description="Whether to send them; docs/how-to/px4.md has the parameters that the "
            "autopilot needs."
        ),
    ] = False
    rate_hz: Annotated[
        float,
        msgspec.Meta(
            ge=1.0,
            le=200.0,
            description="Largest rate at which they are sent [1/s]; autopilots want 30 to 50.",
        ),
    ] = 40.0
    noise_m: Annotated[
        float,
        msgspec.Meta(
            ge=1e-4,
            le=0.5,
            description="1σ of the position per axis that is sent with them [m].",
        ),
    ] = 0.005
    noise_deg: Annotated[
        float,
        msgspec.Meta(
            ge=0.05,
            le=90.0,
            description="1σ of the attitude per axis that is sent with them [deg].",
        ),
    ] = 0.5
    oldest_s: Annotated[
        float,
        msgspec.Meta(ge=0.005, le=1.0, description="Largest age of a pose that is sent [s]."),
    ] = 0.1


class MavlinkLinkConfig(LinkKind, frozen=True, kw_only=True, tag="mavlink"):
    """MAVLink 2 over UDP, TCP or a serial port, to PX4 (OFFBOARD) or ArduPilot Copter (GUIDED)."""

    has_autopilot: ClassVar[bool] = True
    listen: Annotated[
        str | None,
        msgspec.Meta(
            description="Address of this machine that the autopilot sends to, host:port (UDP). "
            "Without any other: 127.0.0.1:14540."
        ),
    ] = None
    remote: Annotated[
        str | None,
        msgspec.Meta(
            description="Address of an autopilot that waits for us to speak first, host:port (UDP)."
        ),
    ] = None
    local_port: Annotated[
        Annotated[int, msgspec.Meta(ge=1, le=65535)] | None,
        msgspec.Meta(
            description="Port of this machine from which `remote` is spoken to (UDP). Without it, "
            "one from 20000 to 29999 that follows from `remote` and `target_system`, so it is the "
            "same each time: PX4 answers the first port that it hears, until it restarts."
        ),
    ] = None
    tcp: Annotated[
        str | None,
        msgspec.Meta(
            description="Address of a simulator or radio that accepts TCP connections, host:port."
        ),
    ] = None
    serial: Annotated[
        str | None,
        msgspec.Meta(
            description="Serial port, such as /dev/serial/by-id/usb-…, whose name stays the same "
            "when it is plugged in again."
        ),
    ] = None
    baud: Annotated[
        int,
        msgspec.Meta(
            ge=9600,
            le=4_000_000,
            description="Speed of the serial port [bit/s]; over USB it does not matter.",
        ),
    ] = 921600
    system_id: Annotated[int, msgspec.Meta(ge=1, le=255, description="Our own MAVLink system.")] = (
        245
    )
    component_id: Annotated[
        int,
        msgspec.Meta(
            ge=1, le=255, description="Our own MAVLink component; 190 is a ground station."
        ),
    ] = 190
    target_system: Annotated[
        int,
        msgspec.Meta(
            ge=1, le=255, description="MAVLink system of the vehicle; every other one is ignored."
        ),
    ] = 1
    target_component: Annotated[
        int,
        msgspec.Meta(
            ge=1,
            le=255,
            description="MAVLink component of its autopilot; every other one is ignored.",
        ),
    ] = 1
    period_s: Annotated[
        float,
        msgspec.Meta(
            ge=0.001,
            le=0.25,
            description="Time between two commands [s]; by default that of the paper's flights. "
            "PX4 gives up OFFBOARD below two a second.",
        ),
    ] = 0.0225
    pace: Annotated[
        Literal["poses", "period"],
        msgspec.Meta(
            description="`poses`: a command leaves as soon as a pose has come, at most two in "
            "`period_s`, and one and a half periods after the last one where no pose "
            "comes. `period`: a command leaves every `period_s`, as a radio's frames "
            "do."
        ),
    ] = "poses"
    bring_down: Annotated[
        Literal["auto", "rates", "land"],
        msgspec.Meta(
            description="What is sent when commands stop in the air: `rates` levels, sinks and "
            "stops the motors within 2 s; `land` asks for mode LAND meanwhile, and goes "
            "on with rates until it is accepted; `auto` is `land` where the autopilot "
            "says at that moment that it knows its own position, height and speed, and "
            "`rates` elsewhere."
        ),
    ] = "auto"
    own_position: Annotated[
        bool,
        msgspec.Meta(
            description="Whether the autopilot knows its position by something else than our "
            "tracker, such as GPS or optical flow. Where our poses have been found to "
            "be wrong, `auto` asks for mode LAND only with that, or where nothing says "
            "that the autopilot gets poses: no `forward`, no vision message heard, "
            "`pose.kind` neither mavlink nor vision."
        ),
    ] = False
    connect_timeout_s: Annotated[
        float,
        msgspec.Meta(
            ge=0.01,
            le=600.0,
            description="How long to wait for the autopilot's first HEARTBEAT [s].",
        ),
    ] = 10.0
    heartbeat_timeout_s: Annotated[
        float,
        msgspec.Meta(
            ge=1.5,
            le=60.0,
            description="The autopilot counts as lost after this long without its HEARTBEAT, sent "
            "once a second [s].",
        ),
    ] = 3.0
    thrust_curve: Annotated[
        Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] | None,
        msgspec.Meta(
            description="f of thrust = f u² + (1 - f) u, from what we send (u) to what the motors "
            "give, in place of vehicle.thrust_curve. 0 where the autopilot straightens "
            "the curve itself: PX4 with THR_MDL_FAC set, ArduPilot with MOT_THST_EXPO "
            "set."
        ),
    ] = None
    ardupilot_mode: Annotated[
        Literal["GUIDED", "GUIDED_NOGPS"],
        msgspec.Meta(
            description="Mode that follows our commands on ArduPilot: GUIDED wants a position "
            "estimate of its own, GUIDED_NOGPS none."
        ),
    ] = "GUIDED"
    signing_key_file: Annotated[
        str | None,
        msgspec.Meta(
            description="File with the 32 bytes of a MAVLink 2 signing key (raw, hex or base64), "
            "mode 0600. With it we sign what we send and believe nothing that is not "
            "signed."
        ),
    ] = None
    forward: ForwardConfig = ForwardConfig()
    quiet: Annotated[
        bool,
        msgspec.Meta(
            description="Stop the autopilot's default telemetry that nobody here reads; false "
            "where others share this connection."
        ),
    ] = True

    def __post_init__(self) -> None:
        addresses = {
            "listen": self.listen,
            "remote": self.remote,
            "tcp": self.tcp,
            "serial": self.serial,
        }
        given = [name for name, address in addresses.items() if address is not None]
        if len(given) > 1:
            raise ValueError(link_notice("mavlink.exclusive", keys=" and ".join(given)))
        if self.local_port is not None and self.remote is None:
            raise ValueError(link_notice("mavlink.local_port"))
        if self.bring_down == "land" and self.ardupilot_mode == "GUIDED_NOGPS":
            raise ValueError(link_notice("mavlink.no_estimate"))
        needed_bytes_s = ODOMETRY_BYTES * self.forward.rate_hz
        bytes_s = self.baud / 10.0  # start bit, 8 data bits and stop bit
        if (
            self.serial is not None
            and self.forward.enabled
            and needed_bytes_s > FORWARD_SHARE * bytes_s
        ):
            raise ValueError(
                link_notice(
                    "mavlink.forward_rate",
                    rate_hz=self.forward.rate_hz,
                    bytes_s=needed_bytes_s,
                    baud=self.baud,
                )
            )
        if self.serial is None:
            parse_address(self.endpoint, self.address_key)

    @property
    def real(self) -> str | None:
        """Setting by which commands may reach a real vehicle, as ``key = value``; None where they
        stay on this machine.
        """
        if self.serial is not None:
            return f"serial = {self.serial}"
        return remote_setting(self.address_key, self.endpoint)

    @property
    def address_key(self) -> str:
        """Key with the address of the autopilot."""
        return (
            "serial"
            if self.serial is not None
            else "tcp"
            if self.tcp is not None
            else "remote"
            if self.remote is not None
            else "listen"
        )

    @property
    def endpoint(self) -> str:
        """Configured address, host:port, or the serial port."""
        endpoint: str | None = getattr(self, self.address_key)
        return DEFAULT_LISTEN if endpoint is None else endpoint

    @property
    def destination(self) -> str:
        """Destination of commands: several vehicles may be behind one address."""
        return f"{super().destination} system {self.target_system}"

    @property
    def local_address(self) -> tuple[str, int]:
        """Host and port of this machine for ``remote``, the same in every run."""
        host, _ = parse_address(self.endpoint)
        loopback, every = ("::1", "::") if ":" in host else ("127.0.0.1", "0.0.0.0")  # noqa: S104
        ours = loopback if is_loopback(host) else every
        if self.local_port is not None:
            return ours, self.local_port
        chosen = crc32(self.destination.encode()) % len(LOCAL_PORTS)
        return ours, LOCAL_PORTS[chosen]

    @property
    def follows_poses(self) -> bool:
        """Whether a command leaves as soon as a pose has come."""
        return self.pace == "poses"

    @property
    def key_files(self) -> dict[str, str]:
        """File of the signing key, where there is one."""
        return {} if self.signing_key_file is None else {"signing_key_file": self.signing_key_file}
