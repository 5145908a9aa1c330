"""Command loop: commands of idle, spool-up and flight, then zero thrust until the motors are off.

They leave at the link's frames, or as poses arrive, and always before a deadline passes. The loop
also detects that this program was stalled: data read next may have waited as long, and a pose
without a time stamp of its own would otherwise pass for fresh.
"""

import asyncio
import math
from collections.abc import Awaitable

from groundstation.config import STEP_WATCH
from groundstation.core.messages import LinkDropWatch, Pose, Say, Sentence, notice
from groundstation.core.mission import IN_AIR, Event, State
from groundstation.core.pilot import Pilot
from groundstation.flight.controller import LAST_CHANCE_S, FlightController
from groundstation.flight.preflight import FlightEnded
from groundstation.machine import wake
from links.core import DISARM_S, STALL_S, TICK_S, Command, CommandLink, LinkError, Phase
from links.text import to_ms


class Pacing:
    """Frames of one link. Times are on the event loop's clock [s].

    A command leaves every period; or, if the link follows poses, at each pose (but not within half
    a period of the last command), and one and a half periods after the last one without a pose. In
    both cases one more leaves just before the deadline of the last one: waiting for the next frame
    must not lengthen a gap between poses, and the descent on the model begins in time.
    """

    def __init__(self, link: CommandLink) -> None:
        self._link = link
        self._frame_s = 0.0
        """Instant of the newest frame."""
        self._waiting: asyncio.Future[None] | None = None
        """Wait that a pose ends; None while there is none."""
        self._from_s = 0.0
        """Earliest end of that wait."""

    def begin(self) -> None:
        """Take this instant for that of the first frame."""
        self._frame_s = asyncio.get_running_loop().time()

    async def next(self, left_s: float, deadline_s: float) -> None:
        """Wait for the next frame.

        The last command left at ``left_s``, and its deadline is ``deadline_s``.
        """
        period, chance = self._link.period_s, deadline_s - LAST_CHANCE_S
        if chance <= left_s + TICK_S:
            chance = math.inf  # the last command was that one
        if self._link.follows_poses:
            await self._wait(min(left_s + 0.5 * period, chance), min(left_s + 1.5 * period, chance))
            return
        # A command that left earlier was a last chance: this frame is still to come.
        if left_s > self._frame_s - 0.5 * period:
            self._frame_s += period
        if self._frame_s < left_s:  # late frames are skipped; the others keep the link's phase
            self._frame_s += math.ceil((left_s - self._frame_s) / period) * period
        await self._wait(min(chance, self._frame_s), min(chance, self._frame_s))

    def end_wait(self, arrival_s: float) -> None:
        """End the wait for a pose, which has arrived at ``arrival_s``."""
        if self._waiting is None:
            return
        if arrival_s >= self._from_s:
            wake(self._waiting)
        else:
            asyncio.get_running_loop().call_at(self._from_s, wake, self._waiting)

    async def _wait(self, from_s: float, until_s: float) -> None:
        """Wait for a pose, until ``until_s`` at most.

        One that arrives before ``from_s`` counts at that time.
        """
        loop = asyncio.get_running_loop()
        self._waiting, self._from_s = loop.create_future(), from_s
        timer = loop.call_at(until_s, wake, self._waiting)
        try:
            await self._waiting
        finally:
            timer.cancel()
            self._waiting = None


STALL_CHECK_S = 0.02
"""Longest time between two calls of :meth:`StallDetector.note_running` [s]. Chosen: below
``STALL_S``."""
DRAIN_S = 0.01
"""Data read within this time after a stall does not count [s]: a socket is drained within some
milliseconds."""


class StallDetector:
    """Detects that this program was stalled. Times are on the event loop's clock [s]."""

    _looked_s: float | None = None
    """Newest instant at which the program ran."""
    _drained_s = 0.0
    """Instant from which read data count again after a stall."""

    def note_running(self, now_s: float) -> None:
        """Note that the program runs at ``now_s``."""
        if self._looked_s is not None and now_s - self._looked_s > STALL_S:
            self._drained_s = now_s + DRAIN_S
        self._looked_s = now_s

    def detect_stale(self, now_s: float) -> bool:
        """Take the time of reading data; return whether they may have arrived during a stall."""
        if self._looked_s is None:
            return False
        self.note_running(now_s)
        return now_s < self._drained_s


LINK_CHECK_S = 0.5
"""Period at which the autopilot's presence and arming are checked, also after the flight [s].
Chosen."""
HANG_S = 1.0
"""Time within which the controller must notice a silent link [s]; else it hangs. Chosen."""


class CommandLoop:
    """Sends the commands of the :class:`groundstation.flight.controller.FlightController`, one each
    frame.
    """

    def __init__(
        self, link: CommandLink, pilot: Pilot, controller: FlightController, idle_n: float, say: Say
    ) -> None:
        """``idle_n`` is the thrust [N] until the vehicle is armed."""
        self._link = link
        self._pilot = pilot
        self._controller = controller
        self._idle_n = idle_n
        self._say = say
        self._warned = {""}
        self.drops: LinkDropWatch | None = None
        """Watch on drops of the link since the flight began; None before arming."""
        self._pacing = Pacing(link)
        self._stalls = StallDetector()

    def pass_pose(self, pose: Pose) -> bool:
        """Hand on a pose; return False if it may have waited during a stall and must not be
        used.
        """
        if self._stalls.detect_stale(pose.arrival_s):
            return False
        self._controller.on_pose(pose)
        self._pacing.end_wait(pose.arrival_s)
        return True

    async def fly(self, armed: Event) -> None:
        """Arm, fly, and stop the motors on the floor; ``armed`` is the event after arming.

        Raises:
            FlightEnded: the flight can't go on.
            LinkError: the link fails.
        """
        loop, controller = asyncio.get_running_loop(), self._controller
        checking = asyncio.ensure_future(self._check_stalls())
        status = self._link.status
        self._warned |= {status.warning, status.conflict}  # the pre-flight checks reported them
        self.drops = LinkDropWatch(status)
        try:
            await self._link.arm(lambda: self._pilot.idle(loop.time(), self._idle_n))
            why = "mission.spooling" if armed is Event.ARMED else "mission.following"
            controller.go(armed, notice(why), loop.time())
            await self._while_the_link_sends(self._transmit())
            if controller.state is State.DISARMING:
                await self._stop_motors()
        finally:
            checking.cancel()

    async def _check_stalls(self) -> None:
        """Detect stalls also between frames and poses that are far apart."""
        loop = asyncio.get_running_loop()
        while True:
            self._stalls.note_running(loop.time())
            await asyncio.sleep(STALL_CHECK_S)

    async def _while_the_link_sends(self, work: Awaitable[None]) -> None:
        """Await ``work``; a controller that does not notice that the link has fallen silent
        hangs.
        """
        task, silent = asyncio.ensure_future(work), asyncio.ensure_future(self._link.silent())
        try:
            await asyncio.wait({task, silent}, return_when=asyncio.FIRST_COMPLETED)
            await asyncio.wait({task}, timeout=HANG_S)
            if not task.done():
                raise FlightEnded(notice("fault.controller_hangs"))
            task.result()
        finally:
            task.cancel()
            silent.cancel()
            await asyncio.gather(task, silent, return_exceptions=True)

    async def _transmit(self) -> None:
        """Send commands, each from the newest pose, until the vehicle is on the floor."""
        loop, controller = asyncio.get_running_loop(), self._controller
        check_s, last = loop.time(), None
        self._pacing.begin()
        while True:
            now = loop.time()
            self._stalls.note_running(now)
            command = controller.on_frame(now)
            slow = STEP_WATCH.get().slow
            if slow is not None:
                self._warn(slow.text, slow)
            if now >= check_s:
                check_s += LINK_CHECK_S
                self._ensure_armed(now)
                controller.on_link_status(now)
                self._warn_of_link()
            if controller.state not in IN_AIR:
                return
            if not self._link.send(command):
                self._ensure_armed(now)  # the link knows it first
                if controller.state in IN_AIR:
                    raise FlightEnded(self._explain_refusal(now, command, last))
                return
            last = now, command
            controller.on_sent(now)
            if controller.state not in IN_AIR:
                return
            await self._pacing.next(now, command.deadline_s)

    def _warn(self, key: str, sentence: Sentence) -> None:
        """Warn of ``sentence``, once for each ``key``."""
        if key not in self._warned:
            self._warned.add(key)
            self._say(sentence.as_warning())

    def _warn_of_link(self) -> None:
        status = self._link.status
        for warning in (status.conflict, status.warning):
            self._warn(warning, notice("link.warns", says=warning))
        for news in self.drops.find_news(status) if self.drops is not None else ():
            self._say(news.as_warning())

    def _explain_refusal(
        self, now: float, command: Command, last: tuple[float, Command] | None
    ) -> Sentence:
        """Return why the link did not accept ``command``.

        ``last`` is the one before, with the time it left.
        """
        status = self._link.status
        if status.phase == "fresh":
            return notice("fault.late_command", text=status.text)
        slow = STEP_WATCH.get().find_recent()
        if slow is not None:
            return notice("code.slow_end", slow=slow)
        gap = 0.0 if last is None else now - last[0]
        if gap > max(STALL_S, 2.0 * self._link.period_s):
            return notice("fault.stood_still", gap_ms=to_ms(gap))
        late = command if last is None or now > command.deadline_s else last[1]
        return notice("fault.no_pose", age_ms=to_ms(now - late.pose_time_s))

    def _ensure_armed(self, now: float) -> None:
        """End the flight if the autopilot has disarmed, or land if it did so on the floor.

        An autopilot whose telemetry is lost may still receive commands: the vehicle lands while the
        poses respond.
        """
        status, controller = self._link.status, self._controller
        if status.slept_s > 0.0:
            raise FlightEnded(notice("fault.slept", slept_s=status.slept_s))
        if status.taken:
            controller.on_link_status(now)
        if status.state == "armed" or controller.state not in IN_AIR:
            return
        on_floor = status.state == "connected" and status.hears_vehicle and controller.is_low
        if on_floor and controller.mission.allows(Event.DISARMED):
            controller.go(Event.DISARMED, notice("mission.felt_floor"), now)
        elif status.state != "lost":
            raise FlightEnded(notice("fault.disarmed", state=status.state, text=status.text))
        else:  # it may still be armed, or be landing by itself
            last = (
                f", and the autopilot was in {status.mode} when last heard" if status.mode else ""
            )
            if status.phase != Phase.FRESH:
                raise FlightEnded(notice("fault.link_lost", last=last, text=status.text))
            if controller.state is not State.DESCENT:
                controller.go(
                    Event.LAND, notice("fault.link_lost_land", last=last), now, fault=True
                )

    async def _stop_motors(self) -> None:
        """Hold zero thrust on the floor until the autopilot has disarmed."""
        loop, ended = asyncio.get_running_loop(), "mission.disarmed"
        give_up = loop.time() + DISARM_S
        zeros = asyncio.create_task(self._stream_zeros())
        try:
            while True:
                try:
                    await self._link.disarm()
                    break
                except LinkError as error:
                    if loop.time() > give_up:
                        fault = (
                            self._controller.fault if self._link.status.state == "lost" else None
                        )
                        if fault is not None:
                            raise FlightEnded(notice("fault.motors_unknown", why=fault)) from error
                        await self._force_motors_off(error)
                        ended = "mission.forced_off"
                        break
                    await asyncio.sleep(0.5)
        finally:
            zeros.cancel()
        self._controller.go(Event.DISARMED, notice(ended), loop.time())

    async def _force_motors_off(self, refusal: LinkError) -> None:
        """Stop the motors by force if the poses still show the vehicle on the floor: its own LAND
        might drive off.

        Raises:
            FlightEnded: it is not there, or that is refused, too.
        """
        why = FlightEnded(notice("fault.will_not_disarm", why=refusal))
        if not self._controller.is_at_floor:
            raise why from refusal
        try:
            await self._link.kill()
        except LinkError:
            raise why from refusal

    async def _stream_zeros(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            self._link.send(self._pilot.idle(loop.time(), 0.0))
            await asyncio.sleep(self._link.period_s)


class FrameLateness:
    """Delay of commands behind their frames.

    A late frame is skipped (:class:`Pacing` has the same rule).
    """

    def __init__(self, link: CommandLink) -> None:
        """``link`` is not used before the first command: some know their period only once
        connected.
        """
        self._link = link
        self._due_s: float | None = None
        self._pose_id: int | None = None

    def begin(self) -> None:
        """The next command is the first."""
        self._due_s = None

    def measure_s(self, now_s: float, pose_id: int, arrival_s: float) -> float | None:
        """Return the delay of a command from the pose ``pose_id``, which arrived at ``arrival_s``
        [s].

        None for a command without a frame of its own, or without a new pose.
        """
        if self._link.follows_poses:
            new, self._pose_id = pose_id != self._pose_id, pose_id
            return now_s - arrival_s if new else None
        period_s = self._link.period_s
        if self._due_s is None:
            self._due_s = now_s
        late = now_s - self._due_s
        if late < -0.5 * period_s:
            return None
        self._due_s += period_s
        if self._due_s < now_s:
            self._due_s = now_s + period_s
        return late
