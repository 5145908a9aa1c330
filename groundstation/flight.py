"""One flight from connecting to its end: what may be asked of it, how it lives, and what is told of it."""

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress

import msgspec

from groundstation.checks import LOOK_S, Checks, failed
from groundstation.clock import to_the_end
from groundstation.live_gains import LiveGains
from groundstation.mission import EVENT_OF, FINAL, ON_GROUND, Event, State
from groundstation.pilot import Pilot, Tick
from groundstation.poses.others import Others
from groundstation.poses.port import Pose, PoseEvent, PoseSource
from groundstation.progress import Progress
from groundstation.quiet import Quiet
from groundstation.requests import Ask, Reply, Request
from groundstation.scoreboard import Scoreboard
from groundstation.sender import Ended, Sender
from groundstation.settings import Config
from groundstation.snapshot import Snapshot
from groundstation.verdict import Check, Verdict
from links.port import CommandLink, LinkError

LOOK_AGAIN_S = 1.0
"""How often the checks are made anew while the operator has not armed yet [s]."""

FEED_LOOK_S = 0.1
"""How often it is looked whether poses still serve the autopilot after the flight [s]."""


class Outcome(msgspec.Struct, frozen=True):
    """How a flight ended."""

    state: State
    reason: str
    fault: str = ""
    """What made it come down early, where nobody had asked for it; empty where it went as it was meant to."""


class Flight:
    """One vehicle, one flight. ``run`` it once; ``ask`` may be called at any time."""

    def __init__(
        self,
        config: Config,
        link: CommandLink,
        source: PoseSource,
        *,
        confirm: Callable[[], Awaitable[bool]],
        on_tick: Callable[[Tick], None] | None = None,
        on_event: Callable[[str], None] | None = None,
        on_state: Callable[[State, str], None] | None = None,
        pilot: Pilot | None = None,
        others: Others | None = None,
        quiet: Quiet | None = None,
    ) -> None:
        """Take the parts; ``confirm`` asks the operator before the vehicle is armed.

        ``on_tick`` sees every command of the controller that leaves; ``on_event`` every line meant for the operator;
        ``on_state`` every state that begins, and why. Without a ``pilot`` it makes its own.
        ``others`` are vehicles to keep away from, as ``source`` sees them. ``quiet`` hears of each command that left.
        """
        self._config = config
        self._link = link
        self._source = source
        self._confirm = confirm
        self._on_tick = on_tick
        self._on_event = on_event
        self._on_state = on_state
        flight = config.flight
        self._pilot = pilot or Pilot(config.vehicle, config.controller, flight.coast_s, flight.floor_z_m)
        self._progress = Progress(config, self._pilot, lambda: link.period_s, self._say, self._entered, others)
        self._sender = Sender(link, self._pilot, self._progress, flight.idle_thrust * config.weight_n, self._flown)
        self._scoreboard = Scoreboard(config, link)
        self._live = LiveGains(config.controller)
        self._others = others
        self._quiet = quiet or Quiet()
        self._feeding: asyncio.Event | None = None
        self._checks: Checks | None = None
        self._checked_last: tuple[Check, ...] = ()
        self._arm_asked = asyncio.Event()
        self._first_pose = asyncio.Event()
        self._crew: asyncio.Task[None] | None = None
        self._dismissed = False
        self._closed = False
        self._kill: asyncio.Task[None] | None = None

    # ---- what may be asked of it

    @property
    def state(self) -> State:
        """Where the flight stands."""
        return self._progress.state

    @property
    def reason(self) -> str:
        """Why it stands there."""
        return self._progress.reason

    @property
    def newest_tick_s(self) -> float | None:
        """When the newest command of the controller left, on the event loop's clock [s]; None before the first."""
        return None if self._progress.tick is None else self._progress.tick.time_s

    @property
    def started_s(self) -> float | None:
        """When the trajectory starts, on the event loop's clock [s]; None before that is known."""
        return self._progress.started_s

    def ask(self, request: Request) -> Reply:
        """Do what ``request`` says, or tell the operator that it is not possible now."""
        event, why = EVENT_OF[request.ask], request.why
        now = asyncio.get_running_loop().time()
        if not self._progress.allows(event):
            says = f"{request.ask} is not possible while {self.state}"
            self._say(says + (f" ({why})" if why else ""))
            return Reply(False, says)
        match request.ask:
            case Ask.ARM:
                self._arm_asked.set()
                return Reply(True, "arming")
            case Ask.KILL:
                if self._kill is None and self._closed:
                    return Reply(False, f"{self.state}: the flight is over, and nothing leaves any more")
                if self._kill is None:
                    self._kill = asyncio.ensure_future(self._link.kill())
                    self._progress.go(event, f"motors off: {why}", now)
            case _ if self._feeding is not None:
                # It is in somebody else's hands, who may rest on our poses: a first Ctrl-C does not end them.
                if request.ask is Ask.LAND:
                    return Reply(False, "poses go on to the autopilot until its motors stop, or until asked to descend")
                self._feeding.set()
            case _:
                self._progress.go(event, f"ended before take-off: {why}" if self.state in ON_GROUND else why, now)
        return Reply(True, f"{self.state}: {self._progress.reason}")

    def set_gain(self, key: str, value: float) -> Reply:
        """Begin to move a gain (see live_gains.py), or say why not."""
        reply = self._live.set(key, value, asyncio.get_running_loop().time())
        self._say(reply.says)
        return reply

    def note(self, text: str) -> None:
        """Tell the operator, screens and records of something that happened beside the flight."""
        self._say(text)

    def land(self, reason: str) -> None:
        """Ask to land here; before take-off, to end the flight."""
        self.ask(Request(Ask.LAND, reason))

    def stop(self, reason: str) -> None:
        """Ask to end the flight now, wherever it is: commands stop, and the link plays its bring-down."""
        self.ask(Request(Ask.ABORT, reason))

    def kill(self, reason: str) -> None:
        """Ask to stop the motors now, also in the air."""
        self.ask(Request(Ask.KILL, reason))

    def snapshot(self) -> Snapshot:
        """The flight as it is now."""
        return self._scoreboard.snapshot(
            state=self.state,
            reason=self._progress.reason,
            started_s=self.started_s,
            pose=self._pilot.newest_pose,
            source=self._source.status,
            link=self._link.status,
            certificate=self._pilot.certificate,
            checks=self._checked_last,
            gains=self._live.now,
        )

    # ---- its life

    def pose_event(self, event: PoseEvent) -> None:
        """Hear what happens to the poses; that commands must not rest on one for long is seen to elsewhere."""
        self._say(event.text)

    async def run(self) -> Outcome:
        """Fly. However this ends, the link first does what it owes the vehicle: bring it down, or stop its motors.

        Then the link and the source are closed, and nothing leaves any more; cancelling does not shorten that.
        """
        loop, progress = asyncio.get_running_loop(), self._progress
        self._crew = asyncio.ensure_future(self._fly())
        if self._dismissed:
            self._crew.cancel()
        try:
            await self._crew
        except (Ended, LinkError) as error:
            progress.go(Event.ABORT, str(error), loop.time())
        except BaseException as error:
            progress.go(Event.ABORT, f"stopped by {type(error).__name__}: {error}", loop.time())
            if not (self._dismissed and isinstance(error, asyncio.CancelledError)):
                raise
        finally:
            await to_the_end(self._close())
        return Outcome(self.state, progress.reason, progress.fault)

    async def _fly(self) -> None:
        loop, progress = asyncio.get_running_loop(), self._progress
        from_floor = self._config.flight.start == "floor"
        if from_floor:
            self._pilot.stand()
        progress.go(Event.START, "waiting for the link and for poses", loop.time())
        await self._connect()
        if from_floor:
            await self._stand()
            bad, checks = self._checked()
            for one in checks:
                if one.verdict in (Verdict.WARN, Verdict.FAIL):
                    self._say(f"pre-flight {one.verdict}: {one.name}: {one.says}")
            if bad:
                raise Ended(f"pre-flight checks failed: {bad}")
        status = self._source.status
        poses = f"poses at {status.rate_hz:.0f} Hz, {1e3 * status.latency_s:.0f} ms late"
        progress.go(Event.CONNECTED, f"link and poses are there; {poses}", loop.time())
        await self._operator()
        if from_floor:
            bad, _ = self._checked()
            if bad:
                raise Ended(f"not armed: {bad}")
        self._checked_last = ()
        progress.go(Event.ARM, "asking the autopilot to obey and to arm", loop.time())
        await self._sender.fly(Event.ARMED if from_floor else Event.AIRBORNE)

    async def check(self) -> list[Check]:
        """Connect, look at everything as before a flight, and disconnect; instead of :meth:`run`."""
        try:
            await self._connect()
            await self._stand()
            return self._checked()[1]
        except (Ended, LinkError, OSError) as error:
            return [Check("connection", Verdict.FAIL, str(error))]
        finally:
            await to_the_end(self._close())

    async def _stand(self) -> None:
        """Look at the vehicle as it stands for a moment."""
        self._checks = Checks(self._config, self._others)
        await asyncio.sleep(LOOK_S)

    def _checked(self) -> tuple[str, list[Check]]:
        """What fails, and all checks."""
        assert self._checks is not None, "nobody has looked yet"
        now = asyncio.get_running_loop().time()
        checks = self._checks(self._progress.standing, self._pilot.noise_m, self._link.status, now)
        self._checked_last = tuple(checks)
        return failed(checks), checks

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

    async def _operator(self) -> None:
        """Wait until somebody asks to arm: at the terminal, or by a request."""
        confirmed, asked = asyncio.ensure_future(self._confirm()), asyncio.ensure_future(self._arm_asked.wait())
        try:
            while not (confirmed.done() or asked.done()):
                if self._checks is not None:
                    self._checked()  # for the screens: whoever arms sees the vehicle as it stands now
                await asyncio.wait({confirmed, asked}, timeout=LOOK_AGAIN_S, return_when=asyncio.FIRST_COMPLETED)
            if not asked.done() and not confirmed.result():
                raise Ended("not armed: the operator did not confirm")
        finally:
            for task in (confirmed, asked):
                task.cancel()
            await asyncio.gather(confirmed, asked, return_exceptions=True)

    async def _close(self) -> None:
        """Close the link, which may have to bring down first, and tell what it does."""
        link = self._link
        if self._kill is None and link.status.phase in ("fresh", "bring_down"):
            self._say("bringing down: the link levels, sinks and stops by itself")
            await link.silent()
            if self._kill is None:
                self._say("the bring-down is over: nothing leaves any more")
        await self._feed()
        if self._kill is not None:
            try:
                await self._kill
                self._say("the vehicle has acknowledged: motors off")
            except LinkError as error:
                self._say(f"NOT acknowledged: {error}")
        self._closed = True
        await link.close()
        await self._source.close()

    async def _feed(self) -> None:
        """The autopilot may fly by the poses that it gets from us: they do not end with our commands."""
        if self._config.forwards is None or not self._turns():
            return
        asked = self._feeding = asyncio.Event()
        self._say("poses go on to the autopilot until its motors stop; a second Ctrl-C ends them too")
        while self._turns() and not asked.is_set():
            with suppress(TimeoutError):
                await asyncio.wait_for(asked.wait(), FEED_LOOK_S)
        why = "as asked" if asked.is_set() else "its motors have stopped, or it is heard no more"
        self._say(f"no more poses to the autopilot: {why}")
        self._feeding = None

    def _turns(self) -> bool:
        return self._kill is None and self._link.status.state == "armed"

    # ---- what comes in, and what is told

    def _pose(self, pose: Pose) -> None:
        if self._sender.pose(pose):
            self._scoreboard.pose(pose)
            self._first_pose.set()

    def _entered(self, state: State, reason: str) -> None:
        if state in FINAL and state is not State.LANDED:  # no more commands from here: what follows is the link's
            self._dismissed = True
            if self._crew is not None:
                self._crew.cancel()
        if self._on_state is not None:
            self._on_state(state, reason)

    def _flown(self, tick: Tick) -> None:
        self._scoreboard.tick(tick, counts=self.state is State.TRACKING and tick.flight_time_s >= 0.0)
        if tick.seen.warning:
            self._say(f"warning: {tick.seen.warning}")
        step, told = self._live.flown(
            tick.time_s,
            tick.estimate,
            tick.reference,
            tick.decision.diagnostics.v_known,
            counts=self.state in (State.HOLD, State.TRACKING),
        )
        if step is not None:
            self._pilot.gain(*step)
        if told:
            self._say(told)
        if self._on_tick is not None:
            self._on_tick(tick)
        self._quiet.begin()

    def _say(self, text: str) -> None:
        line = f"{asyncio.get_running_loop().time():.3f} {text}"
        self._scoreboard.event(line)
        if self._on_event is not None:
            self._on_event(line)
