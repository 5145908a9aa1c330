"""Arms the vehicles of a fleet once every core stands ready: a program that still starts would disturb who flies."""

import asyncio
from contextlib import suppress
from pathlib import Path

from groundstation.core.messages.requests import Ask
from groundstation.core.mission.mission import State
from groundstation.interfaces.api.client import snapshots
from groundstation.interfaces.api.command import asked
from groundstation.runtime.place import ApiError

AGAIN_S = 0.2
"""How often a core that does not serve its socket yet is asked again [s]."""


async def until_ready(socket: Path) -> None:
    """Wait until the core that serves ``socket`` has passed its checks and waits to be armed."""
    while True:
        with suppress(OSError, ApiError):
            async for snapshot in snapshots(socket):
                if snapshot.state == State.READY:
                    return
        await asyncio.sleep(AGAIN_S)


async def armed(name: str, socket: Path) -> str:
    """Ask for the motors of ``name``; returns why that was refused, or nothing."""
    try:
        answer = await asked(Ask.ARM, name, socket, "groundstation fleet --arm")
    except (ApiError, OSError) as error:
        return str(error)
    return "" if answer.done else answer.says
