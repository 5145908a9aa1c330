"""Waiting until an instant on the event loop's clock, exactly and without drift."""

import asyncio


async def sleep_until(when_s: float) -> None:
    """Sleep until ``when_s`` on the event loop's clock [s]; give way once where that has passed."""
    loop = asyncio.get_running_loop()
    if when_s <= loop.time():
        await asyncio.sleep(0)
        return
    future: asyncio.Future[None] = loop.create_future()
    handle = loop.call_at(when_s, _wake, future)
    try:
        await future
    finally:
        handle.cancel()


def _wake(future: "asyncio.Future[None]") -> None:
    if not future.done():
        future.set_result(None)
