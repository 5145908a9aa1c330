"""Arming sequence: connect, check, and wait until the operator arms."""

import asyncio
from collections.abc import Awaitable, Callable

from groundstation.core.messages import (
    Check,
    Others,
    Pose,
    PoseSource,
    Say,
    Sentence,
    Verdict,
    notice,
)
from groundstation.core.mission import Event
from groundstation.core.pilot import Pilot
from groundstation.flight.controller import FlightController
from groundstation.flight.preflight.checks import (
    Checks,
    SurroundingsChecks,
    describe_failures,
    explain_drops,
    report,
)
from groundstation.flight.preflight.prompts import LISTEN_S
from groundstation.flight.preflight.proof import proof_path, read_proof
from groundstation.settings import Config
from links.core import CommandLink, LinkError
from links.text import to_ms

RECHECK_S = 1.0
"""Period at which the checks are repeated until the operator arms [s]: the largest age of those on
screens."""


class FlightEnded(Exception):
    """The flight can't go on, for the reason in ``sentence``."""

    def __init__(self, sentence: Sentence) -> None:
        super().__init__(sentence.text)
        self.sentence = sentence


class ArmingSequence:
    """Sequence of one flight from connecting until the vehicle may be armed."""

    checks: tuple[Check, ...] = ()
    """Newest checks, for the screens; empty once the operator has armed."""

    def __init__(
        self,
        config: Config,
        link: CommandLink,
        source: PoseSource,
        pilot: Pilot,
        controller: FlightController,
        *,
        confirm: Callable[[], Awaitable[bool]],
        others: Others | None,
        say: Say,
        surroundings: SurroundingsChecks,
    ) -> None:
        """Open nothing yet.

        Args:
            config: the flight's.
            link: command link, to be connected.
            source: pose source, to be started.
            pilot: gets the poses; its noise estimate is checked.
            controller: the flight's.
            confirm: asks the operator before the vehicle is armed.
            others: vehicles to keep away from.
            say: takes sentences for the operator.
            surroundings: checks of the surroundings.
        """
        self._config = config
        self._link = link
        self._source = source
        self._pilot = pilot
        self._controller = controller
        self._confirm = confirm
        self._others = others
        self._say = say
        self._surroundings = surroundings
        self._checker: Checks | None = None
        self.arm_asked = asyncio.Event()
        """Event that a request to arm sets."""
        self.first_pose = asyncio.Event()
        """Event that the flight sets at its first pose."""

    async def run(self, deliver: Callable[[Pose], None]) -> None:
        """Run the whole sequence; when it returns, the vehicle may be armed.

        ``deliver`` is called with each pose from now on.

        Raises:
            FlightEnded: no pose arrives, a check fails, or the operator does not confirm.
            LinkError: the link can't be connected.
        """
        loop, controller = asyncio.get_running_loop(), self._controller
        from_floor = self._config.flight.start == "floor"
        if from_floor:
            self._pilot.set_on_floor()
        controller.go(Event.START, notice("mission.waiting"), loop.time())
        await self._connect(deliver)
        if from_floor:
            await self._examine_at_rest()
            for one in self._check():
                if one.verdict in (Verdict.WARN, Verdict.FAIL):
                    self._say(
                        notice(
                            "flight.preflight", verdict=one.verdict, check=one.name, says=one.says
                        )
                    )
            self._ensure_passed("fault.preflight")
        status = self._source.status
        ready = notice("mission.ready", rate_hz=status.rate_hz, latency_ms=to_ms(status.latency_s))
        controller.go(Event.CONNECTED, ready, loop.time())
        await self._wait_for_operator()
        if from_floor:
            self._check(arming=True)
            self._ensure_passed("fault.not_armed")
        elif controller.is_at_floor:
            raise FlightEnded(notice("fault.not_in_air"))
        self.checks = ()
        self._surroundings.leave()
        self._controller.witness.arm()

    async def check(self, deliver: Callable[[Pose], None]) -> list[Check]:
        """Connect and make the checks, without arming; a failed connection is a failed check."""
        try:
            await self._connect(deliver)
            await self._examine_at_rest()
            return self._check()
        except (FlightEnded, LinkError, OSError) as error:
            conflict = self._link.status.conflict
            found = [report("connection", Verdict.FAIL, "check.connection", why=error)]
            return (
                [*found, report("frames", Verdict.FAIL, "check.conflict", why=conflict)]
                if conflict
                else found
            )

    async def _examine_at_rest(self) -> None:
        """Collect poses of the vehicle at rest for ``LISTEN_S``, and let the link examine its
        autopilot.
        """
        self._checker = Checks(self._config, self._others, read_proof(proof_path(self._config)))
        await asyncio.gather(asyncio.sleep(LISTEN_S), self._link.examine())

    def _check(self, *, arming: bool = False) -> list[Check]:
        """Make all checks; ``arming``: the motors start next."""
        assert self._checker is not None, "_examine_at_rest comes first"
        now, standing = asyncio.get_running_loop().time(), self._controller.standing
        agreement = self._controller.witness.verdict(now)
        checks = self._checker(
            standing,
            self._pilot.state.noise_m,
            self._link.status,
            now,
            agreement,
            self._source.status,
        )
        checks += self._surroundings(standing, now, arming=arming)
        self.checks = tuple(checks)
        return checks

    def _ensure_passed(self, id: str) -> None:
        """End the flight by the sentence ``id`` if a newest check failed."""
        if bad := describe_failures(self.checks):
            raise FlightEnded(notice(id, failed=bad))

    async def _connect(self, deliver: Callable[[Pose], None]) -> None:
        """Start the pose source, connect the link, and wait for the first pose."""
        await self._source.start(deliver)
        await self._link.connect()
        wait = self._config.flight.pose_wait_s
        try:
            async with asyncio.timeout(wait):
                await self.first_pose.wait()
        except TimeoutError:
            raise FlightEnded(
                notice("fault.no_first_pose", wait_s=wait, why=self._explain_silence())
            ) from None

    def _explain_silence(self) -> Sentence:
        """Return why no pose has arrived."""
        pose = self._config.pose
        if pose.by_autopilot:
            said = f"; it said last: “{self._link.status.text}”" if self._link.status.text else ""
            if hint := explain_drops(self._source.status):
                said = f"; {hint}{said}"
            return notice("pose.no_estimate", said=said)
        settings = {pose.address_key: pose.address, pose.body_key: pose.body_name}
        keys = ", ".join(f"pose.{key} = {value}" for key, value in settings.items() if key)
        why = explain_drops(self._source.status) or notice("pose.nothing_arrived")
        return notice("pose.nothing_of_use", kind=pose.kind, keys=keys, why=why)

    async def _wait_for_operator(self) -> None:
        """Wait until the operator arms: at the terminal, or by a request."""
        confirmed = asyncio.ensure_future(self._confirm())
        asked = asyncio.ensure_future(self.arm_asked.wait())
        try:
            while not (confirmed.done() or asked.done()):
                if self._checker is not None:
                    self._check()  # the screens show the present checks until the operator arms
                await asyncio.wait(
                    {confirmed, asked}, timeout=RECHECK_S, return_when=asyncio.FIRST_COMPLETED
                )
            if not asked.done() and not confirmed.result():
                raise FlightEnded(notice("fault.not_confirmed"))
        finally:
            for task in (confirmed, asked):
                task.cancel()
            await asyncio.gather(confirmed, asked, return_exceptions=True)
