"""Both event loops that application code runs on, for tests of what must work on either."""

import asyncio
import contextlib
import gc
import inspect
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, MutableSequence
from contextvars import Context, ContextVar
from functools import wraps
from heapq import heapify, heappush
from typing import Any, ParamSpec, Protocol, TypeVar

import pytest

from sim.time import VirtualTimeLoop, in_virtual_time

P = ParamSpec("P")
T = TypeVar("T")
Run = Callable[[Callable[..., Coroutine[Any, Any, Any]]], Callable[..., Any]]
"""A decorator that makes a coroutine function a plain one, which runs on one of the two."""


def in_real_time(work: Callable[P, Coroutine[Any, Any, T]]) -> Callable[P, T]:
    """Return ``work`` as a plain function that runs in real time, on real sockets.

    What thousands of tests have left behind is not searched for garbage meanwhile: that takes as
    long as a dead-man waits. The programs do the same before they fly.
    """

    @wraps(work)
    def run(*args: P.args, **options: P.kwargs) -> T:
        gc.freeze()
        try:
            return asyncio.run(work(*args, **options))
        finally:
            gc.unfreeze()

    return run


Scene = Callable[..., Awaitable[None]]
"""A test as a coroutine function, whose first arguments its stage gives."""


def on_stage(stage: Callable[[Scene], None], count: int) -> Callable[[Scene], Callable[..., None]]:
    """Return a decorator for tests: ``stage`` gives their first ``count`` arguments."""

    def decorate(test: Scene) -> Callable[..., None]:
        @wraps(test)
        def run(**others: Any) -> None:
            stage(lambda *first: test(*first, **others))

        signature = inspect.signature(test)
        others = list(signature.parameters.values())[count:]
        run.__signature__ = signature.replace(parameters=others)  # type: ignore[attr-defined]  # pytest reads it
        return run

    return decorate


BOTH_LOOPS = [
    pytest.param(in_virtual_time, id="virtual"),
    pytest.param(in_real_time, id="real", marks=pytest.mark.real_time),
]
"""Parameters of a test or a fixture, for what must work on either loop."""


def on_either_loop(test: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., None]:
    """Make two tests of a coroutine function: one in virtual time, one in real time."""

    @wraps(test)
    def run(loop: Run, **others: Any) -> None:
        loop(test)(**others)

    signature = inspect.signature(test)
    loop = inspect.Parameter("loop", inspect.Parameter.POSITIONAL_OR_KEYWORD)
    run.__signature__ = signature.replace(parameters=[loop, *signature.parameters.values()])  # type: ignore[attr-defined]  # pytest reads it
    decorated: Callable[..., None] = pytest.mark.parametrize("loop", BOTH_LOOPS)(run)
    return decorated


def is_virtual() -> bool:
    """Whether the running loop is one of virtual time."""
    return isinstance(asyncio.get_running_loop(), VirtualTimeLoop)


async def until(true: Callable[[], Any], within_s: float = 60.0) -> None:
    """Wait for it."""
    async with asyncio.timeout(within_s):
        while not true():
            await asyncio.sleep(0.005)


class Part(Protocol):
    """A flight, a simulated side, an autopilot at its socket."""

    def run(self) -> Coroutine[Any, Any, Any]:
        """Go on until cancelled."""


R = TypeVar("R", bound=Part)


@contextlib.asynccontextmanager
async def running(part: R) -> AsyncIterator[R]:
    """Within it ``part`` runs."""
    task = asyncio.create_task(part.run())
    try:
        yield part
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


async def free_address() -> str:
    """An address of this machine, host:port, at which nobody listens."""
    loop = asyncio.get_running_loop()
    transport, _ = await loop.create_datagram_endpoint(
        asyncio.DatagramProtocol, local_addr=("127.0.0.1", 0)
    )
    host, port = transport.get_extra_info("sockname")[:2]
    transport.close()
    await asyncio.sleep(0)
    return f"{host}:{port}"


class Inbox(asyncio.DatagramProtocol):
    """An end that keeps what comes: when [s], the bytes, and from where."""

    transport: Any

    def __init__(self) -> None:
        self.got: list[tuple[float, bytes, Any]] = []

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Know the way out, too."""
        self.transport = transport

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """Keep it."""
        self.got.append((asyncio.get_running_loop().time(), data, addr))

    @property
    def heard(self) -> list[bytes]:
        """The bytes alone."""
        return [data for _, data, _ in self.got]


H = TypeVar("H", bound=asyncio.Handle)


def _move(which: Callable[[H], bool], source: MutableSequence[H], target: list[H]) -> None:
    """Move the handles for which ``which`` is true from ``source`` to the end of ``target``."""
    for handle in [handle for handle in source if which(handle)]:
        source.remove(handle)
        target.append(handle)


class SuspendableLoop(VirtualTimeLoop):
    """Loop of virtual time on which one process may stand still while the rest goes on."""

    _ready: deque[asyncio.Handle]  # asyncio's own, of which typeshed does not tell
    _scheduled: list[asyncio.TimerHandle]

    def __init__(self) -> None:
        super().__init__()
        self._suspended: ContextVar[bool] | None = None
        self._held: list[asyncio.Handle] = []
        self._held_timers: list[asyncio.TimerHandle] = []

    def suspend(self, process: ContextVar[bool]) -> None:
        """Hold back the timers and datagrams of ``process`` until :meth:`resume`."""
        self._suspended = process

    def resume(self) -> None:
        """Let what was suspended go on: all that has waited is due now, in its order."""
        self._suspended = None
        self._ready.extend(self._held)
        for timer in self._held_timers:
            heappush(self._scheduled, timer)
        self._held, self._held_timers = [], []

    def _run_once(self) -> None:
        if self._suspended is not None:
            _move(self._is_suspended, self._ready, self._held)
            _move(self._is_suspended, self._scheduled, self._held_timers)
            heapify(self._scheduled)
        super()._run_once()  # type: ignore[misc]  # asyncio's own, of which typeshed does not tell

    def _is_suspended(self, handle: asyncio.Handle) -> bool:
        context: Context = handle._context  # type: ignore[attr-defined]  # as above
        return self._suspended is not None and context.get(self._suspended, False)


def in_suspendable_time(work: Callable[P, Coroutine[Any, Any, T]]) -> Callable[P, T]:
    """Return ``work`` as a plain function that runs on a :class:`SuspendableLoop`."""
    return in_virtual_time(work, SuspendableLoop)
