"""Requests to an autopilot that wait for no other: the landing of a vehicle that nobody steers, and motors off."""

import asyncio

from links.mavlink.connection import MavlinkConnection
from links.mavlink.procedures.steps import Step

LOOK_S = 0.01
"""How often such a request looks at the time [s]."""


async def beside(connection: MavlinkConnection, step: Step) -> None:
    """Go through ``step`` without waiting for hand-shakes that are under way.

    Raises:
        LinkError: it failed.
    """
    loop = asyncio.get_running_loop()
    leave = connection.subscribe(step.hear)
    try:
        while True:
            for frame in step.poll(loop.time()):
                connection.leave(frame)
            if step.failure is not None:
                raise step.failure
            if step.done:
                return
            await asyncio.sleep(LOOK_S)
    finally:
        leave()
