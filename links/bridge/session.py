"""A session of a station with an RF bridge, as either end of it keeps it. Sans-IO."""

from collections import Counter
from typing import Any

import msgspec

from links.bridge.clock_bounds import ClockBounds
from links.bridge.codec import DOWNS, WELCOME, Down, Up, Welcome, first_seal, session_seals
from links.core import Command
from links.rf import Report

REMEMBERED = 256
"""So many datagrams ago may lie the one that an answer is to."""


class BridgeEnd:
    """One station's, as the bridge keeps it."""

    def __init__(self, key: bytes, station_nonce: bytes, bridge_nonce: bytes) -> None:
        """Nothing was heard yet."""
        self.bridge_nonce = bridge_nonce
        self.welcome = first_seal(key, WELCOME, station_nonce)
        self.up, self.down = session_seals(key, station_nonce, bridge_nonce)
        self.clock = ClockBounds()
        self.peer: Any = None
        self.heard_s = 0.0
        self.wants: Up | None = None
        """All but the command, as heard last."""
        self.arming: int | None = None
        """The pacer's number of its newest arming; None where it has not armed."""
        self.ended = False


class StationEnd:
    """The bridge's, as the station keeps it. Times are on the event loop's clock [s]."""

    def __init__(self, key: bytes, welcome: Welcome, now_s: float) -> None:
        """It begins with ``welcome``, which has just come."""
        self._up, self._down = session_seals(key, welcome.station_nonce, welcome.bridge_nonce)
        self._clock = ClockBounds()
        self._sent_s: dict[int, float] = {}
        self._bridge_s = welcome.bridge_s
        self.heard_s = now_s
        """When the bridge was heard last."""
        self.heard = 0
        """Counter of the newest of our datagrams that it has heard."""

    @property
    def sent(self) -> int:
        """Counter of our newest datagram."""
        return self._up.counter

    @property
    def round_trip_s(self) -> float:
        """Of the fastest answer [s]; infinite before the first, when the bridge's times mean nothing yet."""
        return self._clock.width_s

    def close(self, wants: Up, command: Command | None, now_s: float) -> bytes:
        """The next datagram, with all that the station wants, that leaves at ``now_s``."""
        data = self._up.close(
            msgspec.structs.replace(wants, sent_s=now_s, heard_s=self.heard_s, bridge_s=self._bridge_s, command=command)
        )
        self._sent_s[self._up.counter] = now_s
        self._sent_s.pop(self._up.counter - REMEMBERED, None)
        return data

    def open(self, data: bytes, dropped: "Counter[str]", now_s: float) -> Down | None:
        """What the bridge says; None where a datagram is not of this session or not sound, counted by reason."""
        down = self._down.open(data, DOWNS, dropped)
        if down is None:
            return None
        self.heard_s, self._bridge_s = now_s, down.bridge_s
        self.heard = max(self.heard, down.heard)
        sent_s = self._sent_s.get(down.heard)
        if sent_s is not None:
            self._clock.narrow(sent_s - down.bridge_s, now_s - down.bridge_s, now_s)
        return down

    def ours(self, report: Report) -> Report:
        """``report`` by this machine's clock."""
        shift = self._clock.middle_s
        return msgspec.structs.replace(report, now_s=report.now_s + shift, frame_s=report.frame_s + shift)
