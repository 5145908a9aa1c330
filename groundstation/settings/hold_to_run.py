"""What the operator must hold for the vehicle to fly: a key, an axis, or a channel of the transmitter. Sans-IO."""

import re
from typing import Annotated

import msgspec

_INPUT = re.compile(r"(?:KEY|BTN|ABS)_[A-Z0-9_]+")
_CHANNEL = re.compile(r"rc:([1-9]|1[0-8])")


class OperatorConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The operator's own dead man: let go, or lost, it lands. Config section ``[operator]``."""

    hold: str = ""
    """What is held to fly: a key, button or axis as evtest(1) names it (``BTN_TR``, ``KEY_B``, ``ABS_RZ``), or
    ``rc:1`` to ``rc:18``, a channel of the transmitter as the autopilot hears it (link.kind mavlink). Empty: none."""
    device: str = ""
    """The input device that has it: its path (/dev/input/by-id/…-event-joystick), or a part of its name. Empty: the
    only one that has it."""
    above: Annotated[float, msgspec.Meta(ge=0.2, le=0.95)] = 0.75
    """An axis or a channel is held from this share of its travel on [-], and let go 0.1 below it; a stick that rests in
    the middle is at 0.5, and a channel goes from 1000 to 2000 µs."""
    grab: bool = False
    """Keep what the device sends from everybody else, as for a pedal that types letters. Never for the keyboard in
    use: its Ctrl-C would reach nobody."""

    def ensure_named(self) -> None:
        """Check what the types cannot.

        Raises:
            ValueError: ``hold`` names nothing that can be held.
        """
        if self.hold and not _INPUT.fullmatch(self.hold) and not _CHANNEL.fullmatch(self.hold):
            raise ValueError(
                "operator.hold: expected a key, button or axis as evtest names it, such as BTN_TR, KEY_B or ABS_RZ, or "
                f"rc:1 to rc:18, got {self.hold!r}"
            )

    @property
    def channel(self) -> int | None:
        """The transmitter's channel, from 1 on; None where it is none."""
        found = _CHANNEL.fullmatch(self.hold)
        return None if found is None else int(found[1])
