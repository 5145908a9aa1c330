"""End of one flight: bring-down or kill, poses to an autopilot that uses them, closed wires."""

import asyncio

from groundstation.core.messages import Distrusts, PoseSource, Say, notice
from groundstation.flight.command_loop import LINK_CHECK_S
from groundstation.machine import wait_at_most
from links.core import CommandLink, LinkError

MONITORED_S = 30.0
"""An autopilot that lands by itself is monitored, and can be killed, for this long after the last
command [s]."""


class Shutdown:
    """End of one flight: the bring-down, or a kill.

    Poses to an autopilot that uses them; closed wires.
    """

    closed = False
    """Whether nothing leaves any more."""

    def __init__(self, link: CommandLink, source: PoseSource, say: Say, *, forwards: bool) -> None:
        self._link = link
        self._source = source
        self._say = say
        self.forwards = forwards
        """Whether the autopilot gets the poses of the source."""
        self.is_monitoring = False
        """Whether commands have ended while the autopilot is still monitored, and gets poses if it
        did before."""
        self.stop_monitoring = asyncio.Event()
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
        """Close the link, which may have to bring the vehicle down first, and the source.

        Report each step.
        """
        link = self._link
        if self._kill is None and link.status.phase in ("fresh", "bring_down"):
            self._say(notice("flight.bringing_down"))
            if link.autopilot is not None:
                link.autopilot.land()
            await link.silent()
            if not self.killed and not link.status.unmet:
                taken = link.status.taken
                self._say(
                    notice("flight.taken", mode=taken)
                    if taken
                    else notice("flight.bring_down_over")
                )
        if not self.killed and link.status.unmet:
            self._say(notice("flight.not_brought_down", why=link.status.unmet))
        await self._monitor_landing()
        if self._kill is not None:
            try:
                await self._kill
                self._say(notice("flight.motors_off"))
            except LinkError as error:
                self._say(notice("flight.kill_unheard", why=error))
        self.closed = True
        await link.close()
        await self._source.close()

    async def _monitor_landing(self) -> None:
        """Keep the poses to an autopilot that brings the vehicle down with them, and the way to
        stop its motors.

        An autopilot that uses no poses of ours is monitored for a limited time.
        """
        autopilot = self._link.autopilot
        if not (
            self._are_motors_on()
            and (self.forwards or (autopilot is not None and autopilot.lands_by_itself))
        ):
            return
        now_s = asyncio.get_running_loop().time
        until_s = now_s() + MONITORED_S
        self.is_monitoring = True
        self._say(notice("flight.poses_go_on" if self.forwards else "flight.still_heard"))
        stop = self.stop_monitoring
        while self._are_motors_on() and not stop.is_set() and (self.forwards or now_s() < until_s):
            await wait_at_most(stop.wait(), LINK_CHECK_S)
        self.is_monitoring = False
        if self.killed:
            return
        if stop.is_set():
            self._say(notice("flight.left_as_asked"))
        elif self._are_motors_on():
            self._say(notice("flight.left_turning", limit_s=MONITORED_S))
        else:
            self._say(notice("flight.left_stopped"))

    def _are_motors_on(self) -> bool:
        """Whether the motors may turn: the autopilot is armed, and nobody has ordered them off."""
        return self._kill is None and self._link.status.state == "armed"
