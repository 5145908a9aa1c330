"""Browser view: ``groundstation tui --browser``, a page for the browsers of this machine, which may only look.

Every page that is opened has a dashboard of its own, a process that ends with it. There are no passwords, so it listens
on loopback alone, and answers only what asks for it by that name and from that page: a page of somebody else's, open in
the same browser, can't look too.
"""

import logging
import shlex
from collections.abc import Awaitable, Callable
from pathlib import Path

from aiohttp import web
from textual_serve.server import Server

from groundstation.config import ConfigError

HOST = "127.0.0.1"
_NAMES = (HOST, "localhost")


def serve(words: list[str], port: int, title: str) -> None:
    """Serve the program that ``words`` start until Ctrl-C.

    Raises:
        ConfigError: the port can't be listened at.
    """
    logging.getLogger("aiohttp").setLevel(logging.WARNING)
    page = _BrowserServer(shlex.join(words), HOST, port, title, templates_path=Path(__file__).parent)

    def listening(*_: object) -> None:
        print(f"{title}, to look at only: http://{HOST}:{port}  (Ctrl-C ends this)", flush=True)

    try:
        web.run_app(page.app(), host=HOST, port=port, print=listening)
    except OSError as error:
        raise ConfigError(
            "--browser", f"cannot listen at {HOST}:{port} ({error.strerror}): another port may be free"
        ) from None


class _BrowserServer(Server):
    async def app(self) -> web.Application:
        app = await self._make_app()
        app.middlewares.append(_only_ours)
        return app

    async def on_startup(self, app: web.Application) -> None:
        """Say nothing yet: nobody listens before it."""


@web.middleware
async def _only_ours(
    request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
) -> web.StreamResponse:
    """Refuse what a page of somebody else's asks for, by its name for this machine or by its own."""
    origin = request.headers.get("Origin", f"http://{request.host}")
    if request.host.rpartition(":")[0] not in _NAMES or origin != f"http://{request.host}":
        raise web.HTTPForbidden(text=f"only http://{HOST} may look: use its address, and its own page\n")
    return await handler(request)
