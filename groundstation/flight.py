"""One flight from connecting to landed: the mission, the frames that leave, and what the screens see."""

import asyncio
import math
from collections.abc import Awaitable, Callable
from typing import TypeVar

import msgspec

from groundstation.clock import to_the_end
from groundstation.mission import FINAL, Event, Mission, State
from groundstation.pilot import Pilot, Tick
from groundstation.poses.port import Pose, PoseEvent, PoseSource
from groundstation.scoreboard import Scoreboard
from groundstation.settings import Config
from groundstation.snapshot import Snapshot
from groundstation.standstill import LOOK_S, STALL_S, Standstill
from groundstation.trajectories.transit import Transit
from links.port import Command, CommandLink, LinkError

T = TypeVar("T")

TOUCHDOWN_HEIGHT_M = 0.05
"""Below this height above the floor, with the descent over, the vehicle counts as landed."""
DISARMED_HEIGHT_M = 0.2
"""An autopilot that disarms below this height while we land has felt the floor [m]."""
LINK_LOOK_S = 0.5
"""How often it is asked whether the autopilot is still there and armed [s]."""
DISARM_WAIT_S = 8.0
"""How long a landed autopilot may refuse to disarm: it must first believe that it stands."""
AFTERMATH_S = 1.0
"""How long this task may take to notice that the link has fallen silent [s]; then it hangs."""
LAST_CHANCE_S = 0.002
"""So long before a command's deadline does the next one leave, if a newer pose is there [s]."""


class Outcome(msgspec.Struct, frozen=True):
    """How a flight ended."""

    state: State
    reason: str


class Ended(Exception):
    """The flight can't go on; the text says why, for the operator."""


class Flight:
    """One vehicle, one flight. ``run`` it once; ``land`` may be called at any time."""

    def __init__(
        self,
        config: Config,
        link: CommandLink,
        source: PoseSource,
        *,
        confirm: Callable[[], Awaitable[bool]],
        on_tick: Callable[[Tick], None] | None = None,
        on_event: Callable[[str], None] | None = None,
    ) -> None:
        """Take the parts; ``confirm`` asks the operator before the vehicle is armed.

        ``on_tick`` sees every command that leaves; ``on_event`` every line meant for the operator.
        """
        self._config = config
        self._link = link
        self._source = source
        self._confirm = confirm
        self._on_tick = on_tick
        self._on_event = on_event
        self._mission = Mission()
        self._pilot = Pilot(config.vehicle, config.controller, config.flight.coast_s, config.flight.floor_z_m)
        self._land = asyncio.Event()
        self._land_reason = ""
        self._first_pose = asyncio.Event()
        self._crew: asyncio.Task[None] | None = None
        self._stopped = ""
        self._closed = False
        self._kill: asyncio.Task[None] | None = None
        self._frame: asyncio.Future[None] | None = None
        self._frame_from_s = 0.0
        self._standstill = Standstill()
        self._scoreboard = Scoreboard(config)
        self.started_s: float | None = None
        """When the reference started, on the event loop's clock [s]; None before."""

    @property
    def state(self) -> State:
        """Where the flight stands."""
        return self._mission.state

    @property
    def landing_asked(self) -> bool:
        """True once :meth:`land` was called."""
        return self._land.is_set()

    def land(self, reason: str) -> None:
        """Ask for the flight to end: by landing in the air, at once on the ground."""
        if not self._land.is_set():
            self._land_reason = reason
            self._land.set()

    def stop(self, reason: str) -> None:
        """End the flight now, wherever it is: commands stop, and the link plays its bring-down."""
        self._stopped = self._stopped or reason
        if self._crew is not None:
            self._crew.cancel()

    def kill(self, reason: str) -> None:
        """Stop the motors now, also in the air."""
        if self._kill is None and not self._closed:
            self._kill = asyncio.ensure_future(self._link.kill())
            self.stop(f"motors off: {reason}")

    def pose_event(self, event: PoseEvent) -> None:
        """Hear what happens to the poses; that commands must not rest on one for long is seen to elsewhere."""
        self._say(event.text)

    async def run(self) -> Outcome:
        """Fly. However this ends, the link first does what it owes the vehicle: bring it down, or stop its motors.

        Then the link and the source are closed, and nothing leaves any more; cancelling does not shorten that.
        """
        self._crew = asyncio.ensure_future(self._fly())
        if self._stopped:
            self._crew.cancel()
        try:
            await self._crew
        except (Ended, LinkError) as error:
            self._move(Event.FAILED, str(error))
        except BaseException as error:
            if self.state not in FINAL:
                self._move(Event.FAILED, self._stopped or f"stopped by {type(error).__name__}: {error}")
            if not (self._stopped and isinstance(error, asyncio.CancelledError)):
                raise
        finally:
            await to_the_end(self._close())
        return Outcome(self.state, self._mission.reason)

    async def _close(self) -> None:
        """Close the link, which may have to bring down first, and tell what it does."""
        link = self._link
        if self._kill is None and link.status.phase in ("fresh", "bring_down"):
            self._say("bringing down: the link levels, sinks and stops by itself")
            await link.silent()
            if self._kill is None:
                self._say("the bring-down is over: nothing leaves any more")
        if self._kill is not None:
            try:
                await self._kill
                self._say("the vehicle has acknowledged: motors off")
            except LinkError as error:
                self._say(f"NOT acknowledged: {error}")
        self._closed = True
        await link.close()
        await self._source.close()

    async def _fly(self) -> None:
        config = self._config
        self._move(Event.START, "waiting for the link and for poses")
        await self._unless_landed(self._connect())
        status = self._source.status
        late_ms = 1e3 * status.latency_s
        self._move(
            Event.CONNECTED, f"link and poses are there; poses at {status.rate_hz:.0f} Hz, {late_ms:.0f} ms late"
        )
        if not await self._unless_landed(self._confirm()):
            raise Ended("not armed: the operator did not confirm")
        self._move(Event.ARM, "asking the autopilot to obey and to arm")
        looking = asyncio.ensure_future(self._look())
        try:
            await self._unless_landed(self._link.arm(self._idle))
            now = asyncio.get_running_loop().time()
            self._pilot.follow(config.trajectory.build(), now)
            self.started_s = now
            self._move(Event.ARMED, "following the trajectory")
            await self._while_the_link_sends(self._transmit())
            await self._stop_motors()
        finally:
            looking.cancel()

    async def _look(self) -> None:
        """However far apart frames and poses are, a program that stood still is to notice it."""
        loop = asyncio.get_running_loop()
        while True:
            self._standstill.look(loop.time())
            await asyncio.sleep(LOOK_S)

    async def _connect(self) -> None:
        await self._source.start(self._pose)
        await self._link.connect()
        wait = self._config.flight.pose_wait_s
        try:
            await asyncio.wait_for(self._first_pose.wait(), wait)
        except TimeoutError:
            dropped = self._source.status.dropped
            hint = f"dropped so far: {dropped}" if dropped else "nothing arrived at all; check address and port"
            raise Ended(f"no pose within {wait:g} s ({self._config.pose!r}): {hint}") from None

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
        """Commands, each from the newest pose, until the vehicle stands on the floor.

        One leaves every period; or, where the link follows poses, as soon as a pose has come (but not within half a
        period of the last one), and one and a half periods after the last one where none came. In both cases one more
        leaves, from a newer pose, just before the last one's deadline: a gap between poses must not seem longer than
        it is by waiting for the next frame.
        """
        loop = asyncio.get_running_loop()
        link, pilot = self._link, self._pilot
        period, duration = link.period_s, self._config.flight.duration_s
        frame = look = loop.time()
        last: Tick | None = None
        while True:
            now = loop.time()
            self._standstill.look(now)
            tick = pilot.tick(now)
            if now >= look:
                look += LINK_LOOK_S
                if self._has_disarmed(tick):
                    return
            if not link.send(tick.command):
                if self._has_disarmed(tick):  # the link knows it first
                    return
                raise Ended(self._why_refused(tick, last))
            last = tick
            self._scoreboard.tick(tick)
            if tick.seen.warning:
                self._say(f"warning: {tick.seen.warning}")
            if self._on_tick is not None:
                self._on_tick(tick)
            if self.state is State.FLYING:
                if duration is not None and tick.flight_time_s >= duration:
                    self.land(f"{duration:g} s are flown")
                if self._land.is_set():
                    self._begin_landing(tick)
            elif self._is_down(tick):
                return
            last_chance = tick.command.deadline_s - LAST_CHANCE_S
            if link.follows_poses:
                await self._next_pose(min(now + 0.5 * period, last_chance), now + 1.5 * period)
                continue
            if now > frame - 0.5 * period:  # else it left early, and this frame is still to come
                frame += period
            if frame < now:  # late frames are left out; the rest keep their distance to the link's own
                frame += math.ceil((now - frame) / period) * period
            await self._next_pose(min(last_chance, frame), frame)

    def _why_refused(self, tick: Tick, last: Tick | None) -> str:
        """Why the link did not take the command of ``tick``; that of ``last`` was the one before."""
        now = asyncio.get_running_loop().time()
        status = self._link.status
        if status.phase == "fresh":
            return f"the link takes no newer command, and plays its bring-down: {status.text}"
        gap = 0.0 if last is None else now - last.time_s
        if gap > max(STALL_S, 2.0 * self._link.period_s):
            return f"no command for {gap * 1e3:.0f} ms, as this program stood still: the link plays its bring-down"
        pose = tick.pose if last is None or now > tick.command.deadline_s else last.pose
        return f"no pose for {(now - pose.time_s) * 1e3:.0f} ms: the link plays its bring-down"

    async def _next_pose(self, from_s: float, until_s: float) -> None:
        """Wait for a pose, but not past ``until_s``; one that comes before ``from_s`` counts at that instant."""
        loop = asyncio.get_running_loop()
        self._frame, self._frame_from_s = loop.create_future(), from_s
        timer = loop.call_at(until_s, _wake, self._frame)
        try:
            await self._frame
        finally:
            timer.cancel()
            self._frame = None

    def _begin_landing(self, tick: Tick) -> None:
        flight = self._config.flight
        self._move(Event.LAND, self._land_reason)
        x, y, z = tick.reference.position_ned
        descent = Transit(
            (x, y, z),
            (x, y, flight.floor_z_m + TOUCHDOWN_HEIGHT_M),
            max_speed_m_s=flight.descent_m_s,
            max_acceleration_m_s2=1.0,
            yaw_rad=tick.reference.yaw_rad,
        )
        self._landing = descent
        self._pilot.follow(descent, tick.time_s)

    def _is_down(self, tick: Tick) -> bool:
        return tick.flight_time_s > (self._landing.duration_s or 0.0) and self._height(tick) < TOUCHDOWN_HEIGHT_M

    def _height(self, tick: Tick) -> float:
        return self._config.flight.floor_z_m - tick.estimate.motion.position[2]

    def _has_disarmed(self, tick: Tick) -> bool:
        """Whether the autopilot has disarmed by itself on the floor; anywhere else that ends the flight at once."""
        status = self._link.status
        if status.state == "armed":
            return False
        if self.state is State.LANDING and status.state == "connected" and self._height(tick) < DISARMED_HEIGHT_M:
            return True
        raise Ended(f"the link is {status.state}, no longer armed: commands have stopped. {status.text}")

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
        self._move(Event.TOUCHDOWN, "landed and disarmed")

    async def _stream_zeros(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            self._link.send(self._pilot.idle(loop.time(), 0.0))
            await asyncio.sleep(self._link.period_s)

    def _idle(self) -> Command:
        vehicle, share = self._config.vehicle, self._config.flight.idle_thrust
        weight = vehicle.mass_kg * self._config.controller.gravity
        return self._pilot.idle(asyncio.get_running_loop().time(), share * weight)

    async def _unless_landed(self, step: Awaitable[T]) -> T:
        """Await one step on the ground, or stop waiting as soon as somebody asks to land."""
        work = asyncio.ensure_future(step)
        asked = asyncio.ensure_future(self._land.wait())
        try:
            await asyncio.wait({work, asked}, return_when=asyncio.FIRST_COMPLETED)
            if not work.done():
                raise Ended(f"ended before take-off: {self._land_reason}")
            return work.result()
        finally:
            for task in (work, asked):
                if not task.done():
                    task.cancel()
            await asyncio.gather(work, asked, return_exceptions=True)

    def _pose(self, pose: Pose) -> None:
        if self._standstill.waited(pose.arrival_s):
            return
        self._pilot.pose(pose)
        self._scoreboard.pose(pose)
        self._first_pose.set()
        if self._frame is not None:
            if pose.arrival_s >= self._frame_from_s:
                _wake(self._frame)
            else:
                asyncio.get_running_loop().call_at(self._frame_from_s, _wake, self._frame)

    def _move(self, event: Event, reason: str) -> None:
        self._say(f"{self._mission.on(event, reason)}: {reason}")

    def _say(self, text: str) -> None:
        line = f"{asyncio.get_running_loop().time():.3f} {text}"
        self._scoreboard.event(line)
        if self._on_event is not None:
            self._on_event(line)

    def snapshot(self) -> Snapshot:
        """The flight as it is now."""
        return self._scoreboard.snapshot(
            state=self.state,
            reason=self._mission.reason,
            started_s=self.started_s,
            pose=self._pilot.newest_pose,
            source=self._source.status,
            link=self._link.status,
            certificate=self._pilot.certificate,
        )


def _wake(frame: "asyncio.Future[None]") -> None:
    if not frame.done():
        frame.set_result(None)
