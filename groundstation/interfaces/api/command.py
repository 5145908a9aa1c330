"""``groundstation request``: one order to a running ground station, from a shell."""

import asyncio
import sys
from pathlib import Path

from groundstation.core.messages import Ask, Request
from groundstation.interfaces.api.client import attached
from groundstation.interfaces.api.desk import ANYONE
from groundstation.interfaces.api.messages import Answer
from groundstation.runtime import ApiError, find

EXIT_DONE, EXIT_REFUSED, EXIT_NOBODY = 0, 1, 2


def request_command(ask: Ask, vehicle: str | None, socket: Path | None, why: str) -> int:
    """Ask, print the answer, and return 0 where it is done, 1 where it is refused, 2 where nobody is there."""
    try:
        answer = asyncio.run(asked(ask, vehicle, socket, why))
    except (ApiError, OSError) as error:
        says = f"{socket}: {error.strerror}" if isinstance(error, OSError) and error.filename is None else error
        print(f"groundstation: request: {says}", file=sys.stderr)
        return EXIT_NOBODY
    print(answer.says)
    return EXIT_DONE if answer.done else EXIT_REFUSED


async def asked(ask: Ask, vehicle: str | None, socket: Path | None, why: str) -> Answer:
    """What the ground station answers; control is taken for as long as it takes, where it is needed.

    Raises:
        ApiError: nobody flies it, or it is not clear who is meant.
        OSError: the socket can't be opened.
    """
    path = socket or await find(vehicle)
    async with attached(path, "request") as client:
        served = client.hello.vehicle
        if ask is Ask.ARM and vehicle is None:
            raise ApiError(f"arm moves the vehicle, and must name it: --vehicle {served}")
        if vehicle is not None and vehicle != served:
            raise ApiError(f"{path}: the vehicle there is {served!r}, not {vehicle!r}")
        if ask not in ANYONE:
            taken = await client.take_control()
            if not taken.done:
                return taken
        return await client.ask(Request(ask, why), vehicle=vehicle or "")
