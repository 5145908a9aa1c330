"""Command loop: the frames that leave in one flight. Idle, spool-up and flight, then zero thrust until motors are off.

It notices, too, that this program stood still: whatever it reads next may have waited as long, and a pose without a
time stamp of its own would otherwise pass for fresh.
"""

import asyncio
from collections.abc import Awaitable, Callable

from groundstation.core import Pilot, Tick
from groundstation.core.messages import Pose
from groundstation.core.mission import IN_AIR, Event, State
from groundstation.flight.pacing import Pacing
from groundstation.flight.progress import Progress
from links.core import Command, CommandLink, LinkError

LOOK_S = 0.02
"""How often :meth:`Standstill.look` is to be called, at least [s]."""
STALL_S = 0.06
"""Not having looked for longer than that is standing still [s]."""
DRAIN_S = 0.01
"""For so long afterwards nothing that is read counts: what waits in a socket is read within some milliseconds [s]."""


class Standstill:
    """Times are on the event loop's clock [s]."""

    def __init__(self) -> None:
        """Nothing is expected before the first look."""
        self._looked_s: float | None = None
        self._drained_s = 0.0

    def look(self, now_s: float) -> None:
        """The program runs at ``now_s``."""
        if self._looked_s is not None and now_s - self._looked_s > STALL_S:
            self._drained_s = now_s + DRAIN_S
        self._looked_s = now_s

    def waited(self, now_s: float) -> bool:
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


class Ended(Exception):
    """The flight can't go on; the text says why, for the operator."""


class Sender:
    """Sends what :class:`groundstation.flight.progress.Progress` has for each frame of a link."""

    def __init__(
        self,
        link: CommandLink,
        pilot: Pilot,
        progress: Progress,
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
        self._standstill = Standstill()

    def pose(self, pose: Pose) -> bool:
        """A pose has come; False where it may have waited while the program stood still, and must not be flown."""
        if self._standstill.waited(pose.arrival_s):
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
            self._standstill.look(loop.time())
            await asyncio.sleep(LOOK_S)

    async def _while_the_link_sends(self, work: Awaitable[None]) -> None:
        """Await ``work``, but no longer than a moment after the link has fallen silent: then it hangs."""
        task, silent = asyncio.ensure_future(work), asyncio.ensure_future(self._link.silent())
        try:
            await asyncio.wait({task, silent}, return_when=asyncio.FIRST_COMPLETED)
            await asyncio.wait({task}, timeout=AFTERMATH_S)
            if not task.done():
                raise Ended("the controller hangs: the link has brought the vehicle down without it")
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
            self._standstill.look(now)
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
                    raise Ended(self._why_refused(now, command, last))
                return
            last = now, command
            if tick is not None:
                self._on_tick(tick)
                progress.flown(tick)
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
            raise Ended(f"the computer that sends slept for {status.slept_s:.1f} s: arm anew to fly")
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
            raise Ended(f"the link is lost: commands have stopped{last}. {status.text}")
        raise Ended(f"the link is {status.state}, the vehicle armed no longer: commands have stopped. {status.text}")

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
                        raise Ended(f"landed at zero thrust, but the autopilot will not disarm: {error}") from error
                    await asyncio.sleep(0.5)
        finally:
            zeros.cancel()
        self._progress.go(Event.DISARMED, "landed and disarmed", loop.time())

    async def _stream_zeros(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            self._link.send(self._pilot.idle(loop.time(), 0.0))
            await asyncio.sleep(self._link.period_s)
