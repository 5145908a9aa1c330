"""What left the ground station, judged by its bytes: every number finite, nothing past its deadline.

Each frame is held against the commands that the controller made: it must be the newest of them (or the one before, in
the instant in which the newest is made) before its deadline, or the part of its bring-down whose time it is.
"""

import math
import struct
from collections import deque

from groundstation.recording import IdleRecord, Record, TickRecord
from groundstation.settings import Config
from links.core import Command, Segment, signal
from links.mavlink import MavlinkLinkConfig
from links.rf import Channels, RfLinkConfig
from sim.radio import MODULE
from sim.time import Address
from tests.proving.faults.judge.thrust import LIFTS, Thrust

SET_POINT = b"\x52\x00\x00"
"""SET_ATTITUDE_TARGET, in bytes 7 to 9 of a MAVLink 2 frame."""
PAYLOAD = 10
LONGEST_BYTES = 60
AGREES = 2e-6
"""32-bit floats agree so well with what they were made of [-]."""
INSTANT_S = 2e-6
"""Timers fire up to a clock's tick early or late [s]."""


def set_point(data: bytes) -> tuple[float, float, float, float] | None:
    """Thrust as a share and body rates [rad/s] in a frame; None where it is no set-point."""
    if data[7:10] != SET_POINT:
        return None
    p, q, r, thrust = struct.unpack_from("<4f", data.ljust(LONGEST_BYTES, b"\0"), PAYLOAD + 20)
    return thrust, p, q, r


class Wire:
    """The frames of one flight."""

    def __init__(self, config: Config, thrust: Thrust) -> None:
        """``config`` says how the commands leave; ``thrust`` hears what each pushes with."""
        self.wrong = ""
        """The first thing that must not have left; empty where there is none."""
        self.last_s = -math.inf
        """When anything last left."""
        self._config = config
        self._thrust = thrust
        self._commands: deque[Command] = deque(maxlen=4)
        self._port = None
        self._sticks: tuple[Channels, float] | None = None
        link = config.link
        if isinstance(link, MavlinkLinkConfig):
            self._port = int(link.address.rpartition(":")[2])
        elif isinstance(link, RfLinkConfig):
            codec = link.codec()
            self._decoder = codec.decoder()
            channels = Channels(link.with_thrust_curve(0.0).map, count=codec.channels, thrust_max_n=1.0)
            self._sticks = channels, link.lead_s + link.period_s

    def record(self, record: Record) -> None:
        """Take what the flight hands to its recorder."""
        if isinstance(record, TickRecord):
            self._commands.append(record.tick.command)
        elif isinstance(record, IdleRecord):
            self._commands.append(record.command)

    def tap(self, time_s: float, source: Address, target: Address, data: bytes) -> None:
        """Take one datagram of the simulated network."""
        if source[1] == self._port:
            self.last_s = time_s
            told = set_point(data)
            if told is not None:
                self._frame(time_s, *told)
        elif self._sticks is not None and target == MODULE:
            self._radio(time_s, data)

    def _frame(self, time_s: float, thrust: float, p: float, q: float, r: float) -> None:
        if not math.isfinite(thrust + p + q + r):
            self._say(f"a number that is not finite left at {time_s:.3f} s")
        self._thrust.told(time_s, thrust)
        # At the very border of two parts either may be meant.
        borders = (time_s - INSTANT_S, time_s + INSTANT_S)
        for due in {_due(command, at_s) for command in self._commands for at_s in borders}:
            if due is None:
                continue
            share = signal(due.thrust_n / self._config.full_thrust_n, self._config.thrust_curve)
            if all(abs(a - b) < AGREES for a, b in zip((thrust, p, q, r), (share, *due.rates_rad_s), strict=True)):
                return
        if thrust > LIFTS:
            self._say(f"a command left at {time_s:.3f} s that was not due then")

    def _radio(self, time_s: float, data: bytes) -> None:
        assert self._sticks is not None, "only a radio's frames come here"
        channels, lead_s = self._sticks
        for heard in self._decoder.feed(data):
            self.last_s = time_s
            if heard.positions is None:
                continue
            sticks = channels.read(heard.positions)
            self._thrust.told(time_s, sticks.thrust_n if sticks.armed else 0.0)
            lifts = sticks.armed and sticks.thrust_n > LIFTS
            if lifts and not any(_due(command, time_s - lead_s) for command in self._commands):
                self._say(f"a frame that lifts left at {time_s:.3f} s, and no command was due then")

    def _say(self, wrong: str) -> None:
        self.wrong = self.wrong or wrong


def _due(command: Command, time_s: float) -> Command | Segment | None:
    """What of ``command`` may leave at ``time_s`` [s], where no other came."""
    end = command.deadline_s
    if time_s <= end:
        return command
    for part in command.bring_down:
        end += part.duration_s
        if time_s <= end:
            return part
    return None
