"""Flight: wires the parts of one flight, takes requests, collects statistics, and shuts down.

The statistics are those of screens and telemetry, updated by poses, commands and events.

Command loop: commands of idle, spool-up and flight, then zero thrust until the motors are off. They leave at the link's
frames, or as poses arrive, and always before a deadline passes. The loop also detects that this program was stalled:
data read next may have waited as long, and a pose without a time stamp of its own would otherwise pass for fresh.
"""

import asyncio
import math
from collections import deque
from collections.abc import Awaitable, Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any

import msgspec

from groundstation.config import STEP_WATCH
from groundstation.core.geometry import IDENTITY, ZERO
from groundstation.core.messages import (
    FLOWN,
    STEADY_S,
    Ask,
    Certificate,
    Check,
    CommandSent,
    Distrusts,
    DisturbanceMeter,
    EndRecord,
    FlightEvent,
    IdleRecord,
    LinkDropWatch,
    Notice,
    NoticeKind,
    Others,
    Pose,
    PoseRecord,
    PoseSource,
    PoseStatus,
    Reply,
    Request,
    RequestRecord,
    Say,
    Sentence,
    Severity,
    Snapshot,
    SteadyError,
    Subscriber,
    Tick,
    TickRecord,
    find_pose_drops,
    notice,
)
from groundstation.core.mission import ALARMING, EVENT_OF, FINAL, IN_AIR, ON_GROUND, Event, State
from groundstation.core.pilot import Pilot
from groundstation.core.safety import Failure, LiveGains, Monitors, PoseLatency, Witness
from groundstation.core.vehicle import Vehicle
from groundstation.flight.hold_to_run import HoldWatch
from groundstation.flight.mission_executive import LAST_CHANCE_S, MissionExecutive
from groundstation.flight.prearm import Company, FlightEnded, PrearmSequence
from groundstation.machine import IdleSlots, to_the_end, wake
from groundstation.pose import make_source
from groundstation.pose.sources import describe_drop
from groundstation.settings import Config
from links import make_link
from links.core import Attitude, Command, CommandLink, Lateness, LinkError, LinkStatus, Phase
from links.io import NETWORK, Network

AT_ONCE_S = 1e-6
"""Times closer than this are equal [s]: timers fire up to a clock tick early, in virtual time without end."""


class Pacing:
    """Frames of one link. Times are on the event loop's clock [s].

    A command leaves every period; or, if the link follows poses, at each pose (but not within half a period of the last
    command), and one and a half periods after the last one without a pose. In both cases one more leaves just before
    the deadline of the last one: waiting for the next frame must not lengthen a gap between poses, and the descent on
    the model begins in time.
    """

    def __init__(self, link: CommandLink) -> None:
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
            chance = math.inf  # it has been used
        if self._link.follows_poses:
            await self._wait(min(left_s + 0.5 * period, chance), min(left_s + 1.5 * period, chance))
            return
        if left_s > self._frame_s - 0.5 * period:  # else it left early, and this frame is still to come
            self._frame_s += period
        if self._frame_s < left_s:  # late frames are skipped; the others keep the link's phase
            self._frame_s += math.ceil((left_s - self._frame_s) / period) * period
        await self._wait(min(chance, self._frame_s), min(chance, self._frame_s))

    def pose(self, arrival_s: float) -> None:
        """Take the arrival of a pose [s]."""
        if self._waiting is None:
            return
        if arrival_s >= self._from_s:
            wake(self._waiting)
        else:
            asyncio.get_running_loop().call_at(self._from_s, wake, self._waiting)

    async def _wait(self, from_s: float, until_s: float) -> None:
        """Wait for a pose, until ``until_s`` at most; one that arrives before ``from_s`` counts at that time."""
        loop = asyncio.get_running_loop()
        self._waiting, self._from_s = loop.create_future(), from_s
        timer = loop.call_at(until_s, wake, self._waiting)
        try:
            await self._waiting
        finally:
            timer.cancel()
            self._waiting = None


LOOK_S = 0.02
"""Longest time between two calls of :meth:`StallDetector.look` [s]."""
STALL_S = 0.06
"""A longer time without a look means that the program was stalled [s]."""
DRAIN_S = 0.01
"""Data read within this time after a stall does not count [s]: a socket is drained within some milliseconds."""


class StallDetector:
    """Detects that this program was stalled. Times are on the event loop's clock [s]."""

    _looked_s: float | None = None
    _drained_s = 0.0

    def look(self, now_s: float) -> None:
        """Note that the program runs at ``now_s``."""
        if self._looked_s is not None and now_s - self._looked_s > STALL_S:
            self._drained_s = now_s + DRAIN_S
        self._looked_s = now_s

    def may_be_stale(self, now_s: float) -> bool:
        """Whether data read at ``now_s`` may have arrived during a stall."""
        if self._looked_s is None:
            return False
        self.look(now_s)
        return now_s < self._drained_s


LINK_LOOK_S = 0.5
"""Period at which the autopilot's presence and arming are checked [s]."""
DISARM_WAIT_S = 8.0
"""Time for a landed autopilot to accept disarming [s]: it must first detect the landing."""
AFTERMATH_S = 1.0
"""The controller must notice a silent link within this time [s]; else it hangs."""


class CommandLoop:
    """Sends the commands of the :class:`groundstation.flight.mission_executive.MissionExecutive`, one each frame."""

    def __init__(
        self,
        link: CommandLink,
        pilot: Pilot,
        progress: MissionExecutive,
        idle_n: float,
        on_tick: Callable[[Tick], None],
        say: Say,
    ) -> None:
        """``idle_n`` is the thrust [N] until the vehicle is armed; ``on_tick`` gets each command after it has left."""
        self._link = link
        self._pilot = pilot
        self._progress = progress
        self._idle_n = idle_n
        self._on_tick = on_tick
        self._say = say
        self._warned = {""}
        self.drops: LinkDropWatch | None = None
        """Watch on drops of the link since the flight began; None before arming."""
        self._pacing = Pacing(link)
        self._stalls = StallDetector()

    def pose(self, pose: Pose) -> bool:
        """Take a pose; return False if it may have waited during a stall and must not be used."""
        if self._stalls.may_be_stale(pose.arrival_s):
            return False
        self._pilot.add_pose(pose)
        self._progress.pose(pose)
        self._pacing.pose(pose.arrival_s)
        return True

    async def fly(self, armed: Event) -> None:
        """Arm, fly, and stop the motors on the floor; ``armed`` is the event after arming.

        Raises:
            FlightEnded: the flight can't go on.
            LinkError: the link can't.
        """
        loop, progress = asyncio.get_running_loop(), self._progress
        looking = asyncio.ensure_future(self._look())
        status = self._link.status
        self._warned |= {status.warning, status.conflict}  # the pre-flight checks reported them
        self.drops = LinkDropWatch(status)
        try:
            await self._link.arm(lambda: self._pilot.idle(loop.time(), self._idle_n))
            why = "mission.spooling" if armed is Event.ARMED else "mission.following"
            progress.go(armed, notice(why), loop.time())
            await self._while_the_link_sends(self._transmit())
            if progress.state is State.DISARMING:
                await self._stop_motors()
        finally:
            looking.cancel()

    async def _look(self) -> None:
        """Detect stalls between frames and poses that are far apart, too."""
        loop = asyncio.get_running_loop()
        while True:
            self._stalls.look(loop.time())
            await asyncio.sleep(LOOK_S)

    async def _while_the_link_sends(self, work: Awaitable[None]) -> None:
        """Await ``work``; a controller that does not notice that the link has fallen silent hangs."""
        task, silent = asyncio.ensure_future(work), asyncio.ensure_future(self._link.silent())
        try:
            await asyncio.wait({task, silent}, return_when=asyncio.FIRST_COMPLETED)
            await asyncio.wait({task}, timeout=AFTERMATH_S)
            if not task.done():
                raise FlightEnded(notice("fault.controller_hangs"))
            task.result()
        finally:
            task.cancel()
            silent.cancel()
            await asyncio.gather(task, silent, return_exceptions=True)

    async def _transmit(self) -> None:
        """Send commands, each from the newest pose, until the vehicle is on the floor."""
        loop, progress = asyncio.get_running_loop(), self._progress
        look, last = loop.time(), None
        self._pacing.begin()
        while True:
            now = loop.time()
            self._stalls.look(now)
            command, tick = progress.command(now)
            slow = STEP_WATCH.get().slow
            if slow is not None:
                self._warn(slow.text, slow)
            if now >= look:
                look += LINK_LOOK_S
                self._ensure_armed(now)
                progress.link(now)
                self._warn_of_link()
            if progress.state not in IN_AIR:
                return
            if not self._link.send(command):
                self._ensure_armed(now)  # the link knows it first
                if progress.state in IN_AIR:
                    raise FlightEnded(self._explain_refusal(now, command, last))
                return
            last = now, command
            if tick is not None:
                self._on_tick(tick)
                progress.observe(tick)
            progress.left(now)
            if progress.state not in IN_AIR:
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

    def _explain_refusal(self, now: float, command: Command, last: tuple[float, Command] | None) -> Sentence:
        """Return why the link did not accept ``command``; ``last`` is the one before, with the time it left."""
        status = self._link.status
        if status.phase == "fresh":
            return notice("fault.late_command", text=status.text)
        slow = STEP_WATCH.get().find_recent()
        if slow is not None:
            return notice("code.slow_end", slow=slow)
        gap = 0.0 if last is None else now - last[0]
        if gap > max(STALL_S, 2.0 * self._link.period_s):
            return notice("fault.stood_still", gap_ms=gap * 1e3)
        late = command if last is None or now > command.deadline_s else last[1]
        return notice("fault.no_pose", age_ms=(now - late.pose_time_s) * 1e3)

    def _ensure_armed(self, now: float) -> None:
        """End the flight if the autopilot has disarmed, or land if it did so on the floor.

        An autopilot whose telemetry is lost may still receive commands: the vehicle lands while the poses respond.
        """
        status, progress = self._link.status, self._progress
        if status.slept_s > 0.0:
            raise FlightEnded(notice("fault.slept", slept_s=status.slept_s))
        if status.taken:
            progress.link(now)
        if status.state == "armed" or progress.state not in IN_AIR:
            return
        on_floor = status.state == "connected" and status.hears_vehicle and progress.low
        if on_floor and progress.mission.allows(Event.DISARMED):
            progress.go(Event.DISARMED, notice("mission.felt_floor"), now)
        elif status.state != "lost":
            raise FlightEnded(notice("fault.disarmed", state=status.state, text=status.text))
        else:  # it may still be armed, or be landing by itself
            last = f", and the autopilot was in {status.mode} when last heard" if status.mode else ""
            if status.phase != Phase.FRESH:
                raise FlightEnded(notice("fault.link_lost", last=last, text=status.text))
            if progress.state is not State.DESCENT:
                progress.go(Event.LAND, notice("fault.link_lost_land", last=last), now, fault=True)

    async def _stop_motors(self) -> None:
        """Hold zero thrust on the floor until the autopilot has disarmed."""
        loop, ended = asyncio.get_running_loop(), "mission.disarmed"
        give_up = loop.time() + DISARM_WAIT_S
        zeros = asyncio.create_task(self._stream_zeros())
        try:
            while True:
                try:
                    await self._link.disarm()
                    break
                except LinkError as error:
                    if loop.time() > give_up:
                        fault = self._progress.fault if self._link.status.state == "lost" else None
                        if fault is not None:
                            raise FlightEnded(notice("fault.motors_unknown", why=fault)) from error
                        await self._force_motors_off(error)
                        ended = "mission.forced_off"
                        break
                    await asyncio.sleep(0.5)
        finally:
            zeros.cancel()
        self._progress.go(Event.DISARMED, notice(ended), loop.time())

    async def _force_motors_off(self, refusal: LinkError) -> None:
        """Stop the motors by force if the poses still show the vehicle on the floor: its own LAND might drive off.

        Raises:
            FlightEnded: it is not there, or that is refused, too.
        """
        why = FlightEnded(notice("fault.will_not_disarm", why=refusal))
        if not self._progress.at_floor:
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
    """Delay of commands behind their frames; a late frame is skipped (:class:`Pacing` has the same rule)."""

    def __init__(self, link: CommandLink) -> None:
        """``link`` is not used before the first command: some know their period only once connected."""
        self._link = link
        self._due_s: float | None = None
        self._pose_id: int | None = None

    def begin(self) -> None:
        """The next command is the first."""
        self._due_s = None

    def late_s(self, now_s: float, pose_id: int, arrival_s: float) -> float | None:
        """Return the delay of a command from the pose ``pose_id``, which arrived at ``arrival_s`` [s].

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


class FlightStatistics:
    """Statistics of one flight, for its :class:`Snapshot`."""

    def __init__(self, vehicle: Vehicle, floor_z_m: float) -> None:
        """``floor_z_m`` is the zero of heights [m, NED]."""
        self._vehicle = vehicle
        self._floor_z_m = floor_z_m
        self._arrivals: deque[float] = deque(maxlen=1000)
        self._notices: deque[Notice] = deque(maxlen=20)
        self._tick: Tick | None = None
        self._state = State.IDLE
        self._disturbance = DisturbanceMeter(vehicle.mass_kg)
        self._steady = SteadyError()
        self._flown_s = 0.0
        self._lateness = Lateness()
        self._late_s: float | None = None

    def take(self, event: FlightEvent) -> None:
        """Count ``event``; the error counts on the trajectory alone."""
        match event:
            case PoseRecord(pose):
                self._arrivals.append(pose.arrival_s)
            case TickRecord(_, late_s):
                self._late_s = late_s
            case CommandSent(tick):
                self._tick = tick
                if self._late_s is not None:
                    self._lateness.add(self._late_s)
                if self._state in FLOWN:
                    self._disturbance.add(tick.time_s, tick.estimate)
                if self._state == State.TRACKING and tick.flight_time_s >= 0.0:
                    error = math.dist(tick.estimate.motion.position, tick.reference.position_ned)
                    self._steady.add(tick.flight_time_s, error)
                    self._flown_s = tick.flight_time_s
            case Notice(_, state):
                self._notices.append(event)
                self._state = State(state)

    def snapshot(
        self,
        *,
        state: State,
        reason: str,
        started_s: float | None,
        pose: Pose | None,
        source: PoseStatus,
        link: LinkStatus,
        certificate: Certificate | None,
        checks: tuple[Check, ...],
        gains: dict[str, float],
    ) -> Snapshot:
        """Return the flight as it is now; before the first command with the newest pose's position and attitude."""
        now = asyncio.get_running_loop().time()
        position, velocity, attitude = ZERO, ZERO, IDENTITY
        if self._tick is not None:
            motion = self._tick.estimate.motion
            position, velocity, attitude = motion.position, motion.velocity, motion.attitude
        elif pose is not None:
            position, attitude = pose.position_ned, pose.attitude
        tick = self._tick
        reference = position if tick is None else tick.reference.position_ned
        roll, pitch, yaw = self._vehicle.rate_limits_deg_s
        return Snapshot(
            vehicle=self._vehicle.name,
            state=state,
            reason=reason,
            time_s=now,
            flight_time_s=0.0 if started_s is None else now - started_s,
            pose_id=-1 if pose is None else pose.id,
            pose_age_s=0.0 if pose is None else now - pose.time_s,
            pose_rate_hz=self._rate(now),
            poses_dropped=source.dropped,
            position_ned=position,
            velocity_ned=velocity,
            attitude=attitude,
            reference_ned=reference,
            error_m=math.dist(position, reference),
            rms_m=self._steady.rms_m or 0.0,
            thrust_n=0.0 if tick is None else tick.decision.drive.thrust,
            thrust_max_n=self._vehicle.thrust_max_n,
            rates_rad_s=ZERO if tick is None else tick.decision.drive.rates,
            saturated=tick is not None and tick.decision.saturated,
            diagnostics=None if tick is None else tick.decision.diagnostics,
            link=link,
            floor_z_m=self._floor_z_m,
            events=tuple(self._notices),
            rate_limits_rad_s=(math.radians(roll), math.radians(pitch), math.radians(yaw)),
            thrust_effectiveness=1.0 if tick is None else tick.estimate.effectiveness,
            disturbance=self._disturbance.reading,
            pose_latency_s=source.latency_s,
            pose_latency_max_s=source.latency_max_s,
            pose_gaps=source.gaps,
            pose_clock_steps=source.clock_steps + source.clock_restarts,
            certificate=certificate,
            checks=checks,
            gains=gains,
            late_us=self._lateness.percentiles_us() if self._lateness.count else None,
            late_octaves=tuple(self._lateness.octaves) if self._lateness.count else (),
        )

    def describe_error(self) -> Sentence:
        """Describe the error of a finished flight for which the recorder did not."""
        rms_m, max_m = self._steady.rms_m, self._steady.max_m
        numbers = {"from_s": STEADY_S, "flown_s": self._flown_s}
        if rms_m is None or max_m is None:
            return notice("recording.none_short", **numbers)
        return notice("recording.none_figures", rms_cm=100.0 * rms_m, max_cm=100.0 * max_m, **numbers)

    def _rate(self, now: float) -> float:
        """Number of poses that arrived within the last second."""
        while self._arrivals and self._arrivals[0] < now - 1.0:
            self._arrivals.popleft()
        return float(len(self._arrivals))


def make_ends(
    config: Config, wires: Mapping[str, Any] | None = None, others: Others | None = None
) -> tuple[CommandLink, PoseSource]:
    """Make the link and the pose source that ``config`` names; nothing is opened yet.

    ``wires`` replaces the link's hardware in a simulation; see :func:`links.make.make_link`.
    ``others`` are further bodies that the source looks for.

    Raises:
        ConfigError: the poses need another link.
    """
    link = make_link(config.link, thrust_max_n=config.full_thrust_n, thrust_curve=config.thrust_curve, **(wires or {}))
    if link.autopilot is not None:
        link.autopilot.shares_poses = config.pose.shares_link
    return link, make_source(config.pose, link, others)


STAY_LOOK_S = 0.1
"""Period at which an autopilot left in the air is checked after the flight [s]."""
STAYS_S = 30.0
"""An autopilot that lands by itself is monitored, and can be killed, for this long after the last
command [s]."""


class Shutdown:
    """End of one flight: the bring-down, or a kill; poses to an autopilot that uses them; closed wires."""

    closed = False
    """Whether nothing leaves any more."""

    def __init__(self, link: CommandLink, source: PoseSource, say: Say, *, forwards: bool) -> None:
        self._link = link
        self._source = source
        self._say = say
        self.forwards = forwards
        """Whether the autopilot gets the poses of the source."""
        self.stays = False
        """Whether commands have ended while the autopilot is still monitored, and gets poses if it did before."""
        self.leave = asyncio.Event()
        """Set by a request to end that, too."""
        self._kill: asyncio.Task[None] | None = None

    @property
    def killed(self) -> bool:
        """Whether the motors were ordered off at once."""
        return self._kill is not None

    def kill(self) -> None:
        """Order the motors off at once."""
        self._kill = asyncio.ensure_future(self._link.kill())

    def distrust(self) -> None:
        """Stop forwarding poses, as they are wrong, and request no LAND that may use them."""
        self.forwards = False
        for part in (self._source, self._link):
            if isinstance(part, Distrusts):
                part.distrust()

    async def close(self) -> None:
        """Close the link, which may have to bring the vehicle down first, and the source; report each step."""
        link = self._link
        if self._kill is None and link.status.phase in ("fresh", "bring_down"):
            self._say(notice("flight.bringing_down"))
            if link.autopilot is not None:
                link.autopilot.land()
            await link.silent()
            if not self.killed and not link.status.unmet:
                taken = link.status.taken
                self._say(notice("flight.taken", mode=taken) if taken else notice("flight.bring_down_over"))
        if not self.killed and link.status.unmet:
            self._say(notice("flight.not_brought_down", why=link.status.unmet))
        await self._stay()
        if self._kill is not None:
            try:
                await self._kill
                self._say(notice("flight.motors_off"))
            except LinkError as error:
                self._say(notice("flight.kill_unheard", why=error))
        self.closed = True
        await link.close()
        await self._source.close()

    async def _stay(self) -> None:
        """Keep the poses to an autopilot that brings the vehicle down with them, and the way to stop its motors.

        An autopilot that uses no poses of ours is monitored for a limited time.
        """
        autopilot = self._link.autopilot
        if not (self._turns() and (self.forwards or (autopilot is not None and autopilot.lands_by_itself))):
            return
        now_s = asyncio.get_running_loop().time
        until_s = now_s() + STAYS_S
        self.stays = True
        self._say(notice("flight.poses_go_on" if self.forwards else "flight.still_heard"))
        while self._turns() and not self.leave.is_set() and (self.forwards or now_s() < until_s):
            with suppress(TimeoutError):
                await asyncio.wait_for(self.leave.wait(), STAY_LOOK_S)
        self.stays = False
        if self.killed:
            return
        if self.leave.is_set():
            self._say(notice("flight.left_as_asked"))
        elif self._turns():
            self._say(notice("flight.left_turning", limit_s=STAYS_S))
        else:
            self._say(notice("flight.left_stopped"))

    def _turns(self) -> bool:
        return self._kill is None and self._link.status.state == "armed"


UNSEEN = 64
"""Number of poses that wait for the vehicle's attitude, at most [-]."""


class AttitudeComparison:
    """Comparison of the poses with the attitude that the vehicle reports: do they agree, and how late are they?

    Poses wait until the vehicle reports its attitude, or a result is needed.
    """

    def __init__(self) -> None:
        self.witness, self.latency = Witness(), PoseLatency()
        self._unseen: list[Pose] = []

    def add(self, pose: Pose) -> None:
        """Take one pose."""
        self._unseen.append(pose)
        if len(self._unseen) >= UNSEEN:
            self.compare()

    def compare(self) -> Witness:
        """Compare all poses so far."""
        unseen, self._unseen = self._unseen, []
        for pose in unseen:
            self.witness.add_pose(pose)
            self.latency.add_pose(pose)
        return self.witness

    def attitude(self, attitude: Attitude) -> Witness:
        """Compare all poses so far, then take the vehicle's own attitude."""
        self.compare()
        self.witness.add_attitude(attitude)
        self.latency.add_attitude(attitude)
        return self.witness


HELD_IN = frozenset({State.ARMING, State.TAKEOFF, State.HOLD, State.TRACKING, State.MOVING, State.RETURNING})
"""States in which releasing the operator's hold lands the vehicle; the others land already."""


class FlightOutcome(msgspec.Struct, frozen=True):
    """Outcome of a flight."""

    state: State
    reason: str
    fault: str = ""
    """Cause of an early landing that nobody requested; empty without one."""


class Flight:
    """One vehicle, one flight. ``run`` it once; ``ask`` may be called at any time."""

    def __init__(
        self,
        config: Config,
        link: CommandLink,
        source: PoseSource,
        *,
        confirm: Callable[[], Awaitable[bool]],
        subscribers: Sequence[Subscriber],
        network: Network | None,
        others: Others | None,
        quiet: IdleSlots,
        company: Company,
        hold: HoldWatch | None,
        monitors: Monitors,
    ) -> None:
        """Take the parts.

        Args:
            config: the flight's.
            link: command link, opened by :meth:`run`.
            source: pose source, started by :meth:`run`.
            confirm: asks the operator before the vehicle is armed.
            subscribers: get all events.
            network: opens the wires; None for the usual one.
            others: vehicles to keep away from, as ``source`` shows them.
            quiet: is notified of each command that left.
            company: checks of the surroundings before arming.
            hold: watch on the control that the operator must hold; None without one.
            monitors: makes the monitors that may end the flight.
        """
        self._config = config
        self._link = link
        self._source = source
        self._statistics = FlightStatistics(config.vehicle, config.flight.floor_z_m)
        self._subscribers = (self._statistics.take, *subscribers)
        self._network = network
        self._due = FrameLateness(link)
        flight = config.flight
        self._pilot = Pilot(
            config.vehicle, config.controller, flight.coast_s, flight.floor_z_m, self._on_pilot_event, self._now,
            monitors.health,
        )  # fmt: skip
        self._suspicious = False
        self._attitudes = AttitudeComparison()
        self._shutdown = Shutdown(link, source, self.say, forwards=config.forwards is not None)
        self._progress = MissionExecutive(
            config, link, self._pilot, self.say, self._enter, self._shutdown.distrust, others, monitors
        )
        self._commands = CommandLoop(
            link, self._pilot, self._progress, flight.idle_thrust * config.weight_n, self._on_command, self.say
        )
        self._live = LiveGains(config.controller)
        self._quiet = quiet
        if not config.pose.by_autopilot:  # else both are its own estimate
            link.watch_attitude(self._attitude)
        self._prearm = PrearmSequence(
            config,
            link,
            source,
            self._pilot,
            self._progress,
            self.witness,
            confirm=confirm,
            others=others,
            say=self.say,
            company=company,
        )
        self._hold = hold
        self._crew: asyncio.Task[None] | None = None
        self._dismissed = False
        self.believes_poses = True
        """Whether the newest pose is used; after the last command, whether that before it was."""

    # ---- requests

    @property
    def state(self) -> State:
        """State of the flight."""
        return self._progress.state

    @property
    def reason(self) -> str:
        """Reason of the state; empty before the flight began."""
        reason = self._progress.mission.reason
        return "" if reason is None else reason.text

    @property
    def failure(self) -> Failure | None:
        """Failure of the poses or the uplink that ended the flight; None without one."""
        return self._progress.failure

    @property
    def started_s(self) -> float | None:
        """Start of the trajectory, on the event loop's clock [s]; None before it is known."""
        return self._progress.started_s

    def ask(self, request: Request) -> Reply:
        """Carry out ``request``, or reply why it is not possible now."""
        event, why, now = EVENT_OF[request.ask], request.why, self._now()
        self._publish(RequestRecord(now, request.ask, why))
        if not self._progress.mission.allows(event):
            refusal = notice("mission.hold_first" if request.ask is Ask.GOTO else "mission.not_possible",
                             ask=request.ask, state=self.state)  # fmt: skip
            self.say(notice("mission.refused_asker", refusal=refusal, why=why) if why else refusal)
            return Reply.of(False, refusal)
        match request.ask:
            case Ask.ARM if self._hold is not None and self._hold.hold.obstacle is not None:
                return Reply.of(False, self._hold.hold.advice)
            case Ask.GOTO:
                obstacle = self._progress.move(request.points, why, now)
                if obstacle is not None:
                    self.say(notice("mission.goto_refused", why=obstacle))
                    return Reply.of(False, obstacle)
            case Ask.ARM:
                self._prearm.arm_asked.set()
                return Reply.of(True, notice("flight.arms"))
            case Ask.KILL:
                if self._shutdown.closed and not self._shutdown.killed:
                    return Reply.of(False, notice("flight.over", state=self.state))
                if not self._shutdown.killed:
                    self._shutdown.kill()
                    self._progress.go(event, notice("mission.killed", why=why), now)
            case Ask.LAND if self._shutdown.stays:
                # The autopilot lands, perhaps with our poses: a first Ctrl-C must not end them.
                return Reply.of(False, notice("flight.autopilot_lands"))
            case _ if self._shutdown.stays:
                self._shutdown.leave.set()
            case _:
                asked = "mission.ended_before" if self.state in ON_GROUND else "mission.asked"
                self._progress.go(event, notice(asked, why=why), now)
        return Reply.of(True, notice("flight.state", state=self.state, reason=self._progress.mission.reason or ""))

    def set_gain(self, key: str, value: float) -> Reply:
        """Begin to move a gain (see live_gains.py), or reply why not."""
        reply = self._live.set(key, value, self._now())
        self.say(Sentence(reply.id, reply.says, reply.numbers))
        return reply

    def land(self, reason: str) -> None:
        """Request a landing here; before take-off, the end of the flight."""
        self.ask(Request(Ask.LAND, reason))

    def stop(self, reason: str) -> None:
        """Request the end of the flight now: commands stop, and the link plays its bring-down."""
        self.ask(Request(Ask.ABORT, reason))

    def snapshot(self) -> Snapshot:
        """Return the flight as it is now."""
        return self._statistics.snapshot(
            state=self.state,
            reason=self.reason,
            started_s=self.started_s,
            pose=self._pilot.newest_pose,
            source=self._source.status,
            link=self._link.status,
            certificate=self._pilot.certificate,
            checks=self._prearm.checks,
            gains=self._live.now,
        )

    def describe_error(self) -> Sentence:
        """Describe the error of a finished flight for which the recorder did not."""
        return self._statistics.describe_error()

    # ---- from beginning to end

    async def run(self) -> FlightOutcome:
        """Fly. However this ends, the link first brings the vehicle down, or stops its motors.

        Then the link and the source are closed, and nothing leaves any more; cancelling does not shorten that.
        """
        progress = self._progress
        if self._network is not None:
            NETWORK.set(self._network)
        watching = self._watch()
        self._crew = asyncio.ensure_future(self._fly())
        if self._dismissed:
            self._crew.cancel()
        try:
            await self._crew
        except FlightEnded as ended:
            progress.go(Event.ABORT, ended.sentence, self._now())
        except LinkError as error:
            progress.go(Event.ABORT, notice("fault.link", why=error.says), self._now())
        except BaseException as error:
            why = notice("fault.stopped", name=type(error).__name__, text=error)
            progress.go(Event.ABORT, why, self._now())
            if not (self._dismissed and isinstance(error, asyncio.CancelledError)):
                raise
        finally:
            try:
                await to_the_end(self._shutdown.close())
            finally:
                watching.cancel()
                self._report_drops()
                end = progress.mission.reason or notice("mission.waiting")
                self._publish(EndRecord(self._now(), self.state, end.text, end.id, end.numbers))
        return FlightOutcome(self.state, self.reason, "" if progress.fault is None else progress.fault.text)

    def _report_drops(self) -> None:
        """Report which messages and poses were lost in the flight, if they were many."""
        watch, source = self._commands.drops, self._source.status
        found = find_pose_drops(source)
        if watch is None:
            return
        lost = watch.summarize(self._link.status)
        if found is not None:
            reason, count, total = found
            why = describe_drop(reason, source.excesses)
            lost.append(notice("pose.dropped", count=count, total=total, why=why))
        for says in lost:
            self.say(notice("link.flown", says=says))

    async def _fly(self) -> None:
        await self._prearm.depart(self._pose)
        self._progress.go(Event.ARM, notice("mission.arming"), self._now())
        await self._commands.fly(Event.ARMED if self._config.flight.start == "floor" else Event.AIRBORNE)

    async def check(self) -> list[Check]:
        """Connect, make all checks as before a flight, and disconnect; instead of :meth:`run`."""
        watching = self._watch()
        try:
            return await self._prearm.check(self._pose)
        finally:
            await to_the_end(self._shutdown.close())
            watching.cancel()

    def _watch(self) -> "asyncio.Future[None]":
        """Watch the operator's hold from now on."""
        if self._hold is None:
            return asyncio.get_running_loop().create_future()
        return asyncio.ensure_future(self._hold.run(self._check_hold))

    # ---- inputs and events

    def _check_hold(self) -> None:
        """Land if the operator's hold is released or lost."""
        assert self._hold is not None, "it has called"
        why = self._hold.hold.obstacle
        if why is not None and self.state in HELD_IN:
            if self._hold.hold.lost:
                self._progress.fault = self._progress.fault or why
            self.land(why.text)

    def _pose(self, pose: Pose) -> None:
        if self._commands.pose(pose):
            self._attitudes.add(pose)
            if not self._dismissed:  # later the model, which the gate uses, gets no commands
                self.believes_poses = self._pilot.newest_pose is pose
                if news := self._pilot.response.describe_news(self._late_by_attitude):
                    self.say(news.as_warning(), "latency")
            self._prearm.first_pose.set()

    def witness(self) -> Witness:
        """Return the comparison of all poses so far with the vehicle's own attitude."""
        return self._attitudes.compare()

    def _late_by_attitude(self) -> tuple[float, float] | None:
        """Return the extra delay of poses by the vehicle's own attitude, and its 1σ [s]."""
        self.witness()
        return self._attitudes.latency.estimate

    def _attitude(self, attitude: Attitude) -> None:
        """Take the vehicle's own attitude, and compare the poses with it."""
        witness, now_s = self._attitudes.attitude(attitude), self._now()
        if not self._dismissed:
            self._report_disagreement()
        if self.state in IN_AIR:
            agreement = witness.verdict(now_s)
            self._pilot.set_autopilot_agreement(None if agreement is None else agreement.agrees)
        self._progress.attitude(attitude, witness.in_poses(attitude), now_s)

    def _report_disagreement(self) -> None:
        """Report poses that are later than configured, or, while they are used, disagree with the own attitude."""
        if news := self._attitudes.latency.describe_news(lambda: 0.5 * (self._link.status.rtt_s or 0.0)):
            self.say(news.as_warning(), "latency")
        state = self.state
        if state in IN_AIR and state is not State.DESCENT and (news := self._attitudes.witness.describe_news()):
            self.say(news.as_warning())

    def _enter(self, state: State, reason: Sentence) -> None:
        severity = Severity.WARNING if state in ALARMING else Severity.INFO
        self._publish(Notice.of(self._now(), state, reason, "state", severity))
        if state in FINAL and state is not State.LANDED:  # no more commands: the link brings the vehicle down
            self._dismissed = True
            if not self.believes_poses:
                self._shutdown.forwards = False
            if self._crew is not None:
                self._crew.cancel()

    def _on_command(self, tick: Tick) -> None:
        state = self.state
        for warning in tick.certificate.warnings:
            self.say(warning.as_warning(), "certificate")
        suspicious, self._suspicious = self._suspicious, self._pilot.is_suspicious
        if self._suspicious and not suspicious and self._link.autopilot is not None:
            self._link.autopilot.ask_mode()  # a vehicle that somebody has taken over does not respond either
        step, news = self._live.update(
            tick.time_s,
            tick.estimate,
            tick.reference,
            tick.decision.diagnostics.v_known,
            counts=state in (State.HOLD, State.TRACKING),
        )
        if step is not None:
            self._pilot.set_gain(*step)
        if news is not None:
            self.say(news)
        self._publish(CommandSent(tick))
        self._quiet.begin()

    def _now(self) -> float:
        return asyncio.get_running_loop().time()

    def _publish(self, event: FlightEvent) -> None:
        for take in self._subscribers:
            take(event)

    def _on_pilot_event(self, event: FlightEvent | Tick) -> None:
        if isinstance(event, Tick):
            event = TickRecord(event, self._due.late_s(event.time_s, event.pose.id, event.pose.arrival_s))
        elif isinstance(event, IdleRecord):
            self._due.begin()
        self._publish(event)

    def say(self, sentence: Sentence, kind: NoticeKind = "news") -> None:
        """Report ``sentence`` to the operator, screens and records."""
        self._publish(Notice.of(self._now(), self.state, sentence, kind, sentence.severity))
