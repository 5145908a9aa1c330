"""Frame pacer: frames of a serial RF link by the dead man's switch, map and codec. Sans-IO.

Whoever owns the clock calls, for each instant ``due_s``: ``prepare`` a little before, ``leave`` at
it, ``tidy`` after. The port is handed in. It may vanish and come back; what was armed then stays
disarmed until a new arming.

First come the messages between a link and its pacer, last the watch by which a stand-by tells that
its pacer stands still.
"""

import contextlib
import math
from collections import Counter
from collections.abc import Awaitable, Callable
from typing import Any, Protocol, TypeAlias

import msgspec

from links.core import (
    LOOK_S,
    STALL_S,
    STUCK_S,
    Command,
    Deadman,
    Lateness,
    LinkMisuse,
    Phase,
    Segment,
)
from links.rf.channel_map import Channels
from links.rf.codec import Manner, RfLinkConfig, RfTelemetry, Service
from links.rf.module_codec import RfConfig
from links.text import link_notice

MESSAGE_BYTES = 65536
"""Longest message between a link and its pacer [bytes]."""


class PacerSetup(msgspec.Struct, frozen=True):
    """First message to a pacer."""

    config: RfConfig
    thrust_max_n: float
    """[N]"""


class Arm(msgspec.Struct, frozen=True, tag="arm"):
    """A new arming by the operator."""

    number: int
    """Number of this arming, 1 for the first."""
    at_s: float
    """When it began [s]."""


class Give(msgspec.Struct, frozen=True, tag="give", gc=False):
    """The newest command. It goes a way of its own and may overtake the other orders."""

    arming: int
    """Number of the arming that it belongs to; under any other it is nothing."""
    command: Command


class Stop(msgspec.Struct, frozen=True, tag="stop"):
    """Disarm frames from the next frame on, until a new arming."""


class Serve(msgspec.Struct, frozen=True, tag="serve"):
    """Bind, or check the range, for a while; ignored unless disarmed."""

    service: Service
    duration_s: float
    """[s]"""


class End(msgspec.Struct, frozen=True, tag="end"):
    """End after the newest command, its bring-down, and ``linger_s`` [s] of disarm frames."""

    linger_s: float


Order: TypeAlias = Arm | Give | Stop | Serve | End


class Held(msgspec.Struct, frozen=True, gc=False):
    """State of a pacer as a frame leaves, for the stand-by that takes over.

    Times are on the commands' clock [s].
    """

    frame_s: float
    """When that frame leaves."""
    arming: int
    """Number of the newest arming."""
    obey_s: float
    """When that arming is over, and commands leave; infinite before the first."""
    command: Command | None
    """The newest, while it or its bring-down may leave."""
    linger_s: float | None
    """Linger time of the received :class:`End` [s]; None before."""


class PacerReport(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The pacer as it is now; times are on CLOCK_MONOTONIC in real time [s]."""

    now_s: float
    """When this was written."""
    frame_s: float
    """When some frame left or will leave: the others are whole periods away."""
    arming: int
    """Number of the newest arming that it knows."""
    over: bool
    """Whether nothing that lifts leaves any more."""
    frames: int
    """Frames that left."""
    lost: int
    """Frames that were late or did not leave at all while the port was open."""
    repeated: int
    """Frames that repeated a command, as no newer one had come in time."""
    refused: int
    """Commands that came too late or out of order."""
    port: str
    """Why the port can't be used; empty where it can."""
    received: int
    """Frames that came back from the module."""
    dropped: dict[str, int]
    """Number of dropped or failed frames by reason."""
    late_us: tuple[int, int, int]
    """Lateness of the frames, 50, 99 and 99.9 % [µs]."""
    late_octaves: tuple[int, ...]
    """Frames by lateness: entry k counts those late by 2**(k-1) µs to less than 2**k µs."""
    slept_s: float
    """Sleep of the pacer's computer since the newest arming [s]: nothing that lifts leaves."""
    note: str
    """Scheduling of the pacer, in words."""
    fifo: bool
    """Whether it runs with real-time priority."""
    deaf: bool = False
    """Whether commands of this arming have come in vain, and will: what it holds is played to its
    end, bring-down and all."""
    heir: str = ""
    """Fate of the pacer, where its stand-by sends the frames; empty where it does so itself."""
    alone: bool = False
    """Whether the pacer's stand-by has ended before it: nobody would let frames go in its place."""
    warning: str = ""
    """Problem of the pacing, in words; empty without one."""
    telemetry: RfTelemetry = RfTelemetry()
    """Recent telemetry through the module."""


class Pacer(Protocol):
    """The pacer as the link sees it: in another process, in the same loop, or behind a network."""

    @property
    def manner(self) -> Manner:
        """Pacing of this pacer."""

    @property
    def why_mute(self) -> str:
        """Meaning of missing reports, for the operator."""

    def give(self, order: Order) -> bool:
        """Hand over ``order`` without waiting; False where nobody takes it."""

    async def wait_for_end(self) -> None:
        """Wait until it has ended."""

    def forget(self) -> None:
        """Let go of it; it ends by itself as after :class:`End`, should it still live."""


Hear: TypeAlias = Callable[[PacerReport | None], None]
"""Takes each report, and None at the pacer's end."""

OpenPacer: TypeAlias = Callable[[RfLinkConfig, float, Hear], Awaitable[Pacer]]
"""Start a pacer for a configuration and a full thrust [N]; its reports go to the callable, and None
at its end."""


AFTERLIFE_S = 3.0
"""Duration of disarm frames after the commander's death [s]: a module may repeat its last frame."""
REPORT_S = 0.2
"""Longest time between two reports [s]."""
STALE_S = 0.001
"""A frame that leaves later than this is made anew for the instant at which it leaves [s]."""
REOPEN_S = 0.1
"""Wait before a port is opened again [s]: no frames leave meanwhile."""
TELEMETRY_MAX_AGE_S = 5.0
"""Age after which a module's telemetry is dropped [s]."""
ATTITUDE_LATENCY_S = 0.05
"""Age of an attitude when the module reports it [s]: it waits for a slot of the radio. The
comparison with poses tries 0.1 s either way (groundstation/core/health/witness.py)."""
STEER = 0.02
"""Largest shift of a frame, as a share of the period, where the module asks for it [-]."""
READ_BYTES = 512
"""Limit of the bytes read from the port between two frames [-]; more are discarded."""


class Port(Protocol):
    """A serial port. Nothing here waits; every method raises OSError where the port is gone."""

    def open(self) -> None:
        """Open it."""

    def write(self, frame: bytes) -> bool:
        """Send one frame; False, with nothing sent, where earlier bytes still wait."""

    def read(self, limit: int) -> bytes:
        """Return received bytes, at most ``limit`` bytes; the rest is thrown away."""

    def close(self) -> None:
        """Close it; never raises."""


class ArmingWindow(msgspec.Struct, gc=False):
    """The newest arming: when it is over, and what has gone wrong since."""

    number: int = 0
    """0 before the first."""
    high_s: float = math.inf
    """Time from which on the arm channel is up [s]."""
    obey_s: float = math.inf
    """Time from which on commands leave [s]."""
    slept_s: float = 0.0
    """Sleep of the computer since [s]."""
    deaf: bool = False
    """Whether commands have come that could not count any more."""


class ServiceTurn(msgspec.Struct, gc=False):
    """A service of the module, which every disarm frame asks for until it is over."""

    service: Service
    until_s: float
    frames: int = 0
    """Frames that left since it began."""


class FrameCounts(msgspec.Struct):
    """Numbers of frames; see :class:`PacerReport`."""

    frames: int = 0
    lost: int = 0
    repeated: int = 0
    errors: Counter[str] = msgspec.field(default_factory=Counter)


class KeptPort:
    """A port that is opened again, every ``REOPEN_S``, whenever it was lost."""

    def __init__(self, port: Port, now_s: float) -> None:
        """Keep ``port``, which is not open yet."""
        self.port = port
        self.why_closed = "not opened yet"
        """Why it can't be used; empty where it can."""
        self._why_stuck = ""
        self._stuck_since_s = math.inf
        self.fresh = False
        """True from its opening until the first frame has left."""
        self._reopen_s = now_s

    @property
    def why_silent(self) -> str:
        """Why nothing leaves: it can't be used, or takes nothing; empty where frames do."""
        return self.why_closed or self._why_stuck

    def reopen(self, now_s: float) -> bool:
        """Open it where that is due; whether it was opened."""
        if now_s < self._reopen_s:
            return False
        try:
            self.port.open()
        except OSError as error:
            self.why_closed = error.strerror or str(error)
            self._reopen_s = now_s + REOPEN_S
            return False
        self.why_closed, self.fresh = "", True
        self._unstick()
        return True

    def write(self, frame: bytes, now_s: float) -> bool:
        """Send one frame; False, with nothing sent, where earlier bytes still wait.

        Raises:
            OSError: the port is gone.
        """
        left = self.port.write(frame)
        self.fresh = False
        if left:
            self._unstick()
        else:
            self._stuck_since_s = min(self._stuck_since_s, now_s)
            if now_s - self._stuck_since_s > STUCK_S:
                self._why_stuck = link_notice("module.port_stuck").text
        return left

    def _unstick(self) -> None:
        self._why_stuck, self._stuck_since_s = "", math.inf

    def lose(self, error: OSError, now_s: float) -> None:
        """Close the port, which is gone, and wait before it is opened again."""
        self.close(link_notice("module.port_gone", why=error.strerror or error).text)
        self._reopen_s = now_s + REOPEN_S

    def close(self, why: str) -> None:
        """Let go of it."""
        self.port.close()
        self.why_closed = why


class Downlink:
    """Telemetry of the module, and the phase of the frames that it asks for."""

    def __init__(self, config: RfLinkConfig) -> None:
        """Nothing has come."""
        self.decoder = config.codec().decoder()
        self.received = 0
        """Frames that came back."""
        self._period_s = config.period_s
        self._newest: dict[str, tuple[float, Any]] = {}
        """Newest telemetry by name, with its time."""
        self._early_s = 0.0
        """Remaining shift towards the module's own timing [s]."""

    def hear(self, data: bytes, now_s: float) -> bool:
        """Take received bytes; whether they told an attitude."""
        attitude = False
        for heard in self.decoder.feed(data):
            self.received += 1
            if heard.tells is not None:
                told = msgspec.structs.asdict(heard.tells)
                self._newest |= {
                    name: (now_s, value) for name, value in told.items() if value is not None
                }
                attitude = attitude or heard.tells.attitude is not None
                if heard.tells.early_s is not None:
                    self._early_s = math.remainder(heard.tells.early_s, self._period_s)
        return attitude

    def steer(self) -> float:
        """Return the shift of the next frame [s], and count it as done."""
        most = STEER * self._period_s
        shift = min(max(self._early_s, -most), most)
        self._early_s -= shift
        return shift

    def collect(self, now_s: float) -> RfTelemetry:
        """Recent telemetry."""
        told = {
            name: value
            for name, (at_s, value) in self._newest.items()
            if now_s - at_s < TELEMETRY_MAX_AGE_S
        }
        if "attitude" in told:
            told["attitude_s"] = self._newest["attitude"][0] - ATTITUDE_LATENCY_S
        return RfTelemetry(**told)


class FramePacer:
    """The frames of one link. Times are on the commands' clock [s]."""

    def __init__(self, config: RfLinkConfig, thrust_max_n: float, port: Port, now_s: float) -> None:
        """Disarmed; the port is opened at once, or as soon as it can be."""
        self._config = config
        self._codec = config.codec()
        self._channels = Channels(config.map, count=self._codec.channels, thrust_max_n=thrust_max_n)
        self._downlink = Downlink(config)
        self._deadman = Deadman()
        self._arming = ArmingWindow()
        self._counts, self._lateness = FrameCounts(), Lateness()
        self._says: Command | Segment | None = None
        self._said: Command | Segment | None = None
        self._service: ServiceTurn | None = None
        self._linger_s: float | None = None
        self._quiet_since_s = now_s
        self._frame = b""
        self._due_s = self._made_s = now_s
        self._heir = ""
        self._tell_s, self._told = now_s, (0, True, False, False)
        self._port = KeptPort(port, now_s)
        self._reopen(now_s)

    # ---- what it is told

    def order(self, order: Order, now_s: float) -> None:
        """Obey.

        A late command is counted as refused, an invalid one as bad; an order out of place changes
        nothing.
        """
        match order:
            case Give(arming, command):
                try:
                    if arming == self._arming.number:
                        seen_s = min(now_s, self._made_s)
                        taken = self._deadman.take(command, now_s, seen_s)
                        self._arming.deaf = self._arming.deaf or not (taken or self._obeys(seen_s))
                except LinkMisuse:
                    self._counts.errors["bad_command"] += 1
            case Arm(number, at_s) if self._deadman.phase(now_s) is Phase.OVER:
                window = self._arming
                window.number, window.slept_s, window.deaf = number, 0.0, False
                if self._linger_s is None and not self._port.why_closed and not self._heir:
                    self._service = None
                    window.high_s = at_s + self._config.arm_low_s
                    window.obey_s = window.high_s + self._config.arm_high_s
                    self._deadman.arm()
            case Stop():
                self._deadman.stop()
            case Serve(service, duration_s):
                if self._deadman.phase(now_s) is Phase.OVER:
                    self._service = ServiceTurn(service, now_s + duration_s)
            case End(linger_s):
                self._end(linger_s, now_s)

    def outlive_commander(self, now_s: float) -> None:
        """Play what a dead commander left to its end, then disarm frames, then nothing."""
        self._end(max(AFTERLIFE_S, self._linger_s or 0.0), now_s)

    def make_estate(self) -> Held:
        """Return the state that a stand-by needs to take over."""
        arming = self._arming
        return Held(
            self._due_s, arming.number, arming.obey_s, self._deadman.command, self._linger_s
        )

    def inherit(self, held: Held, why: str, now_s: float) -> None:
        """Go on in the place of a pacer that held this: to the end of its newest command and
        bring-down, and no arming.

        ``why`` says what became of it. The port is the one that it had, open as it was.
        """
        self._heir = link_notice("module.heir", why=why).text
        self._port.fresh = False
        self._arming.number = held.arming
        self._arming.obey_s = held.obey_s
        self._linger_s = held.linger_s
        if held.command is not None and now_s >= held.obey_s:
            self._deadman.arm()
            with contextlib.suppress(LinkMisuse):  # it was taken once: here nothing may fail
                self._deadman.take(held.command, min(held.frame_s, held.command.deadline_s))
        self._deadman.hold()
        self._quiet_since_s = now_s

    def note_sleep(self, slept_s: float, now_s: float) -> None:
        """The computer has slept for ``slept_s`` [s]: what was to leave is older by that."""
        self._arming.slept_s += slept_s
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
        self._frame = self._make_frame(due_s)

    def leave(self, now_s: float) -> None:
        """Let the prepared frame go."""
        if now_s > self._due_s + STALE_S:
            self._frame = self._make_frame(now_s)
        kept, counts = self._port, self._counts
        if kept.why_closed:
            return
        try:
            left = kept.write(self._frame, now_s)
        except OSError as error:
            self._lose(error, now_s)
            return
        if left:
            counts.frames += 1
            counts.repeated += self._says is not None and self._says is self._said
            self._said = self._says
            if self._service is not None:
                self._service.frames += 1
        else:
            counts.lost += 1
            counts.errors["port_stuck"] += 1

    def count_frame(self, now_s: float, skipped: int) -> None:
        """The prepared frame was gone at ``now_s`` [s], ``skipped`` instants too late."""
        self._lateness.add(now_s - self._due_s)
        self._counts.lost += skipped if not self._port.why_closed else 0

    def tidy(self, now_s: float) -> None:
        """Use the time between two frames: hear the module, or look for the port."""
        if self._port.why_closed:
            self._reopen(now_s)
            return
        try:
            data = self._port.port.read(READ_BYTES)
        except OSError as error:
            self._lose(error, now_s)
            return
        if data and self._downlink.hear(data, now_s):
            self._tell_s = now_s

    def steer(self) -> float:
        """Return the shift of the next frame [s] towards the module's own timing.

        It moves the phase only.

        No deadline moves: what a frame says is decided for the instant at which it leaves.
        """
        return self._downlink.steer()

    def close(self) -> None:
        """Let go of the port."""
        self._deadman.stop()
        self._port.close("closed")

    def has_news(self, now_s: float) -> bool:
        """Whether a report is due: after each arming, when all is over, and every so often."""
        return now_s >= self._tell_s or self._told != self._stands(now_s)

    def _stands(self, now_s: float) -> tuple[int, bool, bool, bool]:
        """Number of the arming.

        Whether nothing lifts any more; whether commands of it come that count no more; and whether
        the port takes nothing.
        """
        over, deaf = self._deadman.phase(now_s) is Phase.OVER, self._arming.deaf
        return self._arming.number, over, deaf and not over, bool(self._port.why_silent)

    def _obeys(self, seen_s: float) -> bool:
        """Whether a command that is fresh could still count, by what was last seen to leave."""
        return not self._deadman.held and self._deadman.phase(seen_s) in (
            Phase.WAITING,
            Phase.FRESH,
        )

    def report(
        self,
        now_s: float,
        *,
        note: str = "",
        fifo: bool = False,
        alone: bool = False,
        warning: str = "",
    ) -> PacerReport:
        """The pacer as it is now."""
        self._tell_s, self._told = now_s + REPORT_S, self._stands(now_s)
        arming, over, deaf, _ = self._told
        counts, downlink = self._counts, self._downlink
        return PacerReport(
            now_s=now_s,
            frame_s=self._due_s,
            arming=arming,
            over=over,
            frames=counts.frames,
            lost=counts.lost,
            repeated=counts.repeated,
            refused=self._deadman.refused,
            port=self._port.why_silent,
            received=downlink.received,
            dropped={**counts.errors, **downlink.decoder.dropped},
            late_us=self._lateness.percentiles_us(),
            late_octaves=tuple(self._lateness.octaves),
            slept_s=self._arming.slept_s,
            note=note,
            fifo=fifo,
            deaf=deaf,
            heir=self._heir,
            alone=alone,
            warning=warning,
            telemetry=downlink.collect(now_s),
        )

    def _make_frame(self, at_s: float) -> bytes:
        self._made_s = at_s
        if self._port.fresh and (greeting := self._codec.greeting()):
            return greeting
        if at_s >= self._arming.obey_s and self._deadman.phase(at_s) is Phase.WAITING:
            self._deadman.stop()  # no command has come all through the arming: it has failed
        what = self._says = self._deadman.at(at_s)
        if what is None:
            idle = self._channels.idle(armed=False)
            if self._deadman.phase(at_s) is not Phase.OVER:
                self._quiet_since_s = at_s
                return self._codec.encode(idle)
            return self._codec.encode(idle, *self._serving(at_s))
        self._quiet_since_s = at_s
        if at_s < self._arming.obey_s:
            if self._deadman.phase(at_s) is not Phase.FRESH:
                self._deadman.stop()  # nothing has lifted yet that would have to be brought down
                return self._codec.encode(self._channels.idle(armed=False))
            return self._codec.encode(self._channels.idle(armed=at_s >= self._arming.high_s))
        return self._codec.encode(self._channels.flying(what.thrust_n, what.rates_rad_s))

    def _serving(self, at_s: float) -> tuple[Service | None, int]:
        if self._service is None or at_s > self._service.until_s:
            self._service = None
            return None, 0
        return self._service.service, self._service.frames

    def _end(self, linger_s: float, now_s: float) -> None:
        self._linger_s = linger_s
        self._quiet_since_s = max(self._quiet_since_s, now_s)
        if now_s < self._arming.obey_s:
            self._deadman.stop()
        self._deadman.hold()  # nothing after it but the bring-down of what is held

    def _reopen(self, now_s: float) -> None:
        if self._port.reopen(now_s):
            self._downlink.decoder.pause()

    def _lose(self, error: OSError, now_s: float) -> None:
        self._deadman.stop()
        self._port.lose(error, now_s)
        self._counts.errors["port_lost"] += 1


class StandbyWatch:
    """Two looks in time, :data:`LOOK_S` apart, must find the sign of life too old.

    That is older than a stall, and than one and a half frame periods. A look that is late by half
    the time between two is ignored: the watcher itself may have been suspended.
    """

    def __init__(self, period_s: float) -> None:
        """The sign comes every ``period_s`` [s]."""
        self._old_s = max(STALL_S, 1.5 * period_s)
        self.wait_s = self._old_s + 0.5 * period_s
        """Time from a sign of life to the next look [s]: half a period after it is too old."""
        self._suspects = False
        self.next_s = 0.0
        """When to look next."""

    def look(self, now_s: float, vouched_s: float) -> bool:
        """Look at ``now_s`` at a sign of life that was good at ``vouched_s``.

        Whether the pacer stands still.
        """
        late = now_s > self.next_s + 0.5 * LOOK_S
        old = vouched_s > 0.0 and now_s - vouched_s >= self._old_s
        convicted = old and not late and self._suspects
        self._suspects = old and not late
        fresh = vouched_s > 0.0 and not old and not late
        # A pacer may vouch in advance for what takes long, and then be done with it earlier.
        self.next_s = min(vouched_s, now_s) + self.wait_s if fresh else now_s + LOOK_S
        return convicted
