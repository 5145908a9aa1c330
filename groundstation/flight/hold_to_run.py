"""Hold-to-run control: the position of a key, an axis or a transmitter's channel that the operator
must hold, read each ``LOOK_S`` (10 ms) for as long as a flight lasts.
"""

import asyncio
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from groundstation.config import ConfigError
from groundstation.core.messages import notice
from groundstation.core.mission import HoldToRun, InputLost
from groundstation.runtime import require_package
from groundstation.settings import OperatorConfig
from links.core import LOOK_S, CommandLink
from links.mavlink import MavlinkConnection, MavlinkLink
from links.mavlink.protocol import Message, load_dialect

if TYPE_CHECKING:
    from evdev import InputDevice

RATE_HZ = 25.0
"""Requested rate of RC_CHANNELS [1/s]. Chosen."""
OLD_S = 0.5
"""Age of a channel's value from which the channel is lost [s]: a dozen messages are missing.
Chosen."""
NO_CHANNEL = (0, 0xFFFF)
"""Values of RC_CHANNELS for a channel that does not exist (MAVLink common message 65)."""
TRAVEL_US = (1000, 2000)
"""Pulses of a channel at both ends of its travel [µs]."""


class Input(Protocol):
    """A key, an axis, or a channel."""

    what: str
    """Its name, for the operator."""

    def share(self) -> float | None:
        """Return its position as a share of its travel, 0 (released) to 1 (pressed); None before
        its first value.

        Raises:
            InputLost: it can't be read any more.
        """

    def close(self) -> None:
        """Release it."""


class DeviceInput:
    """A key or an axis of one of this machine's input devices, by evdev. Linux only.

    Its present state is read from the kernel (EVIOCGKEY, EVIOCGABS), instead of adding up events:
    no event can be lost, a key that was held before the device was opened is known, and a device
    that another program has grabbed, such as another flight of the same operator, can be read as
    well.
    """

    def __init__(self, device: "InputDevice[str]", hold: str, code: int) -> None:
        """``code`` is that of linux/input-event-codes.h, ``hold`` its name."""
        self.what = f"{hold} of {_name_device(device)}"
        self._device = device
        self._code = code
        self._is_axis = hold.startswith("ABS_")

    def share(self) -> float:
        """Return its position, 0 to 1: of a key 0 or 1, of an axis by its range.

        Raises:
            InputLost: the device was unplugged, or taken from us.
        """
        try:
            if not self._is_axis:
                return 1.0 if self._code in self._device.active_keys() else 0.0
            axis = self._device.absinfo(self._code)
        except OSError as error:
            raise InputLost(error.strerror or str(error)) from None
        if axis.max <= axis.min:
            raise InputLost(notice("hold.no_travel", least=axis.min, most=axis.max))
        return float((axis.value - axis.min) / (axis.max - axis.min))

    def close(self) -> None:
        """Close the device, which also ends an exclusive use of it."""
        self._device.close()


def open_device(config: OperatorConfig) -> DeviceInput:
    """Open the key or axis that ``config`` names.

    Raises:
        ConfigError: there is none, or more than one; the message lists the devices.
    """
    if sys.platform != "linux":
        raise ConfigError("operator.hold", notice("hold.linux_only"))
    require_package("evdev", "operator.hold", "operator")
    from evdev import ecodes

    code = ecodes.ecodes.get(config.hold)
    if code is None:
        raise ConfigError("operator.hold", notice("hold.unknown_name", found=config.hold))
    kind = ecodes.EV_ABS if config.hold.startswith("ABS_") else ecodes.EV_KEY
    part_of_name = "" if config.device.startswith("/") else config.device.lower()
    devices = list(_list_devices(config.device))
    suitable = [
        device
        for device in devices
        if part_of_name in device.name.lower()
        and code in device.capabilities(absinfo=False).get(kind, [])
    ]
    for device in devices:
        if len(suitable) != 1 or device is not suitable[0]:
            device.close()
    if len(suitable) == 1:
        if config.grab:
            # Where another flight has grabbed the device, no terminal gets its keys either.
            with suppress(OSError):
                suitable[0].grab()
        return DeviceInput(suitable[0], config.hold, code)
    if suitable:
        several = ", ".join(map(_name_device, suitable))
        raise ConfigError(
            "operator.device", notice("hold.several", name=config.hold, devices=several)
        )
    listed = ", ".join(map(_name_device, devices)) or notice("hold.no_device")
    raise ConfigError(
        "operator.device", notice("hold.no_such_device", name=config.hold, devices=listed)
    )


def _name_device(device: "InputDevice[str]") -> str:
    """Return name and path of ``device``, for the operator."""
    return f"“{device.name}” ({os.fsdecode(device.path)})"


def _list_devices(path: str) -> "Iterator[InputDevice[str]]":
    """Yield the device at ``path``, opened; all that may be read where it is no absolute path."""
    from evdev import InputDevice, list_devices

    if path.startswith("/"):
        try:
            yield InputDevice(str(Path(path).resolve()), readonly=True)
        except OSError as error:
            id = "hold.joystick" if Path(path).resolve().name.startswith("js") else "value.refused"
            raise ConfigError(
                "operator.device", notice(id, value=path, why=error.strerror or error)
            ) from None
        return
    for one in sorted(list_devices(writable=False)):
        with suppress(OSError):
            yield InputDevice(one, readonly=True)


class ChannelInput:
    """A channel of the operator's transmitter, reported by the autopilot (RC_CHANNELS, MAVLink
    common message 65).
    """

    def __init__(self, connection: MavlinkConnection, number: int) -> None:
        """``number`` is from 1 to 18; the messages are requested as ``connection`` opens."""
        self.what = f"channel {number} of the transmitter"
        self._field = f"chan{number}_raw"
        self._pulse_us: int | None = None
        """Newest pulse of the channel [µs]; None before the first."""
        self._time_s = 0.0
        """Its arrival."""
        self._is_received = True
        """Whether the autopilot's receiver gets the transmitter."""
        connection.request(lambda _: {"RC_CHANNELS": RATE_HZ})
        connection.subscribe(self._take)

    def share(self) -> float | None:
        """Return its position, 0 at 1000 µs and 1 at 2000 µs; None before the first report.

        Raises:
            InputLost: the autopilot no longer reports it, or does not receive the transmitter.
        """
        if self._pulse_us is None:
            return None
        age_s = asyncio.get_running_loop().time() - self._time_s
        if age_s > OLD_S:
            raise InputLost(notice("hold.untold", age_s=age_s))
        if not self._is_received:
            raise InputLost(notice("hold.no_receiver"))
        if self._pulse_us in NO_CHANNEL:
            raise InputLost(notice("hold.no_channel"))
        low, high = TRAVEL_US
        return (self._pulse_us - low) / (high - low)

    def close(self) -> None:
        """Do nothing: the connection is the link's."""

    def _take(self, message: Message, arrival_s: float) -> None:
        """Take the channel's pulse, or the state of the receiver."""
        match message.get_type():
            case "RC_CHANNELS":
                self._pulse_us, self._time_s = getattr(message, self._field), arrival_s
            case "SYS_STATUS":
                enabled = message.onboard_control_sensors_enabled
                healthy = message.onboard_control_sensors_health
                receiver = load_dialect().MAV_SYS_STATUS_SENSOR_RC_RECEIVER
                self._is_received = not enabled & receiver or bool(healthy & receiver)


class HoldWatch:
    """Watch on the operator's hold of one flight."""

    def __init__(self, what: str, above: float, connect: Callable[[], Input]) -> None:
        """Begin without an input.

        Args:
            what: name of the input until it is open.
            above: share of its travel from which it is held [-].
            connect: opens the input, as the flight begins.
        """
        self.hold = HoldToRun(what, above)
        self._connect = connect

    async def run(self, on_read: Callable[[], None]) -> None:
        """Read the input each ``LOOK_S`` until cancelled, and call ``on_read`` each time, also
        after it is lost.

        A lost input is known within ``LOOK_S``, a release within ``2 LOOK_S`` after its debounce,
        ``operator.DEBOUNCE_S``.
        """
        loop, opened = asyncio.get_running_loop(), None
        try:
            opened = self._connect()
            self.hold.rename(opened.what)
            while True:
                try:
                    self.hold.take_position(opened.share(), loop.time())
                except InputLost as lost:
                    self.hold.lose(str(lost))
                on_read()
                await asyncio.sleep(LOOK_S)
        except Exception as error:  # noqa: BLE001  # after any error it is not known whether it is held
            self.hold.lose(str(error) or type(error).__name__)
        finally:
            if opened is not None:
                opened.close()
        while True:
            on_read()
            await asyncio.sleep(LOOK_S)


def make_hold(config: OperatorConfig, link: CommandLink) -> HoldWatch | None:
    """Make the watch on the hold; None if nothing must be held.

    A device is opened by the watch, a channel comes by ``link``.
    """
    if not config.hold:
        return None
    number = config.channel
    if number is None:
        return HoldWatch(config.hold, config.above, lambda: open_device(config))
    assert isinstance(link, MavlinkLink), "the configuration requires it"
    channel: Input = ChannelInput(link.connection, number)
    return HoldWatch(channel.what, config.above, lambda: channel)


def ensure_held(config: OperatorConfig) -> None:
    """Require the input device, before anything moves.

    Raises:
        ConfigError: by the dotted key, with the devices found.
    """
    if config.hold and config.channel is None:
        open_device(config).close()
