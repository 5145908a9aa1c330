"""Prompts: the operator's confirmation that the motors may start."""

import asyncio
import os
import sys

from groundstation.config import ConfigError
from groundstation.core.messages import notice
from groundstation.settings import Config

LISTEN_S = 1.2
"""Time of listening before the first checks, and before an arming that nobody types [s]: autopilots
send one heartbeat a second, and another one with the same id must be heard before. Poses of that
time make the first checks."""


def ensure_named(arm: str | None, config: Config) -> None:
    """Require that ``--arm`` names the vehicle of the configuration: the operator must know which
    one will move.

    Raises:
        ConfigError: it names another.
    """
    if arm is not None and arm != config.vehicle.name:
        raise ConfigError("--arm", notice("arm.other", vehicle=config.vehicle.name, found=arm))


async def confirm_arming(config: Config, arm: str | None) -> bool:
    """Return whether arming is confirmed: soon with ``--arm``, else by asking the operator at the
    terminal.
    """
    if arm is not None:
        if config.flight.start == "air":  # from the floor, the checks have listened
            await asyncio.sleep(LISTEN_S)
        return True
    name, rehearsal = config.vehicle.name, config.rehearsal
    prompt = notice("arm.prompt", vehicle=name)
    if rehearsal is not None:
        prompt = notice("arm.prompt_rehearsal", rehearsed=rehearsal.vehicle, vehicle=name)
    answer = await line_from_terminal(notice("arm.question", prompt=prompt).text)
    return answer.strip() == name


async def line_from_terminal(prompt: str) -> str:
    """Read one line from the terminal without blocking the event loop.

    Empty at the end of the input. A terminal hands over a part of a line at Ctrl-D: waiting for the
    rest would stop the station and its signals.
    """
    loop, terminal = asyncio.get_running_loop(), sys.stdin.fileno()
    line: asyncio.Future[bytes] = loop.create_future()
    typed = bytearray()

    def read() -> None:
        part = os.read(terminal, 4096)
        typed.extend(part)
        if not line.done() and (not part or b"\n" in part):
            line.set_result(bytes(typed))

    print(prompt, end="", flush=True)
    loop.add_reader(terminal, read)
    try:
        return (await line).decode(errors="replace")
    finally:
        loop.remove_reader(terminal)
