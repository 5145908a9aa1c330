"""A flight that is recorded: everything that it takes to fly it again is handed to a recorder as it happens."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

from groundstation.config import dump
from groundstation.core import Pilot, Tick
from groundstation.core.messages import Others, Pose, PoseSource, Reply, Request
from groundstation.core.mission import State
from groundstation.core.trajectory import Reference, Trajectory
from groundstation.flight import Company, Due, Flight, Outcome
from groundstation.flight.hold_to_run import HoldWatch
from groundstation.recording.records import (
    GAIN,
    About,
    Asked,
    Ended,
    Followed,
    Idled,
    Looked,
    Posed,
    Record,
    Switched,
    Ticked,
    Told,
)
from groundstation.recording.wires import Wires
from groundstation.runtime import Quiet
from groundstation.settings import Config
from links.core import Command, CommandLink
from links.mavlink import MavlinkLinkConfig

LOOK_S = 0.2
"""How often the state of link and source is noted [s]."""

Give = Callable[[Record], None]
"""Takes records in their order; never waits, never raises."""


class RecordedPilot(Pilot):
    """A pilot that hands over what it is given and what it makes of it."""

    give: Give
    due: Due

    def pose(self, pose: Pose) -> None:
        """Take one pose."""
        self.give(Posed(pose))
        super().pose(pose)

    def follow(self, trajectory: Trajectory, start_s: float) -> None:
        """Follow a new trajectory."""
        self.give(Followed(start_s))
        super().follow(trajectory, start_s)

    def stand(self) -> None:
        """Stand on the floor."""
        self._switched("stand")
        super().stand()

    def lift(self, time_s: float, hover_share: float, climb_m_s: float) -> Reference:
        """Leave the floor."""
        self._switched("lift", time_s, hover_share, climb_m_s)
        return super().lift(time_s, hover_share, climb_m_s)

    def descend(self, sink_m_s: float, *, blind: bool = False, rest_s: float = 0.0) -> None:
        """Level out and sink."""
        self._switched("descend", sink_m_s, float(blind), rest_s)
        super().descend(sink_m_s, blind=blind, rest_s=rest_s)

    def surrender(self, time_s: float, hold_s: float) -> Command:
        """Make the last command."""
        self._switched("surrender", hold_s)
        command = super().surrender(time_s, hold_s)
        self.give(Idled(time_s, command.thrust_n, command))
        return command

    def gain(self, name: str, value: float) -> None:
        """Set a gain."""
        self._switched(f"{GAIN}{name}", value)
        super().gain(name, value)

    def _switched(self, what: str, *values: float) -> None:
        self.give(Switched(asyncio.get_running_loop().time(), what, values))

    def idle(self, time_s: float, thrust_n: float) -> Command:
        """Make an idle command."""
        command = super().idle(time_s, thrust_n)
        self.due.begin()
        self.give(Idled(time_s, thrust_n, command))
        return command

    def tick(self, time_s: float) -> Tick:
        """Make a command."""
        tick = super().tick(time_s)
        self.give(Ticked(tick, self.due.late_s(time_s, tick.pose.id, tick.pose.arrival_s)))
        return tick


class RecordedFlight(Flight):
    """Implements :class:`groundstation.flight.flight.Flight`, with a recorder beside it."""

    def __init__(
        self,
        config: Config,
        link: CommandLink,
        source: PoseSource,
        *,
        give: Give,
        confirm: Callable[[], Awaitable[bool]],
        on_tick: Callable[[Tick], None] | None = None,
        on_event: Callable[[str], None] | None = None,
        on_state: Callable[[State, str], None] | None = None,
        others: Others | None = None,
        quiet: Quiet | None = None,
        company: Company | None = None,
        hold: HoldWatch | None = None,
    ) -> None:
        """As a flight; ``give`` takes the records."""
        self._recorder = give
        self._deaf = False
        self._told = on_event
        self._status_noted_s = -LOOK_S
        pilot = RecordedPilot(config.vehicle, config.controller, config.flight.coast_s, config.flight.floor_z_m)
        pilot.give, pilot.due = self._noted, Due(link)
        super().__init__(
            config,
            link,
            source,
            confirm=confirm,
            on_tick=on_tick,
            on_event=self._tell,
            on_state=on_state,
            pilot=pilot,
            others=others,
            quiet=quiet,
            company=company,
            hold=hold,
        )

    def ask(self, request: Request) -> Reply:
        """Note who asks, and do it."""
        self._give(Asked(asyncio.get_running_loop().time(), request.ask, request.why))
        return super().ask(request)

    async def run(self) -> Outcome:
        """Fly, with every wire tapped."""
        Wires(self._give).tap()
        try:
            return await super().run()
        finally:
            self._note_status()
            self._give(Ended(asyncio.get_running_loop().time(), self.state, self._progress.reason))

    def _give(self, record: Record) -> None:
        """Hand over one record. Whatever goes wrong with it, the flight goes on."""
        try:
            self._recorder(record)
        except Exception as error:  # noqa: BLE001  # a controller of the user's own may put anything into a tick
            if not self._deaf:
                self._deaf = True
                self._tell_operator(f"WARNING: a part of this flight can't be recorded: {error}")

    def _noted(self, record: Record) -> None:
        self._give(record)
        if isinstance(record, Posed):
            tick_s = self.newest_tick_s
            if tick_s is None or record.pose.arrival_s - tick_s > LOOK_S:
                self._note_status(LOOK_S)

    def _flown(self, tick: Tick) -> None:
        super()._flown(tick)
        self._note_status(LOOK_S)  # not while a pose waits for its command

    def _note_status(self, period_s: float = 0.0) -> None:
        """Note how link and source are, unless that was done within ``period_s`` [s]."""
        now = asyncio.get_running_loop().time()
        if now - self._status_noted_s >= period_s:
            self._status_noted_s = now
            self._give(Looked(now, self._link.status, self._source.status))

    def _tell(self, line: str) -> None:
        text = line.partition(" ")[2].removeprefix(f"{self.state}: ")
        self._give(Told(asyncio.get_running_loop().time(), self.state, text))
        self._tell_operator(line)

    def _tell_operator(self, line: str) -> None:
        if self._told is not None:
            self._told(line)


def about(config: Config, **more: Any) -> About:
    """What is known before the flight; ``more`` of it about a simulated one."""
    link = config.link
    return About(
        config=dump(config),
        vehicle=config.vehicle.name,
        controller=config.controller.kind,
        trajectory=str(config.trajectory.__struct_config__.tag),
        period_s=getattr(link, "period_s", 0.0) if getattr(link, "pace", "period") == "period" else 0.0,
        mavlink=link.address if isinstance(link, MavlinkLinkConfig) else "",
        **more,
    )
