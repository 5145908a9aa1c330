"""The pacer's own process: absolute deadlines, real-time priority where allowed, deaf to the terminal.

It is started by its stand-by (pacer_standby.py) with a mailbox in shared memory, which holds the newest command, and
one end of a socket pair, on which messages arrive whole or not at all and in order, and whose other end closes when
whoever commands dies. All other orders come in there, and reports go out. Nothing here waits but the sleep until the
next frame. The commands' clock is CLOCK_MONOTONIC, the same in every process of this machine.
"""

import contextlib
import ctypes
import gc
import os
import signal
import socket
import sys
import time

import msgspec

from links.io import Sleep
from links.rf.pacer import MESSAGE_BYTES, FramePacer, Give, Order, PacerReport, PacerSetup
from links.rf.shared_memory import FIRST, PACER, STANDBY, Lease, Mailbox, SharedPort
from links.text import link_notice

PREPARE_S = 0.0004
"""Lead with which a frame is made [s]; then only the write is left to do."""
SPIN_S = 0.00012
"""The last part of the wait is spent awake [s]: about what the kernel takes to wake a process up."""
_MOST_ORDERS = 256
"""Most orders taken between two frames, so that nobody who floods us delays a frame."""


class MonotonicClock:
    """CLOCK_MONOTONIC, and sleeping until an instant on it."""

    def __init__(self) -> None:
        self._libc = ctypes.CDLL(None, use_errno=True)
        self._libc.clock_nanosleep.argtypes = (ctypes.c_int, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)
        self._until = (ctypes.c_long * 2)()
        self.now = time.monotonic

    def sleep_until(self, when_s: float) -> None:
        """Sleep until ``when_s`` [s]; at once where that has passed."""
        seconds = int(when_s)
        self._until[0], self._until[1] = seconds, int(1e9 * (when_s - seconds))
        self._libc.clock_nanosleep(time.CLOCK_MONOTONIC, 1, self._until, None)

    def lock_memory(self) -> bool:
        """Keep every page in memory, now and later; whether that was allowed."""
        return int(self._libc.mlockall(3)) == 0


def main() -> None:
    """Pace until told to end, or until nobody commands any more and all is brought down."""
    deafen()
    wire, mailbox, lease, held, beside = map(int, sys.argv[1:])
    by_standby = socket.socket(fileno=beside)
    setup = msgspec.msgpack.decode(
        by_standby.recv(MESSAGE_BYTES), type=PacerSetup
    )  # it comes once the stand-by is ready
    by_standby.setblocking(False)
    config, clock = setup.config, MonotonicClock()
    fifo, note = prioritise(config.fifo_priority, clock)
    estate = Estate(Lease(lease), Mailbox(held))
    port = SharedPort(config.port, config.baud, estate.lease, FIRST, by_standby)
    pacer = FramePacer(config, setup.thrust_max_n, port, clock.now())
    hush()
    commander = Commander(socket.socket(fileno=wire), Mailbox(mailbox), note, fifo, estate)
    try:
        pace(pacer, config.period_s, config.frame_s, clock, commander)
    except BaseException:  # noqa: BLE001  # whatever it is, Superseded too
        os._exit(1)  # the stand-by goes on with the port as it is: it must not even be closed
    pacer.close()


def deafen() -> None:
    """Ignore the signals of a terminal and polite requests to end."""
    for number in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM, signal.SIGQUIT, signal.SIGTSTP):
        signal.signal(number, signal.SIG_IGN)


def hush() -> None:
    """Print nothing and collect no garbage from now on: no frame must wait for that."""
    # Whoever waits for the end of what the station prints must not wait for us, who outlive it.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stderr.fileno())
    gc.collect()
    gc.freeze()
    gc.disable()


class Estate:
    """State shared by a pacer with its stand-by: the sign that it lives, and what it holds."""

    def __init__(self, lease: Lease, held: Mailbox) -> None:
        """Both are shared with the stand-by."""
        self.lease = lease
        self._held = held
        self._standby = os.getppid()
        self._encoder = msgspec.msgpack.Encoder()

    def keep(self, pacer: FramePacer, now_s: float) -> None:
        """Before each frame: nothing leaves that the stand-by could not bring down."""
        self._held.put(self._encoder.encode(pacer.make_estate()))
        self.lease.vouch(PACER, now_s)

    @property
    def deserted(self) -> bool:
        """Whether the stand-by has ended: whoever started this process is its parent no longer."""
        return os.getppid() != self._standby

    def warning(self, now_s: float) -> str:
        """Describe the stand-by's fault; empty without one."""
        wrong = "is gone" if self.deserted else "" if now_s < self.lease.vouched_s(STANDBY) else "stands still"
        return link_notice("module.alone", wrong=wrong).text if wrong else ""


class Commander:
    """Whoever holds the other ends of the socket pair and of the mailbox."""

    def __init__(
        self, wire: socket.socket, mailbox: Mailbox, note: str, fifo: bool, estate: Estate | None = None
    ) -> None:
        """``note`` and ``fifo`` go into every report; ``estate`` is for the stand-by, where there is one."""
        self._wire = wire
        self._mailbox = mailbox
        self._note, self._fifo = note, fifo
        self._estate = estate
        self._orders = msgspec.msgpack.Decoder(Order)
        self._commands = msgspec.msgpack.Decoder(Give)
        self._encoder = msgspec.msgpack.Encoder()
        self._alive = True
        wire.setblocking(False)

    def listen(self, pacer: FramePacer, now_s: float) -> None:
        """Take what was ordered since the last time."""
        if not self._alive:
            return
        newest = self._mailbox.get()  # before the orders: the arming that it follows is then among those
        self._obey(pacer, now_s)
        if newest is not None:
            with contextlib.suppress(msgspec.MsgspecError):  # as below
                pacer.order(self._commands.decode(newest), now_s)

    def _obey(self, pacer: FramePacer, now_s: float) -> None:
        for _ in range(_MOST_ORDERS):
            try:
                data = self._wire.recv(MESSAGE_BYTES)
            except BlockingIOError:
                return
            except OSError:
                data = b""
            if not data:
                self._alive = False
                pacer.outlive_commander(now_s)
                return
            try:
                order = self._orders.decode(data)
            except msgspec.MsgspecError:
                continue  # no order of ours; an exception here would silence the vehicle's link
            pacer.order(order, now_s)

    def keep(self, pacer: FramePacer, now_s: float) -> None:
        """The next frame is made: let the stand-by have what is behind it."""
        if self._estate is not None:
            self._estate.keep(pacer, now_s)

    def tell(self, pacer: FramePacer, now_s: float) -> None:
        """Report; one that does not fit is left out."""
        if self._alive:
            estate = self._estate
            missing = estate.warning(now_s) if estate is not None else ""
            warning = missing or ("" if self._fifo else link_notice("module.frames_late", note=self._note).text)
            alone = estate is not None and estate.deserted
            report: PacerReport = pacer.report(now_s, note=self._note, fifo=self._fifo, alone=alone, warning=warning)
            with contextlib.suppress(OSError):  # nobody reads for now, or for ever: the next look tells
                self._wire.send(self._encoder.encode(report))


def pace(
    pacer: FramePacer,
    period_s: float,
    frame_s: float,
    clock: MonotonicClock,
    commander: Commander,
    first_s: float | None = None,
) -> None:
    """Let frames go until the pacer is done, the first at ``first_s`` [s], or in a period."""
    now = clock.now
    due = now() + period_s if first_s is None else first_s
    sleep = Sleep(now)
    pacer.prepare(due)
    commander.tell(pacer, now())
    while not pacer.done(now()):
        clock.sleep_until(due - PREPARE_S)
        commander.listen(pacer, now())
        pacer.prepare(due)
        commander.keep(pacer, now())
        clock.sleep_until(due - SPIN_S)
        while (woken := now()) < due:
            pass
        if slept := sleep.slept_s:
            pacer.note_sleep(slept, due)
            sleep = Sleep(now)
        pacer.leave(woken)
        left = now()
        skipped = max(0, int((left - due) / period_s))
        pacer.count_frame(left, skipped)
        pacer.tidy(left)
        if pacer.has_news(left):
            commander.tell(pacer, left)
        due += (1 + skipped) * period_s + pacer.steer()
    clock.sleep_until(now() + frame_s)  # the last frame leaves whole
    commander.tell(pacer, now())


def prioritise(priority: int, clock: MonotonicClock) -> tuple[bool, str]:
    """Ask for real-time priority and locked memory; whether we have the first, and in words what we have."""
    if priority == 0:
        return False, link_notice("module.priority_ordinary").text
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except OSError:
        return False, link_notice("module.priority_refused").text
    if not clock.lock_memory():
        return True, link_notice("module.priority_unlocked", priority=priority).text
    return True, link_notice("module.priority", priority=priority).text


if __name__ == "__main__":
    main()
