"""What comes before arming: connect, look at the vehicle as it stands, and wait for whoever sends it off."""

import asyncio
from collections.abc import Awaitable, Callable

from groundstation.core import Pilot
from groundstation.core.messages import Check, Others, Pose, PoseSource, Verdict
from groundstation.core.mission import Event
from groundstation.core.safety import Witness
from groundstation.flight.checks import LOOK_S, Checks, Company, failed
from groundstation.flight.progress import Progress
from groundstation.flight.proof import on_file, place
from groundstation.flight.sender import Ended
from groundstation.pose.sources import MavlinkPoseConfig
from groundstation.settings import Config
from links.core import CommandLink, LinkError

LOOK_AGAIN_S = 1.0
"""How often the checks are made anew while the operator has not armed yet [s]."""


class Departure:
    """One flight's."""

    checks: tuple[Check, ...] = ()
    """The newest, until somebody has armed: for the screens."""

    def __init__(
        self,
        config: Config,
        link: CommandLink,
        source: PoseSource,
        pilot: Pilot,
        progress: Progress,
        witness: Witness,
        *,
        confirm: Callable[[], Awaitable[bool]],
        others: Others | None,
        say: Callable[[str], None],
        company: Company | None = None,
    ) -> None:
        """``confirm`` asks the operator before the vehicle is armed; ``others`` are vehicles to keep away from.

        ``company`` makes more checks, of what is beside the vehicle.
        """
        self._config = config
        self._link = link
        self._source = source
        self._pilot = pilot
        self._progress = progress
        self._witness = witness
        self._confirm = confirm
        self._others = others
        self._say = say
        self._company = company
        self._look: Checks | None = None
        self._arm_asked = asyncio.Event()
        self._first_pose = asyncio.Event()

    def pose(self) -> None:
        """A pose has come."""
        self._first_pose.set()

    def arm(self) -> None:
        """Somebody asks to arm."""
        self._arm_asked.set()

    async def depart(self, deliver: Callable[[Pose], None]) -> None:
        """All of it; where it returns, the vehicle may be armed. ``deliver`` gets the poses from now on.

        Raises:
            Ended: no pose comes, a check fails, or the operator does not confirm.
            LinkError: the link can't be connected.
        """
        loop, progress = asyncio.get_running_loop(), self._progress
        from_floor = self._config.flight.start == "floor"
        if from_floor:
            self._pilot.stand()
        progress.go(Event.START, "waiting for the link and for poses", loop.time())
        await self._connect(deliver)
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
            bad, _ = self._checked(arming=True)
            if bad:
                raise Ended(f"not armed: {bad}")
        self.checks = ()
        if self._company is not None:
            self._company.leave()
        self._witness.arm()

    async def check(self, deliver: Callable[[Pose], None]) -> list[Check]:
        """Connect and look, and no more; what can't be connected is a check that fails."""
        try:
            await self._connect(deliver)
            await self._stand()
            return self._checked()[1]
        except (Ended, LinkError, OSError) as error:
            return [Check("connection", Verdict.FAIL, str(error))]

    async def _stand(self) -> None:
        """Look at the vehicle as it stands for a moment."""
        self._look = Checks(self._config, self._others, on_file(place(self._config)))
        await asyncio.gather(asyncio.sleep(LOOK_S), self._link.examine())

    def _checked(self, *, arming: bool = False) -> tuple[str, list[Check]]:
        """What fails, and all checks; ``arming`` where the motors start next."""
        assert self._look is not None, "nobody has looked yet"
        now = asyncio.get_running_loop().time()
        evidence = self._witness.verdict(now)
        checks = self._look(self._progress.standing, self._pilot.noise_m, self._link.status, now, evidence)
        if self._company is not None:
            checks += self._company(self._progress.standing, now, arming=arming)
        self.checks = tuple(checks)
        return failed(checks), checks

    async def _connect(self, deliver: Callable[[Pose], None]) -> None:
        await self._source.start(deliver)
        await self._link.connect()
        wait = self._config.flight.pose_wait_s
        try:
            await asyncio.wait_for(self._first_pose.wait(), wait)
        except TimeoutError:
            raise Ended(f"no pose within {wait:g} s: {self._why_no_pose()}") from None

    def _why_no_pose(self) -> str:
        pose, dropped = self._config.pose, self._source.status.dropped
        if isinstance(pose, MavlinkPoseConfig):
            said = f"; it said last: “{self._link.status.text}”" if self._link.status.text else ""
            return (
                "the autopilot is heard but has no estimate of its position yet (pose.kind = mavlink). After a start "
                f"that takes it some 40 s, and it needs GPS or an external pose: wait for it, then try again{said}"
            )
        told = ("server", "listen", "object", "name")
        keys = ", ".join(f"pose.{key} = {getattr(pose, key)}" for key in told if hasattr(pose, key))
        hint = f"dropped so far: {dropped}" if dropped else "nothing arrived at all; check address and port"
        return f"nothing of use from pose.kind = {pose.__struct_config__.tag} ({keys}); {hint}"

    async def _operator(self) -> None:
        """Wait until somebody asks to arm: at the terminal, or by a request."""
        confirmed, asked = asyncio.ensure_future(self._confirm()), asyncio.ensure_future(self._arm_asked.wait())
        try:
            while not (confirmed.done() or asked.done()):
                if self._look is not None:
                    self._checked()  # for the screens: whoever arms sees the vehicle as it stands now
                await asyncio.wait({confirmed, asked}, timeout=LOOK_AGAIN_S, return_when=asyncio.FIRST_COMPLETED)
            if not asked.done() and not confirmed.result():
                raise Ended("not armed: the operator did not confirm")
        finally:
            for task in (confirmed, asked):
                task.cancel()
            await asyncio.gather(confirmed, asked, return_exceptions=True)
