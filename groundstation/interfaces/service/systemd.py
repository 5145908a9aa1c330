"""systemd: the unit of a daemon (docs/how-to/run-as-a-service.md), and sd_notify(3) without its library."""

import asyncio
import os
import shlex
import socket as sockets  # names the family; opens no socket
import sys
from collections.abc import Mapping
from pathlib import Path
from string import Template

from groundstation.core.safety import CERTAIN_S
from groundstation.flight import DISARM_WAIT_S, examine_trajectory
from groundstation.recording import END_S
from groundstation.settings import Config
from links.core import make_child_command

STOPPING_S = 5.0
"""To come to rest, from the fastest that a flight goes [s]."""
RESERVE = 1.5
"""The longest landing is reckoned so much longer than its figures say."""
BRING_DOWN_S = 15.0
"""Should the landing fail, the link's bring-down follows [s]."""


def longest_landing_s(config: Config) -> float:
    """From SIGTERM to the end of the process, at most, for what this configuration can fly [s].

    From the top of the fence, or else the highest point that it flies to, at the speeds of the landing.
    """
    floor = config.flight.floor_z_m
    top = max(floor - examine_trajectory(config).lowest_ned[2], config.takeoff.height_m)
    if config.fence is not None:
        top = max(top, config.fence.height_m)
    landing = config.landing
    slow = min(landing.touchdown_m_s, config.flight.descent_m_s)
    sinking_s = top / config.flight.descent_m_s + landing.approach_m / slow
    return RESERVE * (STOPPING_S + sinking_s + CERTAIN_S) + DISARM_WAIT_S + BRING_DOWN_S + END_S


def unit_file(config: Config, path: Path, overrides: list[str], *, user: str) -> str:
    """The unit file's text; ``path`` is the configuration's, ``overrides`` as on the command line."""
    sets = [word for override in overrides for word in ("--set", override)]
    words = [*_program(), "daemon", str(path.resolve()), *sets, "--log-format", "logfmt"]
    command = shlex.join(words).replace("%", "%%").replace("$", "$$")
    landing_s = longest_landing_s(config)
    text = Template((Path(__file__).parent / "groundstation.service").read_text("utf-8"))
    return text.substitute(
        vehicle=config.vehicle.name, command=command, user=user, stop_s=f"{landing_s:.0f}", landing_s=f"{landing_s:.0f}"
    )


def _program() -> list[str]:
    """This very installation, not whatever a path leads to."""
    script = Path(sys.executable).with_name("groundstation")
    return [str(script)] if script.exists() else make_child_command("groundstation")


WATCHDOG_SHARE = 1.0 / 3.0
"""The watchdog is fed so often, as a share of the time after which it bites."""
WAITING_MAX_BYTES = 4096
"""While so much waits for a manager that does not read, nothing is added."""


class Notify:
    """Datagrams to ``$NOTIFY_SOCKET``, if there is one. Never raises: a manager that is gone is no fault."""

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        """Read where to, and how often the watchdog wants to be fed."""
        self._address = environment.get("NOTIFY_SOCKET", "")
        usec = environment.get("WATCHDOG_USEC", "")
        ours = environment.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        self.feed_s = float(usec) / 1e6 * WATCHDOG_SHARE if usec.isdigit() and ours and int(usec) > 0 else None
        """How often to feed the watchdog [s]; None for never."""
        self._transport: asyncio.DatagramTransport | None = None

    async def open(self) -> None:
        """Open the socket; an ``@`` stands for the zero byte of an abstract name."""
        if self._address[:1] not in ("/", "@"):
            return
        name = "\0" + self._address[1:] if self._address.startswith("@") else self._address
        try:
            self._transport, _ = await asyncio.get_running_loop().create_datagram_endpoint(
                _Silent,
                remote_addr=name,
                family=sockets.AF_UNIX,
            )
        except OSError:
            self._transport = None

    def ready(self) -> None:
        """All that is needed is open."""
        self._send("READY=1")

    def status(self, text: str) -> None:
        """One line for ``systemctl status``."""
        self._send("STATUS=" + text.replace("\n", " "))

    def feed(self) -> None:
        """The event loop is alive."""
        self._send("WATCHDOG=1")

    def stopping(self) -> None:
        """On the way out: landing first, where it flies."""
        self._send("STOPPING=1")

    def close(self) -> None:
        """No more to tell."""
        if self._transport is not None:
            self._transport.abort()

    def _send(self, text: str) -> None:
        transport = self._transport
        if transport is None or transport.is_closing():
            return
        if transport.get_write_buffer_size() < WAITING_MAX_BYTES:  # type: ignore[attr-defined]  # it has, since 3.4
            transport.sendto(text.encode())


class _Silent(asyncio.DatagramProtocol):
    def error_received(self, exc: Exception) -> None:
        """The manager has gone, or is slow: it will see."""
