"""Attaches to a running ground station: the newest snapshot, who holds control, and orders with their answers.

::

    async with attached(path) as client:
        print(client.hello.vehicle)
        answer = await client.ask(Request(Ask.LAND, "too windy"))
        async for message in client:  # Snapshot or Control; ends when the ground station does
            ...
"""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from groundstation.core.messages.snapshot import Snapshot
from groundstation.interfaces.api.connection import ANSWER_S, Client
from groundstation.runtime.place import ApiError, owner


async def attach(path: Path, name: str = "client") -> Client:
    """A client of the ground station at ``path``, to be closed after use; see :func:`attached`.

    Raises:
        OSError: nobody serves there.
        ApiError: what serves there is no ground station of this version, has too many clients, or is another user's.
    """
    loop = asyncio.get_running_loop()
    try:
        _, client = await loop.create_unix_connection(lambda: Client(path, name), str(path))
    except PermissionError:
        whose = owner(path)
        raise ApiError(f"{path} is for user {whose} alone: do the same as that user, by sudo -u {whose}") from None
    try:
        await asyncio.wait_for(client.ready, ANSWER_S)
    except BaseException as error:
        client.close()
        if isinstance(error, TimeoutError):
            raise ApiError(f"{path}: no greeting within {ANSWER_S:g} s") from None
        raise
    return client


@asynccontextmanager
async def attached(path: Path, name: str = "client") -> AsyncIterator[Client]:
    """A client of the ground station at ``path``; leaving gives up what control it has.

    Raises:
        OSError: nobody serves there.
        ApiError: what serves there is no ground station of this version, or has too many clients.
    """
    client = await attach(path, name)
    try:
        yield client
    finally:
        client.close()


async def snapshots(path: Path) -> AsyncIterator[Snapshot]:
    """The snapshots served at ``path``, the newest where several wait; ends when the server closes.

    Raises:
        OSError: nobody serves there.
        ApiError: what is served there is not this protocol.
    """
    client = await attach(path)
    try:
        async for message in client:
            if isinstance(message, Snapshot):
                yield message
    finally:
        client.close()
