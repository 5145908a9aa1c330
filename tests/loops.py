"""Both event loops that application code runs on, for tests of what must work on either."""

import asyncio
import gc
from collections.abc import Callable, Coroutine
from typing import Any, TypeVar

import pytest

from sim.time import VirtualTimeLoop

T = TypeVar("T")
Run = Callable[[Coroutine[Any, Any, T]], T]


def in_virtual_time(main: Coroutine[Any, Any, T]) -> T:
    """Run ``main`` in virtual time, on the network in memory."""
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(main)


def in_real_time(main: Coroutine[Any, Any, T]) -> T:
    """Run ``main`` in real time, on real sockets.

    What thousands of tests have left behind is not searched for garbage meanwhile: that takes as long as a dead-man
    waits. The programs do the same before they fly.
    """
    gc.freeze()
    try:
        return asyncio.run(main)
    finally:
        gc.unfreeze()


BOTH_LOOPS = [
    pytest.param(in_virtual_time, id="virtual"),
    pytest.param(in_real_time, id="real", marks=pytest.mark.real_time),
]
"""Parameters of a test or a fixture, for what must work on either loop."""


async def free_address() -> str:
    """An address of this machine, host:port, at which nobody listens."""
    loop = asyncio.get_running_loop()
    transport, _ = await loop.create_datagram_endpoint(asyncio.DatagramProtocol, local_addr=("127.0.0.1", 0))
    host, port = transport.get_extra_info("sockname")[:2]
    transport.close()
    await asyncio.sleep(0)
    return f"{host}:{port}"
