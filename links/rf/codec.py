"""Common parts of the codecs and configurations of serial RF modules. Sans-IO.

A codec is a configuration that is a :class:`RfLinkConfig`, and a class that is a :class:`RfCodec`.
Both stand in links/rf/module_codec.py, with one line in ``RF_CODECS``.
"""

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Sequence
from enum import StrEnum
from typing import Annotated, Generic, NamedTuple, Protocol, Self, TypeAlias, TypeVar

import msgspec

from links.core import LinkKind
from links.rf.channel_map import ChannelMap
from links.text import link_notice, to_ms


class Service(StrEnum):
    """Services of a module beside channels; while disarmed only."""

    BIND = "bind"
    RANGE_CHECK = "range_check"


class RfTelemetry(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Telemetry through a module, of the vehicle and of the radio; a frame tells some of it."""

    battery_v: float | None = None
    """Voltage of the vehicle's battery [V]."""
    battery_share: float | None = None
    """Its charge [-]."""
    mode: str | None = None
    """The flight controller's mode, in its own words."""
    attitude: tuple[float, float, float, float] | None = None
    """Unit quaternion w, x, y, z of the flight controller, body FRD to NED with its own north."""
    attitude_s: float | None = None
    """About when that was so, on the commands' clock [s]: no frame tells."""
    uplink_share: float | None = None
    """Share of our frames that the receiver gets [-]."""
    uplink_dbm: int | None = None
    """Power that its better antenna gets of them [dBm]."""
    uplink_snr_db: int | None = None
    """Signal-to-noise ratio of the uplink [dB]."""
    early_s: float | None = None
    """Lead of our frames over the module's own timing [s]; negative where they are late."""


class RfFrame(NamedTuple):
    """One frame as a module understands it."""

    positions: tuple[float, ...] | None
    """Position of every channel, -1..1 and a little beyond; None without channels."""
    service: Service | None = None
    """Requested service, or None."""
    model_id: int | None = None
    """The model it names."""
    tells: RfTelemetry | None = None
    """Telemetry in the frame, or None."""


F = TypeVar("F")


class FrameReader(ABC, Generic[F]):
    """Frames out of a stream; begins anew one byte later wherever a frame turns out to be none."""

    def __init__(self) -> None:
        self.dropped: Counter[str] = Counter()
        """Bytes that belong to no frame, by reason."""
        self._rest = b""

    @abstractmethod
    def _find_end(self, data: bytes, at: int) -> int | str:
        """Return the end of the frame at ``at``, beyond ``data`` if it is not whole.

        Or why there is none.
        """

    @abstractmethod
    def _decode_frame(self, frame: bytes) -> F:
        """Decode a whole frame."""

    def feed(self, data: bytes) -> list[F]:
        """Take the next bytes, however they were cut; returns the frames that they complete."""
        data, at = self._rest + data, 0
        heard: list[F] = []
        while at < len(data):
            end = self._find_end(data, at)
            if isinstance(end, str):
                self.dropped[end] += 1
                at += 1
            elif end > len(data):
                break
            else:
                heard.append(self._decode_frame(data[at:end]))
                at = end
        self._rest = data[at:]
        return heard

    def pause(self) -> None:
        """The wire was silent: whatever was begun will not be completed."""
        if self._rest:
            self.dropped["cut_short"] += len(self._rest)
            self._rest = b""


RfDecoder: TypeAlias = FrameReader[RfFrame]


class RfCodec(Protocol):
    """Positions to frames."""

    channels: int
    """Number of channels [-]."""
    services: frozenset[Service]
    """Services that the module offers."""
    frame_bytes: int
    """Size of a frame of channels."""

    def greeting(self) -> bytes:
        """First frame to a module, once, in place of channels; may be empty."""

    def encode(
        self, positions: Sequence[float], service: Service | None = None, nth: int = 0
    ) -> bytes:
        """The frame for ``positions`` (-1..1).

        With ``service``, the ``nth`` frame since it was asked for.
        """

    def decoder(self) -> RfDecoder:
        """A new decoder of the same frames."""


class Manner(msgspec.Struct, frozen=True, kw_only=True):
    """Pacing of a pacer, for whoever commands it; see :class:`RfLinkConfig`."""

    period_s: float
    lead_s: float
    arm_low_s: float
    arm_high_s: float
    disarm_s: float
    services: frozenset[Service]


class RfLinkConfig(LinkKind, frozen=True, kw_only=True):
    """Configuration common to all serial RF links."""

    port: Annotated[str, msgspec.Meta(description="The serial port of the module.")] = (
        "/dev/ttyUSB0"
    )
    simulated: Annotated[
        bool,
        msgspec.Meta(
            description="A simulator is at the other end of the port, such as `groundstation-sim "
            "serve`: neither fence nor speed limit is asked for. Believed only of a "
            "pseudo-terminal; but some lead on to a module (socat, ser2net), so nobody "
            "can tell."
        ),
    ] = False
    baud: Annotated[int, msgspec.Meta(ge=1200, le=6_000_000, description="Its speed [bit/s].")] = (
        115200
    )
    period_s: Annotated[
        float, msgspec.Meta(ge=0.001, le=0.1, description="Time between two frames [s].")
    ] = 0.0225
    map: ChannelMap = ChannelMap()
    arm_low_s: Annotated[
        float,
        msgspec.Meta(
            ge=0.0,
            le=10.0,
            description="How long arming first shows a disarmed transmitter with its throttle down "
            "[s]: flight controllers want that.",
        ),
    ] = 0.5
    arm_high_s: Annotated[
        float,
        msgspec.Meta(
            ge=0.0,
            le=10.0,
            description="How long it then holds the arm channel up with the throttle down before "
            "it counts as armed [s].",
        ),
    ] = 1.0
    disarm_s: Annotated[
        float,
        msgspec.Meta(
            ge=0.0,
            le=10.0,
            description="How long disarm frames must have left before the vehicle counts as "
            "disarmed [s]: nothing comes back to tell.",
        ),
    ] = 0.5
    lead_s: Annotated[
        float,
        msgspec.Meta(
            ge=0.0,
            le=0.02,
            description="How long before its frame leaves a command is asked for [s]. One that "
            "comes later waits for the next frame.",
        ),
    ] = 0.005
    fifo_priority: Annotated[
        int,
        msgspec.Meta(
            ge=0,
            le=90,
            description="Real-time priority (SCHED_FIFO) of the process that paces the frames, "
            "where allowed; 0 for none.",
        ),
    ] = 50

    def codec(self) -> RfCodec:
        """The codec that this configures."""
        raise NotImplementedError

    def __post_init__(self) -> None:
        codec = self.codec()
        highest = max(self.map.channels)
        if highest > codec.channels:
            raise ValueError(link_notice("rf.few_channels", channel=highest, count=codec.channels))
        if self.frame_s > 0.9 * self.period_s:
            raise ValueError(
                link_notice(
                    "rf.long_frame",
                    bytes=codec.frame_bytes,
                    frame_ms=to_ms(self.frame_s),
                    baud=self.baud,
                    period_ms=to_ms(self.period_s),
                )
            )
        if self.lead_s >= self.period_s:
            raise ValueError(link_notice("rf.lead"))

    @property
    def address_key(self) -> str:
        """Key with the module's port."""
        return "port"

    @property
    def real(self) -> str:
        """The setting that may lead to a real vehicle; groundstation/flight/preflight has the one
        exception.
        """
        return f"port = {self.port}"

    @property
    def thrust_curve(self) -> float | None:
        """The throttle's curve (see :class:`links.rf.channel_map.Throttle`).

        None for the vehicle's.
        """
        return self.map.thrust.curve

    def with_thrust_curve(self, curve: float) -> Self:
        """Return this configuration with another throttle curve."""
        throttle = msgspec.structs.replace(self.map.thrust, curve=curve)
        return msgspec.structs.replace(self, map=msgspec.structs.replace(self.map, thrust=throttle))

    @property
    def manner(self) -> Manner:
        """Pacing that the commander must know."""
        return Manner(
            period_s=self.period_s,
            lead_s=self.lead_s,
            arm_low_s=self.arm_low_s,
            arm_high_s=self.arm_high_s,
            disarm_s=self.disarm_s,
            services=self.codec().services,
        )

    @property
    def frame_s(self) -> float:
        """Duration of a frame on the wire [s], 10 bits a byte."""
        return 10.0 * self.codec().frame_bytes / self.baud


def counts(position: float, low: int, high: int, largest: int) -> int:
    """The count of a position where -1 is ``low`` and 1 is ``high``, within 0..``largest``."""
    return min(max(round(0.5 * (low + high) + 0.5 * (high - low) * position), 0), largest)


def position(count: int, low: int, high: int) -> float:
    """The position of a count: the inverse of :func:`counts`."""
    return (2.0 * count - low - high) / (high - low)
