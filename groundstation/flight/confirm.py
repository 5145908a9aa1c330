"""Who says that the motors may start: the operator, by the vehicle's name, at the terminal or with ``--arm``."""

import asyncio
import sys
from collections.abc import Awaitable, Callable

from groundstation.config import ConfigError
from groundstation.settings import Config


def ensure_named(arm: str | None, config: Config) -> None:
    """``--arm`` must name the vehicle of the config: the operator says which one will move.

    Raises:
        ConfigError: it names another.
    """
    if arm is not None and arm != config.vehicle.name:
        raise ConfigError("--arm", f"expected {config.vehicle.name!r}, the vehicle in the config, got {arm!r}")


def confirmation(config: Config, arm: str | None) -> Callable[[], Awaitable[bool]]:
    """Who confirms arming: ``--arm``, or the operator at the terminal."""

    async def told() -> bool:
        return True

    async def asked() -> bool:
        name = config.vehicle.name
        prompt = f"{name} is ready. Its motors will start. Type its name to arm, anything else to stop: "
        answer = await line_from_terminal(prompt)
        return answer.strip() == name

    return told if arm is not None else asked


async def line_from_terminal(prompt: str) -> str:
    """One line from the terminal, without blocking the event loop; empty at its end."""
    loop = asyncio.get_running_loop()
    line: asyncio.Future[str] = loop.create_future()

    def read() -> None:
        if not line.done():
            line.set_result(sys.stdin.readline())

    print(prompt, end="", flush=True)
    loop.add_reader(sys.stdin.fileno(), read)
    try:
        return await line
    finally:
        loop.remove_reader(sys.stdin.fileno())
