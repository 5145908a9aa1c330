"""``groundstation check --watch``: any pose source live, without flying."""

import asyncio
import contextlib
import json
import math
import signal
import sys
from collections.abc import Callable, Iterator

import msgspec

from groundstation.core.messages.pose import PoseEvent, SourceError
from groundstation.lab.pose_monitor.ears import Ears, ears
from groundstation.lab.pose_monitor.seen import Seen, Watcher
from groundstation.pose.kinds import Recorded
from groundstation.runtime.entry import bare
from groundstation.settings.settings import Config
from links.core.port import LinkError

EXIT_POSES, EXIT_NO_POSES, EXIT_NO_SOURCE = 0, 1, 3
JSON_S = 5.0
"""How long a look for a program takes, where it does not say [s]."""
REFRESH_S = 0.25


def watch(config: Config, *, seconds: float | None, as_json: bool) -> int:
    """Watch until ``seconds`` [s] have passed, or Ctrl-C; returns 0 where poses came, 1 where none did, 3 without any.

    Raises:
        ConfigError: the poses need another link.
    """
    kind = str(config.pose.__struct_config__.tag)
    try:
        if as_json:
            seen = asyncio.run(listened(config, seconds or JSON_S))
            print(json.dumps({"source": kind, "ok": seen.ok, **msgspec.to_builtins(seen)}))
        else:
            seen = asyncio.run(_shown(config, seconds, f"{kind} poses of {config.vehicle.name}: Ctrl-C ends"))
    except (SourceError, LinkError) as error:
        print(f"groundstation: check: {error}", file=sys.stderr)
        if as_json:
            print(json.dumps({"source": kind, "ok": False, "error": str(error)}))
        return EXIT_NO_SOURCE
    return EXIT_POSES if seen.ok else EXIT_NO_POSES


async def listened(config: Config, seconds: float | None, show: Callable[[Seen], None] | None = None) -> Seen:
    """What the source of ``config`` is like after ``seconds`` [s]; ``show`` is called a few times a second.

    Raises:
        ConfigError: the poses need another link.
        SourceError: the source can't be started.
        LinkError: the autopilot, by which the poses would come, does not answer.
    """
    loop = asyncio.get_running_loop()
    watcher = Watcher(loop.time(), recorded=isinstance(config.pose, Recorded))

    def tell(event: PoseEvent) -> None:
        watcher.event(event, loop.time())

    def look(open_ears: Ears) -> Seen:
        return watcher.seen(loop.time(), open_ears.source.status, open_ears.names())

    with _interrupt(loop) as stopped:
        async with ears(config, watcher.pose, tell=tell) as open_ears:
            left_s = math.inf if seconds is None else seconds
            while left_s > 0.0 and not stopped.is_set():
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(stopped.wait(), min(REFRESH_S, left_s))
                left_s -= REFRESH_S
                if show is not None:
                    show(look(open_ears))
            return look(open_ears)


async def _shown(config: Config, seconds: float | None, title: str) -> Seen:
    from rich.console import Console
    from rich.live import Live

    from groundstation.lab.pose_monitor.table import table

    console = Console(file=bare(sys.stdout))
    if not console.is_terminal:  # a pipe gets the end of it only
        seen = await listened(config, seconds)
        console.print(table(title, seen))
        return seen
    with Live(console=console, auto_refresh=False) as live:
        return await listened(config, seconds, lambda seen: live.update(table(title, seen), refresh=True))


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
