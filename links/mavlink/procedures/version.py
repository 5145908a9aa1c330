"""Which firmware an autopilot runs, in its own words (AUTOPILOT_VERSION). Sans-IO.

Source: mavlink.io/en/messages/common.html (148 AUTOPILOT_VERSION, MAV_CMD_REQUEST_MESSAGE); the four bytes of
flight_sw_version are major, minor, patch and FIRMWARE_VERSION_TYPE, as PX4 and ArduPilot fill it in.
"""

from links.core import LinkError
from links.mavlink.procedures.command import ACCEPTED
from links.mavlink.procedures.steps import ANSWER_S, Autopilot
from links.mavlink.protocol import REQUEST_MESSAGE, Message

ASKED = 3
"""An autopilot that does not tell after so many questions keeps it to itself."""
KINDS = {0: "dev", 64: "alpha", 128: "beta", 192: "rc", 255: "release"}
"""FIRMWARE_VERSION_TYPE."""


class ReadVersion:
    """Ask for the firmware's version; one that it does not tell is no failure."""

    failure: LinkError | None = None

    def __init__(self, autopilot: Autopilot) -> None:
        """What it told is in ``firmware`` when done."""
        self.done = False
        self.firmware = ""
        """Such as ``PX4 1.16.0 release 0a1b2c3d4e5f6071``; empty where it does not tell."""
        self._autopilot = autopilot
        self._asked = 0
        self._next_s = 0.0

    def poll(self, now_s: float) -> list[bytes]:
        """The question, where it is due."""
        if self.done or now_s < self._next_s:
            return []
        if self._asked == ASKED:
            self.done = True
            return []
        self._asked += 1
        self._next_s = now_s + ANSWER_S
        codec, system, component = self._autopilot.codec, self._autopilot.system, self._autopilot.component
        number = float(codec.message_number("AUTOPILOT_VERSION"))
        return [codec.command(system, component, REQUEST_MESSAGE, number, confirmation=self._asked - 1)]

    def hear(self, message: Message, now_s: float) -> None:
        """Take the version, or the answer that there is none."""
        name = message.get_type()
        if name == "AUTOPILOT_VERSION":
            self.firmware = f"{self._autopilot.name} {version(message)}"
            self.done = True
        elif name == "COMMAND_ACK" and message.command == REQUEST_MESSAGE and message.result != ACCEPTED:
            self.done = True


def version(message: Message) -> str:
    """The version that an AUTOPILOT_VERSION tells: number, kind, and the first bytes of the commit as they are."""
    number = int(message.flight_sw_version)
    major, minor, patch, kind = number >> 24 & 0xFF, number >> 16 & 0xFF, number >> 8 & 0xFF, number & 0xFF
    commit = bytes(message.flight_custom_version).hex()
    return f"{major}.{minor}.{patch} {KINDS.get(kind, kind)} {commit}"
