"""Flight: wires the parts of one flight, takes requests, and hands events on."""

import asyncio
from collections.abc import Awaitable, Callable, Sequence

import msgspec

from groundstation.core.health import Failure
from groundstation.core.messages import (
    Ask,
    Check,
    CommandSent,
    EndRecord,
    FlightEvent,
    IdleRecord,
    Notice,
    NoticeKind,
    Others,
    Pose,
    PoseSource,
    Reply,
    Request,
    RequestRecord,
    Sentence,
    Severity,
    Snapshot,
    SourceError,
    Subscriber,
    Tick,
    TickRecord,
    find_pose_drops,
    notice,
)
from groundstation.core.mission import ALARMING, EVENT_OF, FINAL, ON_GROUND, Event, State
from groundstation.core.pilot import Monitors, Pilot
from groundstation.core.safety import LiveGains
from groundstation.flight.command_loop import CommandLoop, FrameLateness
from groundstation.flight.controller import FlightController
from groundstation.flight.hold_to_run import HoldWatch
from groundstation.flight.preflight import ArmingSequence, FlightEnded, SurroundingsChecks
from groundstation.flight.shutdown import Shutdown
from groundstation.flight.statistics import FlightStatistics
from groundstation.machine import IdleSlots, to_the_end
from groundstation.pose.sources import describe_drop
from groundstation.settings import Config
from links.core import CommandLink, LinkError
from links.io import NETWORK, Network

HELD_IN = frozenset(
    {State.ARMING, State.TAKEOFF, State.HOLD, State.TRACKING, State.MOVING, State.RETURNING}
)
"""States in which releasing the operator's hold lands the vehicle. Before them it is at rest; after
them it comes down already."""


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
        idle_slots: IdleSlots,
        surroundings: SurroundingsChecks,
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
            idle_slots: slots for work that can wait, begun as each command has left.
            surroundings: checks of the surroundings before arming.
            hold: watch on the control that the operator must hold; None without one.
            monitors: makes the monitors that may end the flight.
        """
        self._config = config
        self._link = link
        self._source = source
        self._statistics = FlightStatistics(config.vehicle, config.flight.floor_z_m)
        self._subscribers = (self._statistics.take, *subscribers)
        self._network = network
        self._lateness = FrameLateness(link)
        flight = config.flight
        self._pilot = Pilot(
            config.vehicle, config.controller, flight.coast_s, flight.floor_z_m,
            self._on_pilot_event, self._now,
            monitors.health, follows_poses=link.follows_poses,
        )  # fmt: skip
        self._were_poses_doubted = False
        self._shutdown = Shutdown(link, source, self.say, forwards=config.forwards is not None)
        self._controller = FlightController(config, link, self._pilot, self, others, monitors)
        self._commands = CommandLoop(
            link, self._pilot, self._controller, flight.idle_thrust * config.weight_n, self.say
        )
        self._live_gains = LiveGains(config.controller)
        self._idle_slots = idle_slots
        # Poses by the autopilot are its own estimate, and so is its attitude.
        if not config.pose.by_autopilot:
            link.watch_attitude(
                lambda attitude: self._controller.on_attitude(attitude, self._now())
            )
        self._preflight = ArmingSequence(
            config,
            link,
            source,
            self._pilot,
            self._controller,
            confirm=confirm,
            others=others,
            say=self.say,
            surroundings=surroundings,
        )
        self._hold = hold
        self._flying: asyncio.Task[None] | None = None
        """Task of :meth:`_fly`; None before :meth:`run`."""
        self.believes_poses = True
        """Whether the gate accepted the newest pose. After the last command it stays as it was."""

    # ---- requests

    @property
    def state(self) -> State:
        """State of the flight."""
        return self._controller.state

    @property
    def reason(self) -> str:
        """Reason of the state; empty before the flight began."""
        reason = self._controller.mission.reason
        return "" if reason is None else reason.text

    @property
    def failure(self) -> Failure | None:
        """Failure of the poses or the uplink that ended the flight; None without one."""
        return self._controller.failure

    @property
    def started_s(self) -> float | None:
        """Start of the trajectory, on the event loop's clock [s]; None before it is known."""
        return self._controller.started_s

    def ask(self, request: Request) -> Reply:
        """Carry out ``request``, or reply why it is not possible now."""
        event, why, now = EVENT_OF[request.ask], request.why, self._now()
        self._publish(RequestRecord(now, request.ask, why))
        if not self._controller.mission.allows(event):
            helps = request.ask is Ask.GOTO and self._controller.mission.allows(Event.HOLD)
            over = "mission.over" if self.state in FINAL else "mission.not_possible"
            name = "mission.hold_first" if helps else over
            refusal = notice(name, ask=request.ask, state=self.state)
            self.say(notice("mission.refused_asker", refusal=refusal, why=why) if why else refusal)
            return Reply.of(False, refusal)
        match request.ask:
            case Ask.ARM if self._hold is not None and self._hold.hold.obstacle is not None:
                return Reply.of(False, self._hold.hold.advice)
            case Ask.GOTO:
                obstacle = self._controller.fly_to(request.points, why, now)
                if obstacle is not None:
                    self.say(notice("mission.goto_refused", why=obstacle))
                    return Reply.of(False, obstacle)
            case Ask.ARM:
                self._preflight.arm_asked.set()
                return Reply.of(True, notice("flight.arms"))
            case Ask.KILL:
                if self._shutdown.closed and not self._shutdown.killed:
                    return Reply.of(False, notice("flight.over", state=self.state))
                if not self._shutdown.killed:
                    self._shutdown.kill()
                    self._controller.go(event, notice("mission.killed", why=why), now)
            case Ask.LAND if self._shutdown.is_monitoring:
                # The autopilot lands, perhaps with our poses: a first Ctrl-C must not stop these.
                return Reply.of(False, notice("flight.autopilot_lands"))
            case _ if self._shutdown.is_monitoring:
                self._shutdown.stop_monitoring.set()
            case _:
                asked = "mission.ended_before" if self.state in ON_GROUND else "mission.asked"
                self._controller.go(event, notice(asked, why=why), now)
        return Reply.of(
            True,
            notice("flight.state", state=self.state, reason=self._controller.mission.reason or ""),
        )

    def set_gain(self, key: str, value: float) -> Reply:
        """Begin to move a gain (see live_gains.py), or reply why not."""
        reply = self._live_gains.set(key, value, self._now())
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
            pose=self._pilot.state.newest_pose,
            source=self._source.status,
            link=self._link.status,
            certificate=self._pilot.certificate,
            checks=self._preflight.checks,
            gains=self._live_gains.now,
        )

    def describe_tracking_error(self) -> Sentence:
        """Describe the tracking error of a finished flight that was not recorded."""
        return self._statistics.describe_tracking_error()

    # ---- from beginning to end

    async def run(self) -> FlightOutcome:
        """Fly. However this ends, the link first brings the vehicle down, or stops its motors.

        Then the link and the source are closed, and nothing leaves any more; cancelling does not
        shorten that.
        """
        controller = self._controller
        if self._network is not None:
            NETWORK.set(self._network)
        watching = self._start_hold_watch()
        self._flying = asyncio.ensure_future(self._fly())
        if self._controller.is_dismissed:  # a request has ended the flight before it began
            self._flying.cancel()
        try:
            await self._flying
        except FlightEnded as ended:
            controller.go(Event.ABORT, ended.sentence, self._now())
        except LinkError as error:
            controller.go(Event.ABORT, notice("fault.link", why=error.says), self._now())
        except BaseException as error:
            why = (
                notice("fault.source", why=error)
                if isinstance(error, SourceError)
                else notice("fault.stopped", name=type(error).__name__, text=error)
            )
            controller.go(Event.ABORT, why, self._now())
            if not (self._controller.is_dismissed and isinstance(error, asyncio.CancelledError)):
                raise
        finally:
            try:
                await to_the_end(self._shutdown.close())
            finally:
                watching.cancel()
                self._report_drops()
                end = controller.mission.reason or notice("mission.waiting")
                self._publish(EndRecord(self._now(), self.state, end.text, end.id, end.numbers))
        return FlightOutcome(
            self.state, self.reason, "" if controller.fault is None else controller.fault.text
        )

    def _report_drops(self) -> None:
        """Report which messages and poses were lost since arming, if they were many."""
        link_drops = self._commands.drops
        if link_drops is None:  # never armed
            return
        lost = link_drops.summarize(self._link.status)
        source = self._source.status
        pose_drops = find_pose_drops(source)
        if pose_drops is not None:
            reason, count, total = pose_drops
            why = describe_drop(reason, source.excesses)
            lost.append(notice("pose.dropped", count=count, total=total, why=why))
        for says in lost:
            self.say(notice("link.flown", says=says))

    async def _fly(self) -> None:
        """Make the checks, arm, and send commands until the flight has ended."""
        await self._preflight.run(self._on_pose)
        self._controller.go(Event.ARM, notice("mission.arming"), self._now())
        await self._commands.fly(
            Event.ARMED if self._config.flight.start == "floor" else Event.AIRBORNE
        )

    async def check(self) -> list[Check]:
        """Connect, make all checks as before a flight, and disconnect; instead of :meth:`run`."""
        watching = self._start_hold_watch()
        try:
            return await self._preflight.check(self._on_pose)
        finally:
            await to_the_end(self._shutdown.close())
            watching.cancel()

    def _start_hold_watch(self) -> "asyncio.Future[None]":
        """Watch the operator's hold from now on, until the returned future is cancelled."""
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
                self._controller.fault = self._controller.fault or why
            self.land(why.text)

    def _on_pose(self, pose: Pose) -> None:
        """Take one pose of the source."""
        if self._commands.pass_pose(pose):
            # The gate compares poses with a model of the commands, which end with the flight.
            if not self._controller.is_dismissed:
                self.believes_poses = self._pilot.state.newest_pose is pose
            self._preflight.first_pose.set()

    def on_state(self, state: State, reason: Sentence) -> None:
        """Publish a new state; a final one ends the commands. See :class:`FlightListener`."""
        severity = Severity.WARNING if state in ALARMING else Severity.INFO
        self._publish(Notice.of(self._now(), state, reason, "state", severity))
        if self._controller.is_dismissed:  # no more commands: the link brings the vehicle down
            if not self.believes_poses:
                self._shutdown.forwards = False
            if self._flying is not None:
                self._flying.cancel()

    def on_failure(self) -> None:
        """Forward no more poses. See :class:`FlightListener`."""
        self._shutdown.distrust()

    def on_tick(self, tick: Tick) -> None:
        """Publish a command that has left, and move the gains. See :class:`FlightListener`."""
        state = self.state
        for warning in tick.certificate.warnings:
            self.say(warning.as_warning(), "certificate")
        were_doubted, are_doubted = self._were_poses_doubted, self._pilot.state.are_poses_doubted
        self._were_poses_doubted = are_doubted
        if are_doubted and not were_doubted and self._link.autopilot is not None:
            # A vehicle that somebody has taken over does not respond either.
            self._link.autopilot.ask_mode()
        step, news = self._live_gains.update(
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
        self._idle_slots.begin()

    def _now(self) -> float:
        return asyncio.get_running_loop().time()

    def _publish(self, event: FlightEvent) -> None:
        for take in self._subscribers:
            take(event)

    def _on_pilot_event(self, event: FlightEvent | Tick) -> None:
        """Publish an input or output of the pilot, a command with the lateness of its frame."""
        if isinstance(event, Tick):
            event = TickRecord(
                event, self._lateness.measure_s(event.time_s, event.pose.id, event.pose.arrival_s)
            )
        elif isinstance(event, IdleRecord):
            self._lateness.begin()
        self._publish(event)

    def say(self, sentence: Sentence, kind: NoticeKind = "news") -> None:
        """Report ``sentence`` to the operator, screens and records."""
        self._publish(Notice.of(self._now(), self.state, sentence, kind, sentence.severity))
