"""A pacer in a process of its own, and its stand-by in another, as the link sees them."""

import asyncio
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable

import msgspec

from links.core import LinkError, LinkLost
from links.io import OURS_S, start_child
from links.rf.codec import Manner, RfLinkConfig
from links.rf.pacer import MESSAGE_BYTES, Arm, End, Give, Order, PacerReport, PacerSetup, Stop
from links.rf.shared_memory import CAPACITY_BYTES, Mailbox
from links.text import link_notice

START_LIMIT_S = 30.0
"""Longest wait for the first report [s]."""
GIVE_BYTES = CAPACITY_BYTES - 256
"""Longest command in its message [bytes]: the stand-by's mailbox holds the pacer's state, too."""


class PacerProcess:
    """Implements :class:`links.rf.pacer.Pacer`."""

    def __init__(
        self,
        manner: Manner,
        process: "subprocess.Popen[bytes]",
        wire: socket.socket,
        mailbox: Mailbox,
        on_report: Callable[[PacerReport | None], None],
    ) -> None:
        self.manner = manner
        self._process = process
        self._wire = wire
        self._mailbox = mailbox
        self._on_report = on_report
        self._encoder = msgspec.msgpack.Encoder()
        self._decoder = msgspec.msgpack.Decoder(PacerReport)
        self._lasting: dict[type, Stop | End] = {}
        """Orders that hold whoever lets the frames go: a pacer that died may have read one, and not
        done it."""
        self._taken_over = False
        self._loop = asyncio.get_running_loop()
        self._end = self._loop.create_future()
        self._loop.add_reader(wire.fileno(), self._readable)

    def give(self, order: Order) -> bool:
        """Hand over ``order`` without waiting; False where nobody takes it."""
        if self._end.done():
            return False
        if isinstance(order, Arm):
            self._lasting.pop(Stop, None)
        elif isinstance(order, Stop | End):
            self._lasting[type(order)] = order
        data = self._encoder.encode(order)
        try:
            if isinstance(order, Give):
                if len(data) > GIVE_BYTES:
                    return False
                self._mailbox.put(data)
            else:
                self._wire.send(data)
        except OSError:  # it is gone or takes nothing
            return False
        return True

    @property
    def why_mute(self) -> str:
        """Meaning of missing reports: a stand-by that runs would have replaced a dead pacer."""
        return link_notice(
            "module.stands" if self._process.poll() is None else "module.stands_dead"
        ).text

    async def wait_for_end(self) -> None:
        """Wait until it has ended."""
        await asyncio.shield(self._end)

    def forget(self) -> None:
        """Let go of it; its dead man's switch ends it."""
        if self._wire.fileno() >= 0:
            self._loop.remove_reader(self._wire.fileno())
            self._wire.close()
            self._mailbox.close()
        if not self._end.done():
            self._end.set_result(None)

    def _readable(self) -> None:
        while True:
            try:
                data = self._wire.recv(MESSAGE_BYTES)
            except BlockingIOError:
                return
            except OSError:
                data = b""
            if not data:
                self._process.wait()  # its end of the wire closes with its last breath
                self.forget()
                self._on_report(None)
                return
            report = self._decoder.decode(data)
            if report.heir and not self._taken_over:
                self._taken_over = True
                for order in self._lasting.values():
                    self.give(order)
            self._on_report(report)


async def open_process(
    config: RfLinkConfig, thrust_max_n: float, on_report: Callable[[PacerReport | None], None]
) -> PacerProcess:
    """Start both processes, in a session of their own, and wait for the pacer's first report.

    Raises:
        LinkLost: it did not start.
        LinkError: its clock is not ours.
    """
    loop = asyncio.get_running_loop()
    if sys.platform != "linux":
        raise LinkLost(link_notice("module.linux_only"))
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    mailbox = Mailbox()
    first: asyncio.Future[PacerReport | None] = loop.create_future()

    def report(news: PacerReport | None) -> None:
        if not first.done():
            first.set_result(news)
        on_report(news)

    with theirs:
        shared = (theirs.fileno(), mailbox.fd)
        started = loop.time()
        words = map(str, shared)
        process = start_child(
            "links.rf.pacer_standby", *words, stdout=subprocess.DEVNULL, pass_fds=shared
        )
    ours.setblocking(False)
    pacer = PacerProcess(config.manner, process, ours, mailbox, report)
    pacer.give(PacerSetup(config, thrust_max_n))  # type: ignore[arg-type]  # the one message that is no order
    try:
        async with asyncio.timeout(START_LIMIT_S):
            hello = await asyncio.shield(first)
        if hello is None:
            raise LinkLost(link_notice("module.ended_at_once", code=process.wait()))
        if not started - OURS_S <= hello.now_s <= loop.time() + OURS_S:
            raise LinkError(link_notice("module.other_clock"))
    except BaseException as error:
        pacer.forget()
        os.killpg(process.pid, signal.SIGKILL)  # nothing is armed yet
        process.wait()
        if isinstance(error, TimeoutError):
            raise LinkLost(link_notice("module.not_started", limit_s=START_LIMIT_S)) from None
        raise
    return pacer
