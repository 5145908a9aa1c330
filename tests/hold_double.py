"""An input device that answers as evdev's does, and a hand on it."""

from collections.abc import Mapping, Sequence

from evdev import AbsInfo, ecodes


class DeviceDouble:
    """The interface of :class:`evdev.InputDevice`: keys and axes are read until it is unplugged."""

    def __init__(self, name: str, path: str, codes: Mapping[int, Sequence[int]]) -> None:
        """``codes`` by kind (EV_KEY, EV_ABS)."""
        self.name = name
        self.path = path
        self.pressed: set[int] = set()
        self.axes: dict[int, int] = {}
        self.unplugged = self.closed = self.grabbed = False
        self._codes = codes

    def capabilities(self, *, absinfo: bool) -> dict[int, list[int]]:
        assert not absinfo
        return {kind: list(codes) for kind, codes in self._codes.items()}

    def active_keys(self) -> list[int]:
        self._ensure_there()
        return sorted(self.pressed)

    def absinfo(self, code: int) -> AbsInfo:
        self._ensure_there()
        return AbsInfo(self.axes.get(code, 0), 0, 255, 0, 0, 0)

    def grab(self) -> None:
        if self.grabbed:
            raise OSError(16, "Device or resource busy")
        self.grabbed = True

    def close(self) -> None:
        self.closed = True

    def _ensure_there(self) -> None:
        if self.unplugged:
            raise OSError(19, "No such device")


def pad(name: str = "Xbox pad", path: str = "/dev/input/event5") -> DeviceDouble:
    """A gamepad with a button at each shoulder, and a trigger."""
    return DeviceDouble(
        name, path, {ecodes.EV_KEY: [ecodes.BTN_TL, ecodes.BTN_TR], ecodes.EV_ABS: [ecodes.ABS_RZ]}
    )


class Hand:
    """An input that a test holds. Implements :class:`groundstation.flight.hold_to_run.Input`."""

    what = "the pedal"

    def __init__(self) -> None:
        self.held = self.closed = False
        self.trouble: Exception | None = None

    def share(self) -> float:
        if self.trouble is not None:
            raise self.trouble
        return 1.0 if self.held else 0.0

    def close(self) -> None:
        self.closed = True
