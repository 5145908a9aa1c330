"""A flight put together from one configuration: link, pose source, gate, operator's hold, recorder."""

from collections.abc import AsyncIterator, Awaitable, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from typing import Any

from groundstation.core import Tick
from groundstation.core.messages import Others, Overheard, Pose, PoseEvent
from groundstation.core.mission import State
from groundstation.flight import Company, Flight, body_of, make_ends, make_hold
from groundstation.pose import ForwardingSource, GatedSource, ShowsOthers
from groundstation.recording.recorded_flight import Give, RecordedFlight, about
from groundstation.runtime import Quiet, Running
from groundstation.settings import Config
from links.mavlink import MavlinkLink


def make_flight(
    config: Config,
    *,
    confirm: Callable[[], Awaitable[bool]],
    on_tick: Callable[[Tick], None] | None = None,
    on_event: Callable[[str], None] | None = None,
    on_pose: Callable[[Pose], None] | None = None,
    wires: Mapping[str, Any] | None = None,
    give: Give | None = None,
    on_state: Callable[[State, str], None] | None = None,
    quiet: Quiet | None = None,
    running: Callable[[], Sequence[Running]] = tuple,
) -> Flight:
    """The parts that ``config`` names, put together; nothing is opened yet.

    ``on_pose`` sees every pose first, also those that the gate will drop; ``give`` takes what is to be recorded.
    ``wires``: see :func:`make_ends`. ``quiet`` hears of each command that left.
    ``running`` tells what else flies from this machine.

    Raises:
        ConfigError: the poses need another link.
    """
    bodies = None
    if isinstance(config.pose, ShowsOthers):
        bodies = Others(config.separation.others, own=body_of(config) if config.flight.start == "floor" else None)
    link, source = make_ends(config, wires, bodies)
    hold = make_hold(config.operator, link)
    if on_pose is not None:
        source = Overheard(source, on_pose)

    def tell(event: PoseEvent) -> None:
        flight.pose_event(event)

    source = GatedSource(source, config.gate, lost_s=config.flight.coast_s, tell=tell)
    if config.forwards is not None:
        assert isinstance(link, MavlinkLink), "only a MAVLink section says so"
        source = ForwardingSource(source, link, config.forwards)
    told: dict[str, Any] = {"confirm": confirm, "on_tick": on_tick, "on_event": on_event, "on_state": on_state}
    told |= {"others": bodies if config.separation.others else None, "quiet": quiet, "hold": hold}
    told |= {"company": Company(config, bodies, running, None if hold is None else hold.hold)}
    flight = (
        Flight(config, link, source, **told)
        if give is None
        else RecordedFlight(config, link, source, give=give, **told)
    )
    return flight


@asynccontextmanager
async def recorder(
    config: Config, say: Callable[[str], None], quiet: Quiet, keep: Callable[[], bool] = lambda: True
) -> AsyncIterator[Give | None]:
    """What records a flight in real time, in a process of its own; None where ``recording.enabled`` is false.

    Records are handed over when it is ``quiet``. ``keep`` is asked at the end whether the recording shall stay.
    """
    if not config.recording.enabled:
        yield None
        return
    from groundstation.recording.process import RecorderProcess

    process = RecorderProcess(config.recording, about(config), say, quiet)
    try:
        yield process.give
    finally:
        await process.close(keep=keep())
