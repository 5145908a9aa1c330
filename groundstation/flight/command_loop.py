"""Command loop: the frames that leave in one flight. Idle, spool-up and flight, then zero thrust until motors are off.

They leave at the link's frames, or as poses come, and always before a deadline passes. The loop notices, too, that this
program stood still: whatever it reads next may have waited as long, and a pose without a time stamp of its own would
otherwise pass for fresh.
"""

import asyncio
import math
from collections.abc import Awaitable, Callable

from groundstation.core import Pilot, Tick
from groundstation.core.messages import Pose
from groundstation.core.mission import IN_AIR, Event, State
from groundstation.flight.mission_executive import LAST_CHANCE_S, MissionExecutive
from links.core import Command, CommandLink, LinkError

AT_ONCE_S = 1e-6
"""Timers fire a clock's tick early: an instant nearer than this has come [s], or in virtual time it never would."""


class Pacing:
    """One link's frames. Times are on the event loop's clock [s].

    A command leaves every period; or, where the link follows poses, as soon as a pose has come (but not within half a
    period of the last one), and one and a half periods after the last one where none came. In both cases one more
    leaves just before the last one's deadline: a gap between poses must not seem longer than it is by waiting for the
    next frame, and where it is too long, what is flown without a pose begins then.
    """

    def __init__(self, link: CommandLink) -> None:
        """Nothing leaves before :meth:`begin`."""
        self._link = link
        self._frame_s = 0.0
        self._waiting: asyncio.Future[None] | None = None
        self._from_s = 0.0

    def begin(self) -> None:
        """The first frame is now."""
        self._frame_s = asyncio.get_running_loop().time()

    async def next(self, left_s: float, deadline_s: float) -> None:
        """Wait for the next frame; the last command left at ``left_s``, and its deadline is ``deadline_s``."""
        period, chance = self._link.period_s, deadline_s - LAST_CHANCE_S
        if chance <= left_s + AT_ONCE_S:
            chance = math.inf  # it is taken
        if self._link.follows_poses:
            await self._pose(min(left_s + 0.5 * period, chance), min(left_s + 1.5 * period, chance))
            return
        if left_s > self._frame_s - 0.5 * period:  # else it left early, and this frame is still to come
            self._frame_s += period
        if self._frame_s < left_s:  # late frames are left out; the rest keep their distance to the link's own
            self._frame_s += math.ceil((left_s - self._frame_s) / period) * period
        await self._pose(min(chance, self._frame_s), min(chance, self._frame_s))

    def pose(self, arrival_s: float) -> None:
        """A pose has come."""
        if self._waiting is None:
            return
        if arrival_s >= self._from_s:
            _wake(self._waiting)
        else:
            asyncio.get_running_loop().call_at(self._from_s, _wake, self._waiting)

    async def _pose(self, from_s: float, until_s: float) -> None:
        """Wait for a pose, but not past ``until_s``; one that comes before ``from_s`` counts at that instant."""
        loop = asyncio.get_running_loop()
        self._waiting, self._from_s = loop.create_future(), from_s
        timer = loop.call_at(until_s, _wake, self._waiting)
        try:
            await self._waiting
        finally:
            timer.cancel()
            self._waiting = None


def _wake(waiting: "asyncio.Future[None]") -> None:
    if not waiting.done():
        waiting.set_result(None)


LOOK_S = 0.02
"""How often :meth:`StallDetector.look` is to be called, at least [s]."""
STALL_S = 0.06
"""Not having looked for longer than that is standing still [s]."""
DRAIN_S = 0.01
"""For so long afterwards nothing that is read counts: what waits in a socket is read within some milliseconds [s]."""


class StallDetector:
    """Finds that this program stood still. Times are on the event loop's clock [s]."""

    def __init__(self) -> None:
        """Nothing is expected before the first look."""
        self._looked_s: float | None = None
        self._drained_s = 0.0

    def look(self, now_s: float) -> None:
        """The program runs at ``now_s``."""
        if self._looked_s is not None and now_s - self._looked_s > STALL_S:
            self._drained_s = now_s + DRAIN_S
        self._looked_s = now_s

    def may_be_stale(self, now_s: float) -> bool:
        """Whether what is read at ``now_s`` may have come while the program stood still."""
        if self._looked_s is None:
            return False
        self.look(now_s)
        return now_s < self._drained_s


LINK_LOOK_S = 0.5
"""How often it is asked whether the autopilot is still there and armed [s]."""
DISARM_WAIT_S = 8.0
"""How long a landed autopilot may refuse to disarm: it must first believe that it stands."""
AFTERMATH_S = 1.0
"""How long the controller may take to notice that the link has fallen silent [s]; then it hangs."""


class FlightEnded(Exception):
    """The flight can't go on; the text says why, for the operator."""


class CommandLoop:
    """Sends what :class:`groundstation.flight.mission_executive.MissionExecutive` has for each frame of a link."""

    def __init__(
        self,
        link: CommandLink,
        pilot: Pilot,
        progress: MissionExecutive,
        idle_n: float,
        on_tick: Callable[[Tick], None],
        say: Callable[[str], None],
    ) -> None:
        """``idle_n`` is the thrust [N] until the vehicle is armed; ``on_tick`` sees each command as it has left.

        ``say`` takes lines for the operator.
        """
        self._link = link
        self._pilot = pilot
        self._progress = progress
        self._idle_n = idle_n
        self._on_tick = on_tick
        self._say = say
        self._warned = {""}
        """What the link warns of that the operator knows."""
        self._pacing = Pacing(link)
        self._stalls = StallDetector()

    def pose(self, pose: Pose) -> bool:
        """A pose has come; False where it may have waited while the program stood still, and must not be flown."""
        if self._stalls.may_be_stale(pose.arrival_s):
            return False
        self._pilot.pose(pose)
        self._progress.pose(pose)
        self._pacing.pose(pose.arrival_s)
        return True

    async def fly(self, armed: Event) -> None:
        """Arm, fly, and stop the motors on the floor; ``armed`` is what arming leads to.

        Raises:
            Ended: the flight can't go on.
            LinkError: the link can't.
        """
        loop, progress = asyncio.get_running_loop(), self._progress
        looking = asyncio.ensure_future(self._look())
        self._warned.add(self._link.status.warning)  # pre-flight has told of it
        try:
            await self._link.arm(lambda: self._pilot.idle(loop.time(), self._idle_n))
            progress.firmware = self._link.status.firmware
            why = "spooling up, until the floor is left" if armed is Event.ARMED else "following the trajectory"
            progress.go(armed, why, loop.time())
            await self._while_the_link_sends(self._transmit())
            if progress.state is State.DISARMING:
                await self._stop_motors()
        finally:
            looking.cancel()

    async def _look(self) -> None:
        """However far apart frames and poses are, a program that stood still is to notice it."""
        loop = asyncio.get_running_loop()
        while True:
            self._stalls.look(loop.time())
            await asyncio.sleep(LOOK_S)

    async def _while_the_link_sends(self, work: Awaitable[None]) -> None:
        """Await ``work``, but no longer than a moment after the link has fallen silent: then it hangs."""
        task, silent = asyncio.ensure_future(work), asyncio.ensure_future(self._link.silent())
        try:
            await asyncio.wait({task, silent}, return_when=asyncio.FIRST_COMPLETED)
            await asyncio.wait({task}, timeout=AFTERMATH_S)
            if not task.done():
                raise FlightEnded("the controller hangs: the link has brought the vehicle down without it")
            task.result()
        finally:
            task.cancel()
            silent.cancel()
            await asyncio.gather(task, silent, return_exceptions=True)

    async def _transmit(self) -> None:
        """Commands, each from the newest pose, until the vehicle stands on the floor."""
        loop, progress = asyncio.get_running_loop(), self._progress
        look, last = loop.time(), None
        self._pacing.begin()
        while True:
            now = loop.time()
            self._stalls.look(now)
            command, tick = progress.command(now)
            if now >= look:
                look += LINK_LOOK_S
                self._ensure_armed(now)
                progress.link(self._link.status, now)
                self._warn()
            if progress.state not in IN_AIR:
                return
            if not self._link.send(command):
                self._ensure_armed(now)  # the link knows it first
                if progress.state in IN_AIR:
                    raise FlightEnded(self._why_refused(now, command, last))
                return
            last = now, command
            if tick is not None:
                self._on_tick(tick)
                progress.observe(tick)
            progress.left(now)
            if progress.state not in IN_AIR:
                return
            await self._pacing.next(now, command.deadline_s)

    def _warn(self) -> None:
        """Tell what the link warns of in flight, each thing once."""
        warning = self._link.status.warning
        if warning not in self._warned:
            self._warned.add(warning)
            self._say(f"warning: {warning}")

    def _why_refused(self, now: float, command: Command, last: tuple[float, Command] | None) -> str:
        """Why the link did not take ``command``; ``last`` is when the one before left, and it."""
        status = self._link.status
        if status.phase == "fresh":
            return f"the link takes no newer command, and plays its bring-down: {status.text}"
        gap = 0.0 if last is None else now - last[0]
        if gap > max(STALL_S, 2.0 * self._link.period_s):
            return f"no command for {gap * 1e3:.0f} ms, as this program stood still: the link plays its bring-down"
        late = command if last is None or now > command.deadline_s else last[1]
        return f"no pose for {(now - late.pose_time_s) * 1e3:.0f} ms: the link plays its bring-down"

    def _ensure_armed(self, now: float) -> None:
        """Whether the autopilot has disarmed by itself on the floor; anywhere else that ends the flight at once.

        Raises:
            Ended: it has, in the air.
        """
        status, progress = self._link.status, self._progress
        if status.slept_s > 0.0:
            raise FlightEnded(f"the computer that sends slept for {status.slept_s:.1f} s: arm anew to fly")
        if status.taken:
            progress.link(status, now)
        if status.state == "armed" or progress.state not in IN_AIR:
            return
        felt = status.state == "connected" and status.hears_vehicle  # else nobody has told of a floor
        if felt and progress.low and progress.allows(Event.DISARMED):
            progress.go(Event.DISARMED, "the autopilot has felt the floor and disarmed", now)
            return
        if status.state == "lost":  # nobody knows whether it is armed still: it may be coming down by itself
            last = f", and the autopilot was in {status.mode} when last heard" if status.mode else ""
            raise FlightEnded(f"the link is lost: commands have stopped{last}. {status.text}")
        raise FlightEnded(
            f"the link is {status.state}, the vehicle armed no longer: commands have stopped. {status.text}"
        )

    async def _stop_motors(self) -> None:
        """Hold zero thrust on the floor until the autopilot has disarmed."""
        loop = asyncio.get_running_loop()
        give_up = loop.time() + DISARM_WAIT_S
        zeros = asyncio.create_task(self._stream_zeros())
        try:
            while True:
                try:
                    await self._link.disarm()
                    break
                except LinkError as error:
                    if loop.time() > give_up:
                        raise FlightEnded(
                            f"landed at zero thrust, but the autopilot will not disarm: {error}"
                        ) from error
                    await asyncio.sleep(0.5)
        finally:
            zeros.cancel()
        self._progress.go(Event.DISARMED, "landed and disarmed", loop.time())

    async def _stream_zeros(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            self._link.send(self._pilot.idle(loop.time(), 0.0))
            await asyncio.sleep(self._link.period_s)
