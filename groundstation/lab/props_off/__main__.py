"""The hand's own process: one line with the configuration from standard input; news to standard output.

Deaf to what a terminal sends. The end of its input is the order to let go: so it disarms when its guide dies, too.
"""

import asyncio
import contextlib
import os
import signal
import sys
import tomllib

import msgspec

from groundstation.config import from_dict
from groundstation.flight import make_ends
from groundstation.lab.props_off.hand import News, disarm, hold
from groundstation.runtime import precise_loop
from groundstation.settings import Config


def main() -> int:
    """Hold it armed, or with the argument ``disarm`` disarm it."""
    for number in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM, signal.SIGQUIT, signal.SIGTSTP, signal.SIGPIPE):
        signal.signal(number, signal.SIG_IGN)
    text = msgspec.json.decode(sys.stdin.buffer.readline(), type=str)
    config = from_dict(tomllib.loads(text), Config)
    with asyncio.Runner(loop_factory=precise_loop) as runner:
        runner.run(_work(config, sys.argv[1:]))
    return 0


async def _work(config: Config, words: list[str]) -> None:
    link, source = make_ends(config)
    if words == ["disarm"]:
        await disarm(link, source, _tell)
        return
    loop = asyncio.get_running_loop()
    ordered: asyncio.Future[None] = loop.create_future()

    def end() -> None:
        loop.remove_reader(0)
        ordered.set_result(None)

    loop.add_reader(0, end)
    await hold(config, link, source, ordered, _tell)


def _tell(news: News) -> None:
    with contextlib.suppress(OSError):  # nobody guides any more: that it disarms is what counts
        os.write(1, msgspec.json.encode(news) + b"\n")


if __name__ == "__main__":
    sys.exit(main())
