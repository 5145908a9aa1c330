"""A key or an axis of one of this machine's input devices, by evdev. Linux only.

It is asked how it stands (EVIOCGKEY, EVIOCGABS: what the kernel itself holds), instead of adding up events: none can be
lost on the way, what was held before it was opened is known, a key that repeats is no news, and a device that another
program has grabbed, such as another flight of the same operator, can be asked as well.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from groundstation.config import ConfigError
from groundstation.flight.hold_to_run.hold import InputLost
from groundstation.settings import OperatorConfig

if TYPE_CHECKING:
    from evdev import InputDevice

NAMES_MAX = 24
"""So many keys of a device are listed."""


class DeviceInput:
    """One key or axis. Implements :class:`groundstation.flight.hold_to_run.watch.Input`."""

    def __init__(self, device: "InputDevice[str]", hold: str, code: int) -> None:
        """``code`` is that of linux/input-event-codes.h, ``hold`` its name."""
        self.what = f"{hold} of {_named(device)}"
        self._device = device
        self._code = code
        self._is_axis = hold.startswith("ABS_")

    def share(self) -> float:
        """How far it is pressed: a key 0 or 1, an axis by its range.

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
            raise InputLost(f"an axis from {axis.min} to {axis.max} has no travel")
        return float((axis.value - axis.min) / (axis.max - axis.min))

    def close(self) -> None:
        """Release the device, and what was grabbed of it."""
        self._device.close()


def open_device(config: OperatorConfig) -> DeviceInput:
    """The key or axis that ``config`` names.

    Raises:
        ConfigError: there is none, or more than one; the message lists what is there.
    """
    if sys.platform != "linux":
        raise ConfigError("operator.hold", "keys and axes are asked by evdev, which only Linux has; or hold = 'rc:N'")
    try:
        from evdev import ecodes
    except ImportError:
        raise ConfigError("operator.hold", "needs evdev: pip install 'quadrotor-groundstation[operator]'") from None
    code = ecodes.ecodes.get(config.hold)
    if code is None:
        raise ConfigError("operator.hold", f"no key, button or axis has this name (see evtest), got {config.hold!r}")
    kind = ecodes.EV_ABS if config.hold.startswith("ABS_") else ecodes.EV_KEY
    there = list(_devices(config.device))
    words = "" if config.device.startswith("/") else config.device.lower()
    meant = [device for device in there if words in device.name.lower()]
    fits = [device for device in meant if code in device.capabilities(absinfo=False).get(kind, [])]
    for device in there:
        if len(fits) != 1 or device is not fits[0]:
            device.close()
    if len(fits) == 1:
        if config.grab:
            with suppress(OSError):  # another flight has it already: what matters is that no terminal gets it
                fits[0].grab()
        return DeviceInput(fits[0], config.hold, code)
    if len(fits) > 1:
        several = ", ".join(map(_named, fits))
        raise ConfigError("operator.device", f"more than one has {config.hold}, name one: {several}")
    if len(meant) == 1:
        names = [ecodes.bytype[kind].get(one, one) for one in meant[0].capabilities(absinfo=False).get(kind, [])]
        shown = ", ".join(str(one if isinstance(one, str | int) else one[0]) for one in names[:NAMES_MAX])
        says = f"“{meant[0].name}” has no {config.hold}; of that kind it has {shown or 'nothing'}"
        raise ConfigError("operator.hold", says)
    listed = ", ".join(map(_named, there))
    nothing = "none may be read here: is it plugged in, and are you in the group input?"
    raise ConfigError("operator.device", f"expected a device that has {config.hold}; there are: {listed or nothing}")


def _named(device: "InputDevice[str]") -> str:
    return f"“{device.name}” ({os.fsdecode(device.path)})"


def _devices(path: str) -> "Iterator[InputDevice[str]]":
    """The device at ``path``, or all that may be read.

    Raises:
        ConfigError: there is none at ``path``.
    """
    from evdev import InputDevice, list_devices

    if path.startswith("/"):
        try:
            yield InputDevice(str(Path(path).resolve()), readonly=True)
        except OSError as error:
            hint = ": a joystick's /dev/input/js… is another interface, name its …-event-joystick"
            says = f"{path}: {error.strerror or error}{hint if Path(path).resolve().name.startswith('js') else ''}"
            raise ConfigError("operator.device", says) from None
        return
    for one in sorted(list_devices(writable=False)):
        with suppress(OSError):
            yield InputDevice(one, readonly=True)
