"""Pose monitor: any pose source live, as ``groundstation check --watch`` shows it, without flying.

No command link is opened, so nothing that moves a vehicle can leave.
"""

import asyncio
import contextlib
import json
import math
import signal
import sys
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING

import msgspec

from groundstation.core.geometry import Vec3
from groundstation.core.messages import OverheardSource, Pose, PoseEvent, PoseSource, SourceError
from groundstation.lab.pose_stream import PoseStreamMonitor, PoseStreamSummary
from groundstation.pose import HINTS, GatedSource, make_source
from groundstation.runtime import raw_stream
from groundstation.settings import Config
from links import make_link
from links.core import LinkError, printable
from links.mavlink import MavlinkConnection, MavlinkLink, MavlinkLinkConfig

if TYPE_CHECKING:
    from rich.table import Table


class Ears(msgspec.Struct, frozen=True):
    """What is open."""

    source: PoseSource
    """Behind the gate."""
    connection: MavlinkConnection | None
    """To the autopilot, where that was wanted; only what it is asked for, and our heartbeat, leave on it."""
    names: Callable[[], tuple[str, ...]]
    """The bodies that the source has, where it has told."""


@asynccontextmanager
async def open_ears(
    config: Config,
    deliver: Callable[[Pose], None],
    *,
    raw: Callable[[Pose], None] | None = None,
    tell: Callable[[PoseEvent], None],
    autopilot: Callable[[MavlinkConnection], None] | None = None,
) -> AsyncIterator[Ears]:
    """Listen to the poses of ``config`` for as long as the block lasts.

    ``deliver`` gets those that pass the gate, ``raw`` every one, ``tell`` what happens to them. The autopilot is
    connected to where poses come by it, or where ``autopilot`` is given: it may ask for messages before.

    Raises:
        ConfigError: the poses need another link.
        SourceError: the source can't be started.
        LinkError: the autopilot does not answer.
    """
    settings = config.link
    if isinstance(settings, MavlinkLinkConfig):  # what it sends to others is none of our business
        settings = msgspec.structs.replace(settings, quiet=False)
    link = make_link(settings, thrust_max_n=config.full_thrust_n, thrust_curve=config.thrust_curve)
    inner = make_source(config.pose, link)
    heard = inner if raw is None else OverheardSource(inner, raw)
    source = GatedSource(heard, config.gate, asyncio.get_running_loop, lost_s=config.flight.coast_s, tell=tell)
    connection = None
    if isinstance(link, MavlinkLink) and (autopilot is not None or config.pose.by_autopilot):
        connection = link.connection
        if autopilot is not None:
            autopilot(connection)
    try:
        await source.start(deliver)
        if connection is not None:
            await connection.open()
        yield Ears(source, connection, lambda: getattr(inner, "other_objects", ()))
    finally:
        await source.close()
        if connection is not None:
            connection.close()
        await asyncio.sleep(0)  # sockets are released in the loop's next turn


EXIT_POSES, EXIT_NO_POSES, EXIT_NO_SOURCE = 0, 1, 3
JSON_S = 5.0
"""How long a look for a program takes, where it does not say [s]."""
REFRESH_S = 0.25


def watch_poses(config: Config, *, seconds: float | None, as_json: bool) -> int:
    """Watch until ``seconds`` [s] have passed, or Ctrl-C; returns 0 where poses came, 1 where none did, 3 without any.

    Raises:
        ConfigError: the poses need another link.
    """
    kind = str(config.pose.__struct_config__.tag)
    try:
        if as_json:
            seen = asyncio.run(listen(config, seconds or JSON_S))
            print(json.dumps({"source": kind, "ok": seen.ok, **msgspec.to_builtins(seen)}))
        else:
            seen = asyncio.run(
                _listen_on_screen(config, seconds, f"{kind} poses of {config.vehicle.name}: Ctrl-C ends")
            )
    except (SourceError, LinkError) as error:
        print(f"groundstation: check: {error}", file=sys.stderr)
        if as_json:
            print(json.dumps({"source": kind, "ok": False, "error": str(error)}))
        return EXIT_NO_SOURCE
    return EXIT_POSES if seen.ok else EXIT_NO_POSES


async def listen(
    config: Config, seconds: float | None, show: Callable[[PoseStreamSummary], None] | None = None
) -> PoseStreamSummary:
    """What the source of ``config`` is like after ``seconds`` [s]; ``show`` is called a few times a second.

    Raises:
        ConfigError: the poses need another link.
        SourceError: the source can't be started.
        LinkError: the autopilot, by which the poses would come, does not answer.
    """
    loop = asyncio.get_running_loop()
    watcher = PoseStreamMonitor(loop.time(), recorded=config.pose.recorded)

    def tell(event: PoseEvent) -> None:
        watcher.event(event, loop.time())

    def look(ears: Ears) -> PoseStreamSummary:
        return watcher.summarize(loop.time(), ears.source.status, ears.names())

    with _interrupt(loop) as stopped:
        async with open_ears(config, watcher.pose, tell=tell) as ears:
            left_s = math.inf if seconds is None else seconds
            while left_s > 0.0 and not stopped.is_set():
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(stopped.wait(), min(REFRESH_S, left_s))
                left_s -= REFRESH_S
                if show is not None:
                    show(look(ears))
            return look(ears)


async def _listen_on_screen(config: Config, seconds: float | None, title: str) -> PoseStreamSummary:
    from rich.console import Console
    from rich.live import Live

    console = Console(file=raw_stream(sys.stdout))
    if not console.is_terminal:  # a pipe gets the end of it only
        seen = await listen(config, seconds)
        console.print(summary_table(title, seen))
        return seen
    with Live(console=console, auto_refresh=False) as live:
        return await listen(config, seconds, lambda seen: live.update(summary_table(title, seen), refresh=True))


@contextlib.contextmanager
def _interrupt(loop: asyncio.AbstractEventLoop) -> Iterator[asyncio.Event]:
    """An event that Ctrl-C sets, where the loop has signals at all."""
    stopped = asyncio.Event()
    with contextlib.suppress(NotImplementedError, ValueError):
        loop.add_signal_handler(signal.SIGINT, stopped.set)
    try:
        yield stopped
    finally:
        with contextlib.suppress(NotImplementedError, ValueError):
            loop.remove_signal_handler(signal.SIGINT)


NOTHING = "nothing has come: check the address in [pose], that the tracker streams to this machine, and the firewall"
NOT_RESTING = "moves: let it stand to measure"
SHOWN_EVENTS = 5


def summary_rows(seen: PoseStreamSummary) -> list[tuple[str, str]]:
    """What is known, in words."""
    lines = [
        ("poses", f"{seen.poses}, {seen.rate_hz:.1f} per second arrive, {seen.source_rate_hz:.1f} by their stamps"),
        ("age", _age(seen)),
        ("latency", f"{1e3 * seen.latency_s:.1f} ms, longest {1e3 * seen.latency_max_s:.1f} ms"),
        ("jitter", f"{1e3 * seen.jitter_s:.1f} ms, longest wait {1e3 * seen.longest_s:.0f} ms"),
        ("gaps", f"{seen.gaps}; its clock stepped {seen.clock_steps} times{_drift(seen.drift)}"),
    ]
    if seen.position_ned is not None and seen.roll_pitch_yaw_deg is not None:
        north, east, down = seen.position_ned
        lines.append(("place", f"north {north:+.3f}  east {east:+.3f}  up {-down:+.3f} m"))
        roll, pitch, yaw = seen.roll_pitch_yaw_deg
        lines.append(("attitude", f"roll {roll:+.1f}  pitch {pitch:+.1f}  yaw {yaw:+.1f}°"))
        lines.append(("noise at rest", _noise(seen.noise_m, seen.noise_deg)))
    lines += [("dropped", f"{count} {_describe_drop(reason)}") for reason, count in seen.dropped.items()]
    if not seen.poses and not seen.dropped:
        lines.append(("", NOTHING))
    if seen.bodies:
        lines.append(("bodies there", ", ".join(map(printable, seen.bodies))))
    lines += [("", printable(event)) for event in seen.events[-SHOWN_EVENTS:]]
    return lines


def summary_table(title: str, seen: PoseStreamSummary) -> "Table":
    """The same as rich draws it."""
    from rich.table import Table
    from rich.text import Text

    drawn = Table(title=title, show_header=False, title_justify="left", min_width=72)
    drawn.add_column(style="dim", no_wrap=True)
    drawn.add_column()
    for name, text in summary_rows(seen):
        bad = name == "dropped" or (name == "age" and not seen.ok)
        drawn.add_row(name, Text(text, style="bold yellow" if bad else ""))
    return drawn


def _age(seen: PoseStreamSummary) -> str:
    if seen.recorded and seen.poses:
        return "they are recorded"
    return "no pose yet" if seen.age_s is None else f"{1e3 * seen.age_s:.0f} ms"


def _drift(drift: float | None) -> str:
    return "" if drift is None else f", drift {1e6 * drift:+.0f} ppm"


def _noise(place_m: Vec3 | None, turn_deg: Vec3 | None) -> str:
    if place_m is None or turn_deg is None:
        return NOT_RESTING
    north, east, down = (1e3 * value for value in place_m)
    roll, pitch, yaw = turn_deg
    return f"{north:.2f} {east:.2f} {down:.2f} mm  {roll:.2f} {pitch:.2f} {yaw:.2f}°"


def _describe_drop(reason: str) -> str:
    hint = HINTS.get(reason)
    return reason if hint is None else f"{reason}: {hint}"
