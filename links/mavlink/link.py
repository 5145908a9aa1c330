"""MAVLink link: thrust and body rates to PX4 or ArduPilot over UDP, TCP or a serial port.

Commands that the dead man's switch allows are sent on timers of the event loop, not in a task: a
controller that raised, waits for ever, was cancelled or no longer ticks has no effect on them. A
process that stood still finds that by the clock, and asks the switch again. Two requests wait for
no other: the landing of a vehicle that nobody steers, and motors off.
"""

import asyncio
import contextlib
from collections.abc import Callable
from typing import Self

import msgspec

from links.core import (
    LOOK_S,
    STALL_S,
    TICK_S,
    Arrival,
    Attitude,
    Command,
    Deadman,
    LinkError,
    LinkLost,
    LinkMisuse,
    LinkRejected,
    LinkStatus,
    Phase,
    Segment,
    signal,
)
from links.io import Sleep
from links.mavlink.connection import MavlinkConnection
from links.mavlink.protocol import (
    ARDUPILOT,
    ATTITUDE_HZ,
    ATTITUDES,
    QUESTION_S,
    SLOW_BAUD,
    SLOW_HZ,
    SLOW_QUESTION_S,
    STALE_HEARTBEAT_S,
    AskMode,
    AutopilotAddress,
    Handshake,
    HandshakeStep,
    Kill,
    MavCommand,
    MavlinkLinkConfig,
    Message,
    ReadVersion,
    Uplink,
    Vitals,
    attitude_of,
    make_arming,
    make_checks,
    make_disarming,
    make_landing,
    make_landing_disarmed,
)
from links.text import link_notice

REPEAT_AFTER = 2.0
"""Periods after which a command is first repeated [-]: before, the next one may just be late."""


class Transmitter:
    """Timer of one link, which sends what the dead man's switch allows.

    Times are on the event loop's clock [s].
    """

    def __init__(
        self,
        deadman: Deadman,
        period_s: float,
        send: Callable[[Command | Segment, float], None],
        count_read: Callable[[], int] = lambda: 0,
    ) -> None:
        """``send(what, now_s)`` puts a command on the wire.

        ``count_read()`` returns the number of reads from the wire so far.
        """
        self._count_read = count_read
        self._read: int | None = None
        self._deadman = deadman
        self._period = period_s
        self._send = send
        self._timer: asyncio.TimerHandle | None = None
        self._due_s = 0.0
        self._loop: asyncio.AbstractEventLoop | None = None
        self._silent = asyncio.Event()
        self._silent.set()

    def start(self) -> None:
        """Let commands count, and send them, from now on: the operator has armed."""
        self._deadman.arm()
        self._loop = asyncio.get_running_loop()
        self._silent.clear()
        self._due_s = self._loop.time() + self._period
        self._schedule()

    def stop(self) -> None:
        """Let nothing that lifts leave from now on: killed, disarmed, or closed."""
        self._deadman.stop()
        self._end()

    def note_sent(self, now_s: float) -> None:
        """Note that a command has just left."""
        self._due_s = self._find_due_s(now_s, REPEAT_AFTER * self._period)
        if self._timer is None:
            self._schedule()

    async def silent(self) -> None:
        """Return once nothing that lifts may leave any more without a new arming."""
        await self._silent.wait()

    def _find_due_s(self, now_s: float, wait_s: float) -> float:
        return min(now_s + wait_s, self._deadman.changes_s(now_s) + TICK_S)

    def _schedule(self) -> None:
        if self._loop is not None:
            if self._timer is not None:
                self._timer.cancel()
            self._timer = self._loop.call_at(self._due_s, self._send_due)

    def _send_due(self) -> None:
        self._timer = None
        if self._loop is None:
            return
        now = self._loop.time()
        if now < self._due_s - TICK_S:  # a newer command has moved it
            self._schedule()
            return
        if now > self._due_s + STALL_S and self._read != (read := self._count_read()):
            # The program stood still: what waits to be read comes first, as it may say that the
            # vehicle is another's.
            self._read, self._timer = read, self._loop.call_later(0.0, self._send_due)
            return
        self._read = None
        leaves = self._deadman.at(now)
        if self._deadman.phase(now) is Phase.OVER:
            self._end()
            return
        self._due_s = self._find_due_s(now, self._period)
        self._schedule()  # before anything that may raise
        if leaves is not None:
            with contextlib.suppress(Exception):  # whatever it is, the next turn must come
                self._send(leaves, now)

    def _end(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        self._silent.set()


async def run_step(connection: MavlinkConnection, step: HandshakeStep) -> None:
    """Run ``step`` without waiting for hand-shakes that are under way.

    Raises:
        LinkError: it failed.
    """
    loop = asyncio.get_running_loop()
    unsubscribe = connection.subscribe(step.take_message)
    try:
        while True:
            for frame in step.poll(loop.time()):
                connection.send(frame)
            if step.failure is not None:
                raise step.failure
            if step.done:
                return
            await asyncio.sleep(LOOK_S)
    finally:
        unsubscribe()


__all__ = ["MavlinkLink", "MavlinkLinkConfig"]


class ArmedSpan(msgspec.Struct, gc=False):
    """State of one arming."""

    sleep: Sleep | None = None
    """Counter of this computer's sleep since the arming."""
    obeys_s: float | None = None
    """Instant since which the autopilot follows us [s]; None before, and once it no longer does."""
    taken: str = ""
    """Sender that has taken the vehicle over, in words; empty where none has."""
    lands_by_itself: bool = False
    """Whether LAND was accepted."""

    @property
    def slept_s(self) -> float:
        """Sleep of this computer since the arming [s]."""
        return 0.0 if self.sleep is None else self.sleep.slept_s


class Examination(msgspec.Struct, frozen=True):
    """Answers of the autopilot before it is armed, in words."""

    firmware: str = ""
    unfit: str = ""
    """Why it may not be armed as it is set up; empty where it may."""


class MavlinkLink:
    """Implements :class:`links.core.deadman.CommandLink` (see there).

    Others may read along on ``connection``.
    """

    def __init__(
        self, config: MavlinkLinkConfig, *, thrust_max_n: float, thrust_curve: float = 0.0
    ) -> None:
        """Nothing is opened yet; ``thrust_max_n`` is the thrust of the full signal [N].

        ``thrust_curve`` is the vehicle's, see :func:`links.core.deadman.signal`; one in ``config``
        takes its place.
        """
        self._config = config
        self._thrust_max = thrust_max_n
        self._curve = thrust_curve if config.thrust_curve is None else config.thrust_curve
        self._target = (config.target_system, config.target_component)
        self.connection = MavlinkConnection(
            config,
            on_loss=self._stop_on_loss,
            on_return=self._hold_on_return,
            is_commanding=lambda: self.status.phase != Phase.OVER,
        )
        """The connection, for whoever shares it."""
        self._sent = 0
        self._deadman = Deadman()
        self._transmitter = Transmitter(
            self._deadman, config.period_s, self._write, lambda: self.connection.read
        )
        self._under_way: Handshake | None = None
        self._armed = ArmedSpan()
        self.shares_poses = False
        """Whether the poses that are flown by are the autopilot's own, or come to it from elsewhere
        too."""
        self._distrusted = False
        self._vitals = Vitals()
        self.connection.subscribe(self._vitals.take_message)
        self._uplink = Uplink(SLOW_QUESTION_S if _is_slow(config) else QUESTION_S)
        self.connection.subscribe(
            lambda message, now_s: self._uplink.take_message(message, now_s, self._usual_s)
        )
        self._examined = Examination()
        self._angles: tuple[float, ...] = ()
        self._landing: asyncio.Task[None] | None = None
        self._killing: asyncio.Task[None] | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._busy = "on a link that is not connected"
        """Why send() is out of place now; empty where it is not."""

    def _stop_on_loss(self) -> None:
        """Let nothing more leave, also when the wire is back: on a lost wire the autopilot has
        begun its own failsafe.
        """
        self._transmitter.stop()

    def _hold_on_return(self) -> None:
        """Take no newer command when an autopilot is heard again, unless the newest one is fresh.

        It may have heard us all the time: the newest command runs out, and its bring-down follows.
        """
        if self._deadman.phase(asyncio.get_running_loop().time()) is not Phase.FRESH:
            self._deadman.hold()

    @property
    def period_s(self) -> float:
        """Time between two commands [s]."""
        return self._config.period_s

    @property
    def follows_poses(self) -> bool:
        """Whether a command may leave as soon as a pose has come."""
        return self._config.follows_poses

    @property
    def autopilot(self) -> Self:
        """This link: the autopilot answers."""
        return self

    @property
    def status(self) -> LinkStatus:
        """The link as it is now."""
        connection = self.connection
        clock, rival = connection.clock, connection.rival
        conflict = link_notice("mavlink.rival", rival=rival).text if rival else ""
        return LinkStatus(
            state=connection.state,
            sent=self._sent,
            expired=self._deadman.refused,
            received=connection.codec.received,
            dropped=connection.dropped,
            text=connection.text,
            phase=self._deadman.phase(self._loop.time()) if self._loop is not None else "over",
            rtt_s=None if clock is None else clock.rtt_s,
            offset_s=None if clock is None else clock.offset_s,
            taken=self._armed.taken,
            slept_s=self._armed.slept_s,
            battery_v=self._vitals.battery_v,
            battery_share=self._vitals.battery_share,
            ready=self._vitals.ready,
            mode=self._vitals.mode,
            angles_rad=self._angles,
            unfit=self._examined.unfit,
            firmware=self._examined.firmware,
            warning=connection.second_path,
            other_addresses=connection.other_addresses,
            conflict=connection.conflict or conflict,
        )

    def watch_attitude(self, watch: Callable[[Attitude], None]) -> None:
        """Ask the autopilot for its attitude, and call ``watch`` with each that comes.

        Not on a connected link.
        """
        self.connection.wish(ATTITUDES, SLOW_HZ if _is_slow(self._config) else ATTITUDE_HZ)

        def take_message(message: Message, arrival_s: float) -> None:
            attitude = attitude_of(message, arrival_s, self.connection.clock)
            if attitude is not None:
                self._angles = attitude.angles_rad
                watch(attitude)

        self.connection.subscribe(take_message)

    async def connect(self) -> None:
        """Open the socket, wait for the autopilot's HEARTBEAT, and ask for the wanted messages."""
        self._loop = asyncio.get_running_loop()
        self._distrusted = False
        await self.connection.open()
        self._busy = ""

    async def examine(self) -> None:
        """Ask the autopilot for its version, and whether it is set up so that it may be armed."""
        autopilot = self.connection.autopilot()
        version = ReadVersion(autopilot)
        await self._ask(Handshake([version]))
        self._examined = Examination(version.firmware)
        self.connection.note_examined()
        try:
            await self._ask(make_checks(autopilot))
        except LinkRejected as error:
            self._examined = Examination(version.firmware, unfit=str(error))

    async def arm(self, idle: Callable[[], Command]) -> None:
        """Stream until the vehicle is in OFFBOARD (GUIDED on ArduPilot) and armed; see the port.

        Whatever ends this early, an order to disarm leaves after an order to arm. A LinkError, too,
        where ``idle()`` returned a command whose deadline had passed, or the motors were killed
        meanwhile.
        """

        def stream(now_s: float) -> None:
            if conflict := self.connection.conflict:
                raise LinkError(link_notice("arming.abandoned", why=conflict))
            if not self._send(idle(), now_s):
                if self._armed.slept_s:
                    raise LinkError(link_notice("arming.slept"))
                if self._deadman.held:
                    raise LinkError(link_notice("arming.abandoned", why=self.connection.text))
                raise LinkError(link_notice("arming.idle_expired"))

        if self._busy or not _over(self._killing):
            raise LinkMisuse(f"arm() {self._busy or 'while the motors are being killed'}")
        handshake = self._under_way = make_arming(
            self.connection.autopilot(), self._config.ardupilot_mode
        )
        self.connection.begin_arming()
        self._busy = "while arm() streams"
        if self._landing is not None:
            self._landing.cancel()
            self._landing = None
        now = asyncio.get_running_loop().time
        self._armed = ArmedSpan(Sleep(now))
        self._uplink.begin(now())
        self._transmitter.start()
        try:
            await self.connection.run_handshake(handshake, stream, self.period_s)
            if handshake.failure is not None:  # killed in the very moment of its end
                raise handshake.failure
            self.connection.believe_armed(True)
            self._armed.obeys_s = now()
        except BaseException:
            self._transmitter.stop()
            if handshake.at_last_step and self._killing is None:
                self.connection.send(
                    self.connection.codec.command(*self._target, MavCommand.ARM_DISARM, 0.0)
                )
            raise
        finally:
            self._under_way = None
            if self._busy == "while arm() streams":  # not closed meanwhile
                self._busy = ""

    def send(self, command: Command) -> bool:
        """See the port; False also where the autopilot is armed no longer, LinkMisuse while ``arm``
        is streaming.
        """
        if self._busy or self._loop is None:
            raise LinkMisuse(f"send() {self._busy}")
        return self._send(command, self._loop.time())

    def _send(self, command: Command, now_s: float) -> bool:
        self._check_takeover()
        if not self._deadman.take(command, now_s):
            return False
        self._write(command, now_s)
        self._transmitter.note_sent(now_s)
        return True

    def _check_takeover(self) -> None:
        """Stop sending where the autopilot is no longer ours.

        One that somebody else has disarmed must not fly on when it is armed again. One in another
        mode is somebody else's: no bring-down leaves either. After this computer has slept, the
        autopilot has come down without us long ago.
        """
        armed = self._armed
        if armed.slept_s:
            armed.obeys_s = None
            self._transmitter.stop()
            if self._landing is not None:
                self._landing.cancel()
        if armed.obeys_s is None:
            return
        if self._under_way is None and self._landing is None:
            armed.taken = self._vitals.foreign(armed.obeys_s + STALE_HEARTBEAT_S)
        if armed.taken or self.connection.state == "connected":
            armed.obeys_s = None
            self._transmitter.stop()

    def _write(self, what: Command | Segment, now_s: float) -> None:
        self._check_takeover()
        if self._deadman.at(now_s) is not what:
            return
        thrust = signal(what.thrust_n / self._thrust_max, self._curve)
        frame = self.connection.codec.attitude_target(
            now_s, *self._target, thrust, what.rates_rad_s
        )
        self._sent += self.connection.send(frame)
        if (asked_ns := self._uplink.ask(now_s)) is not None:
            self.connection.send(self.connection.codec.timesync_question(asked_ns))
        if isinstance(what, Segment):
            self._begin_landing(now_s)

    def land(self) -> None:
        """See the port.

        Its landing begins from the newest command's thrust: from a bring-down's PX4 sinks too fast.
        """
        if self._loop is not None and self._armed.obeys_s is not None:
            self._begin_landing(self._loop.time())

    def _begin_landing(self, now_s: float) -> None:
        if self._landing is None and self._could_land(now_s, by_itself=self._distrusted):
            self._landing = asyncio.ensure_future(self._land())

    def _could_land(self, now_s: float, *, by_itself: bool) -> bool:
        how = self._config.bring_down
        if how != "auto":
            return how == "land"
        return self._vitals.could_land(now_s) and (not by_itself or self._knows_by_itself)

    @property
    def _knows_by_itself(self) -> bool:
        """Whether nothing shows that the autopilot's position may come from our tracker."""
        config = self._config
        return config.own_position or not (
            config.forward.enabled or self.connection.others.tells_position or self.shares_poses
        )

    def could_land_by_itself(self, now_s: float) -> bool:
        """Return whether its mode LAND would use a position that is not made of our poses."""
        return self._could_land(now_s, by_itself=True)

    def distrust(self) -> None:
        """Note that our poses are wrong: until the next connection, mode LAND is requested only of
        an autopilot with a position of its own.
        """
        self._distrusted = True

    async def _land(self) -> None:
        """Request mode LAND during the bring-down by rates, which ends once it is accepted.

        Its mode is requested before: somebody who has just taken it over keeps it.
        """
        connection, armed, asked_s = self.connection, self._armed, asyncio.get_running_loop().time()
        try:
            await run_step(connection, AskMode(connection.autopilot()))
            armed.taken = self._vitals.foreign(asked_s)
            if not armed.taken:
                await run_step(connection, make_landing(connection.autopilot()))
                armed.lands_by_itself = True
        except LinkError:
            return  # the bring-down by rates goes on to its end
        self._transmitter.stop()

    @property
    def lands_by_itself(self) -> bool:
        """Whether LAND was accepted since the newest arming."""
        return self._armed.lands_by_itself

    def ask_mode(self) -> None:
        """Request the autopilot's mode now, instead of within a second."""
        if self._armed.obeys_s is not None:
            self.connection.send(self.connection.autopilot().message_request("HEARTBEAT"))

    def arrival(self, now_s: float) -> Arrival:
        """Return whether commands reach the autopilot in time, by its answers to TIMESYNC."""
        return self._uplink.arrival(now_s, self._usual_s)

    @property
    def _usual_s(self) -> float:
        """Return the usual round-trip time [s]; 0 before the first answer."""
        clock = self.connection.clock
        return 0.0 if clock is None else clock.rtt_s

    async def silent(self) -> None:
        """Return once nothing that lifts may leave any more without a new arming."""
        await self._transmitter.silent()

    async def disarm(self) -> None:
        """Ask the vehicle, which stands on the ground, to stop its motors.

        Then nothing leaves without a new arming.
        """
        autopilot = self.connection.autopilot()
        try:
            await self._ask(make_disarming(autopilot))
        except LinkRejected:
            if autopilot.kind != ARDUPILOT:
                raise
            await self._ask(make_landing_disarmed(autopilot))
        self.connection.believe_armed(False)
        self._transmitter.stop()

    async def _ask(self, handshake: Handshake) -> None:
        self._under_way = handshake
        try:
            await self.connection.run_handshake(handshake)
        finally:
            self._under_way = None

    async def kill(self) -> None:
        """See the port.

        It goes on to its end where the caller is cancelled, and :meth:`close` waits for it.
        """
        self._transmitter.stop()
        if self._under_way is not None:
            self._under_way.failure = LinkError(link_notice("arming.motors_killed"))
        if self._landing is not None:
            self._landing.cancel()
        if self._killing is None or _over(self._killing):
            connection = self.connection
            kind = connection.kind if connection.kind is not None else -1
            step = Kill(AutopilotAddress(connection.codec, connection.words, *self._target, kind))
            self._killing = asyncio.ensure_future(self._see_kill_through(step))
        await asyncio.shield(self._killing)

    async def _see_kill_through(self, step: Kill) -> None:
        if self.connection.state == "closed":
            raise LinkLost(link_notice("kill.closed"))
        await run_step(self.connection, step)
        self.connection.believe_armed(False)

    async def close(self) -> None:
        """See the port; a kill that is under way goes on until it is acknowledged."""
        self._busy = "on a link that is being closed"
        if self._under_way is not None:
            self._under_way.failure = LinkError(link_notice("mavlink.closed"))
        await self._transmitter.silent()
        for last in (self._killing, self._landing):
            if last is not None:
                await asyncio.wait({last})
                last.cancelled() or last.exception()  # whoever asked for it has been told
        self._killing = self._landing = None
        self._armed.obeys_s = None
        self._busy = "on a link that is not connected"
        self.connection.close()


def _is_slow(config: MavlinkLinkConfig) -> bool:
    """Whether the wire is too slow for the usual rates."""
    return config.serial is not None and config.baud <= SLOW_BAUD


def _over(task: "asyncio.Task[None] | None") -> bool:
    return task is None or task.done()
