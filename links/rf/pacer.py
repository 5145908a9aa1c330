"""What leaves at each frame instant of a serial RF link: the dead man's switch, the map and the codec. Sans-IO.

Whoever owns the clock calls, for each instant ``due_s``: ``prepare`` a little before, ``leave`` at it, ``tidy`` after.
The port is handed in. It may vanish and come back; what was armed then stays disarmed until a new arming.
"""

import contextlib
import math
from collections import Counter
from typing import Protocol

from links.core import Command, Deadman, Lateness, LinkMisuse, Phase, Segment
from links.rf.codecs import Channels, RfLinkConfig, Service
from links.rf.pacer_messages import Arm, End, Give, Held, Order, Report, Serve, Stop

AFTERLIFE_S = 3.0
"""How long disarm frames still leave after whoever commands has died [s]: a module may repeat its last frame."""
REPORT_S = 0.2
"""Longest time between two reports [s]."""
STALE_S = 0.001
"""A frame that leaves later than this is made anew for the instant at which it leaves [s]."""
REOPEN_S, REOPEN_LIMIT_S = 0.1, 1.6
"""First and longest wait before the port is opened again [s]."""
READ_BYTES = 512
"""Most that is read from the port between two frames; a module that says more says it for nothing."""


class Port(Protocol):
    """A serial port. Nothing here waits; every method raises OSError where the port is gone."""

    def open(self) -> None:
        """Open it."""
        ...

    def write(self, frame: bytes) -> bool:
        """Send one frame; False, with nothing sent, where earlier bytes still wait."""
        ...

    def read(self, limit: int) -> bytes:
        """What has come, at most ``limit`` bytes; the rest is thrown away."""
        ...

    def close(self) -> None:
        """Close it; never raises."""
        ...


class FramePacer:
    """The frames of one link. Times are on the commands' clock [s]."""

    def __init__(self, config: RfLinkConfig, thrust_max_n: float, port: Port, now_s: float) -> None:
        """Disarmed; the port is opened at once, or as soon as it can be."""
        self._config = config
        self._codec = config.codec()
        self._channels = Channels(config.map, count=self._codec.channels, thrust_max_n=thrust_max_n)
        self._decoder = self._codec.decoder()
        self._deadman = Deadman()
        self._lateness = Lateness()
        self._errors: Counter[str] = Counter()
        self._deaf = False
        self._frames = self._lost = self._repeated = self._received = self._arming = 0
        self._says: Command | Segment | None = None
        self._said: Command | Segment | None = None
        self._high_s = self._obey_s = math.inf
        self._service: tuple[Service, float] | None = None
        self._served = 0
        self._slept_s = 0.0
        self._linger_s: float | None = None
        self._quiet_since_s = now_s
        self._frame = b""
        self._due_s = self._made_s = now_s
        self._heir = ""
        self._port = port
        self._why_closed = "not opened yet"
        self._greet = False
        self._tell_s, self._told = now_s, (0, True, False)
        self._reopen_s, self._wait_s = now_s, REOPEN_S
        self._reopen(now_s)

    # ---- what it is told

    def order(self, order: Order, now_s: float) -> None:
        """Obey; what comes too late, or out of place, changes nothing and is counted."""
        match order:
            case Give(arming, command):
                try:
                    if arming == self._arming:
                        seen_s = min(now_s, self._made_s)
                        taken = self._deadman.take(command, now_s, seen_s)
                        self._deaf = self._deaf or not (taken or self._obeys(seen_s))
                except LinkMisuse:
                    self._errors["bad_command"] += 1
            case Arm(number, at_s) if self._deadman.phase(now_s) is Phase.OVER:
                self._arming, self._slept_s, self._deaf = number, 0.0, False
                if self._linger_s is None and not self._why_closed and not self._heir:
                    self._service = None
                    self._high_s = at_s + self._config.arm_low_s
                    self._obey_s = self._high_s + self._config.arm_high_s
                    self._deadman.arm()
            case Stop():
                self._deadman.stop()
            case Serve(service, duration_s):
                if self._deadman.phase(now_s) is Phase.OVER:
                    self._service, self._served = (service, now_s + duration_s), 0
            case End(linger_s):
                self._end(linger_s, now_s)

    def orphaned(self, now_s: float) -> None:
        """Whoever commanded has died: what it left is played to its end, then disarm frames, then nothing."""
        self._end(max(AFTERLIFE_S, self._linger_s or 0.0), now_s)

    def held(self) -> Held:
        """What whoever takes over must know."""
        return Held(self._due_s, self._arming, self._obey_s, self._deadman.command, self._linger_s)

    def inherit(self, held: Held, why: str, now_s: float) -> None:
        """Go on in the place of a pacer that held this: to the end of its newest command and bring-down, and no arming.

        ``why`` says what became of it. The port is the one that it had, open as it was.
        """
        self._heir = f"{why}; its stand-by has taken over and brings down: close the link, and connect it again"
        self._greet = False
        self._arming, self._obey_s, self._linger_s = held.arming, held.obey_s, held.linger_s
        if held.command is not None and now_s >= held.obey_s:
            self._deadman.arm()
            with contextlib.suppress(LinkMisuse):  # it was taken once: here nothing may fail
                self._deadman.take(held.command, min(held.frame_s, held.command.deadline_s))
        self._deadman.hold()
        self._quiet_since_s = now_s

    def slept(self, slept_s: float, now_s: float) -> None:
        """The computer has slept for ``slept_s`` [s]: what was to leave is older by that."""
        self._slept_s += slept_s
        self._deadman.stop()
        self.prepare(now_s)

    def done(self, now_s: float) -> bool:
        """Whether it was told to end and has nothing left to do."""
        if self._linger_s is None or self._deadman.phase(now_s) is not Phase.OVER:
            return False
        return now_s >= self._quiet_since_s + self._linger_s

    # ---- what leaves

    def prepare(self, due_s: float) -> None:
        """Make the frame that leaves at ``due_s``."""
        self._due_s = due_s
        self._frame = self._made(due_s)

    def leave(self, now_s: float) -> None:
        """Let the prepared frame go."""
        if now_s > self._due_s + STALE_S:
            self._frame = self._made(now_s)
        if self._why_closed:
            return
        try:
            left = self._port.write(self._frame)
        except OSError as error:
            self._lose(error, now_s)
            return
        self._greet = False
        if left:
            self._frames += 1
            self._repeated += self._says is not None and self._says is self._said
            self._said = self._says
            self._served += 1
        else:
            self._lost += 1
            self._errors["port_stuck"] += 1

    def measured(self, now_s: float, skipped: int) -> None:
        """The prepared frame was gone at ``now_s``, and after it ``skipped`` instants had passed already."""
        self._lateness.add(now_s - self._due_s)
        self._lost += skipped if not self._why_closed else 0

    def tidy(self, now_s: float) -> None:
        """What there is time for between two frames: hear the module, or look for the port."""
        if self._why_closed:
            if now_s >= self._reopen_s:
                self._reopen(now_s)
            return
        try:
            data = self._port.read(READ_BYTES)
        except OSError as error:
            self._lose(error, now_s)
            return
        if data:
            self._received += len(self._decoder.feed(data))

    def close(self) -> None:
        """Let go of the port."""
        self._deadman.stop()
        self._port.close()
        self._why_closed = "closed"

    def has_news(self, now_s: float) -> bool:
        """Whether a report is due: after each arming, when all is over, and every so often."""
        return now_s >= self._tell_s or self._told != self._stands(now_s)

    def _stands(self, now_s: float) -> tuple[int, bool, bool]:
        """Number of the arming; whether nothing lifts any more; and whether commands of it come that count no more."""
        over = self._deadman.phase(now_s) is Phase.OVER
        return self._arming, over, self._deaf and not over

    def _obeys(self, seen_s: float) -> bool:
        """Whether a command that is fresh could still count, by what was last seen to leave."""
        return not self._deadman.held and self._deadman.phase(seen_s) in (Phase.WAITING, Phase.FRESH)

    def report(
        self, now_s: float, *, note: str = "", fifo: bool = False, alone: bool = False, warning: str = ""
    ) -> Report:
        """The pacer as it is now."""
        self._tell_s, self._told = now_s + REPORT_S, self._stands(now_s)
        arming, over, deaf = self._told
        return Report(
            now_s=now_s,
            frame_s=self._due_s,
            arming=arming,
            over=over,
            frames=self._frames,
            lost=self._lost,
            repeated=self._repeated,
            refused=self._deadman.refused,
            port=self._why_closed,
            received=self._received,
            dropped={**self._errors, **self._decoder.dropped},
            late_us=self._lateness.percentiles_us(),
            late_octaves=tuple(self._lateness.octaves),
            slept_s=self._slept_s,
            note=note,
            fifo=fifo,
            deaf=deaf,
            heir=self._heir,
            alone=alone,
            warning=warning,
        )

    def _made(self, at_s: float) -> bytes:
        self._made_s = at_s
        if self._greet and (greeting := self._codec.greeting()):
            return greeting
        if at_s >= self._obey_s and self._deadman.phase(at_s) is Phase.WAITING:
            self._deadman.stop()  # no command has come all through the arming: it has failed
        what = self._says = self._deadman.at(at_s)
        if what is None:
            idle = self._channels.idle(armed=False)
            if self._deadman.phase(at_s) is not Phase.OVER:
                self._quiet_since_s = at_s
                return self._codec.encode(idle)
            return self._codec.encode(idle, *self._serving(at_s))
        self._quiet_since_s = at_s
        if at_s < self._obey_s:
            if self._deadman.phase(at_s) is not Phase.FRESH:
                self._deadman.stop()  # nothing has lifted yet that would have to be brought down
                return self._codec.encode(self._channels.idle(armed=False))
            return self._codec.encode(self._channels.idle(armed=at_s >= self._high_s))
        return self._codec.encode(self._channels.flying(what.thrust_n, what.rates_rad_s))

    def _serving(self, at_s: float) -> tuple[Service | None, int]:
        if self._service is None or at_s > self._service[1]:
            self._service = None
            return None, 0
        return self._service[0], self._served

    def _end(self, linger_s: float, now_s: float) -> None:
        self._linger_s = linger_s
        self._quiet_since_s = max(self._quiet_since_s, now_s)
        if now_s < self._obey_s:
            self._deadman.stop()
        self._deadman.hold()  # nothing after it but the bring-down of what is held

    def _reopen(self, now_s: float) -> None:
        try:
            self._port.open()
        except OSError as error:
            self._why_closed = error.strerror or str(error)
            self._reopen_s, self._wait_s = now_s + self._wait_s, min(2.0 * self._wait_s, REOPEN_LIMIT_S)
        else:
            self._why_closed = ""
            self._greet = True
            self._wait_s = REOPEN_S
            self._decoder.pause()

    def _lose(self, error: OSError, now_s: float) -> None:
        self._deadman.stop()
        self._port.close()
        self._errors["port_lost"] += 1
        self._why_closed = error.strerror or str(error)
        self._reopen_s = now_s + self._wait_s
