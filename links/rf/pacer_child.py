"""The pacer's own process: absolute deadlines, real-time priority, no terminal signals.

Its stand-by (pacer_standby.py) starts it. The newest command arrives in a mailbox in shared memory.
All other orders arrive, and reports leave, over a socket pair: there messages arrive whole and in
order or not at all, and the other end closes when the commander, the process of the link, dies.
Nothing here waits but the sleep until the next frame. The commands' clock is CLOCK_MONOTONIC, the
same in every process of this machine.
"""

import contextlib
import ctypes
import gc
import os
import signal
import socket
import sys
import time
from enum import IntFlag

import msgspec

from links.io import Sleep
from links.rf.pacer import MESSAGE_BYTES, FramePacer, Give, Order, PacerReport, PacerSetup
from links.rf.shared_memory import Lease, LeaseWord, Mailbox, SharedPort
from links.text import link_notice

PREPARE_S = 0.0004
"""Lead of a frame's computation on its instant [s]. Chosen: above the time that it takes."""
SPIN_S = 0.00012
"""Length of the busy wait before a frame [s]: about the time in which the kernel wakes a process
up. Chosen; `groundstation-sim bench links` measures the lateness that comes of it."""

MOST_ORDERS = 256
"""Limit of the orders that are taken before a frame [-]: a flood of them must not delay it."""


class LinuxFlag(IntFlag):
    """Flags of clock_nanosleep and of mlockall (Linux, <time.h> and <sys/mman.h>)."""

    TIMER_ABSTIME = 1
    """The time is an instant, not a duration."""
    MCL_CURRENT = 1
    """Pages of now."""
    MCL_FUTURE = 2
    """Pages of later."""


class MonotonicClock:
    """CLOCK_MONOTONIC, with a sleep until an instant on it."""

    def __init__(self) -> None:
        self._libc = ctypes.CDLL(None, use_errno=True)
        self._libc.clock_nanosleep.argtypes = (
            ctypes.c_int,
            ctypes.c_int,
            ctypes.c_void_p,
            ctypes.c_void_p,
        )
        self._until = (ctypes.c_long * 2)()
        self.now = time.monotonic

    def sleep_until(self, when_s: float) -> None:
        """Sleep until ``when_s`` [s]; at once where that has passed."""
        seconds = int(when_s)
        self._until[0], self._until[1] = seconds, int(1e9 * (when_s - seconds))
        self._libc.clock_nanosleep(time.CLOCK_MONOTONIC, LinuxFlag.TIMER_ABSTIME, self._until, None)

    def lock_memory(self) -> bool:
        """Keep every page in memory, now and later; return whether the system allowed it."""
        return int(self._libc.mlockall(LinuxFlag.MCL_CURRENT | LinuxFlag.MCL_FUTURE)) == 0


def main() -> None:
    """Pace until an order to end, or until the commander is gone and the vehicle is down."""
    ignore_signals()
    wire, mailbox, lease, held, beside = map(int, sys.argv[1:])
    by_standby = socket.socket(fileno=beside)
    # The stand-by sends the setup once it is ready itself.
    setup = msgspec.msgpack.decode(by_standby.recv(MESSAGE_BYTES), type=PacerSetup)
    by_standby.setblocking(False)
    config, clock = setup.config, MonotonicClock()
    fifo, note = prioritise(config.fifo_priority, clock)
    standby = Standby(Lease(lease), Mailbox(held))
    port = SharedPort(config.port, config.baud, standby.lease, standby.lease.generation, by_standby)
    pacer = FramePacer(config, setup.thrust_max_n, port, clock.now())
    disable_output_and_gc()
    commander = Commander(socket.socket(fileno=wire), Mailbox(mailbox), note, fifo, standby)
    try:
        pace(pacer, config.period_s, config.frame_s, clock, commander)
    except BaseException:  # noqa: BLE001  # any fault, and Superseded
        os._exit(1)  # the stand-by goes on with the open port: no clean-up of ours may close it
    pacer.close()


def ignore_signals() -> None:
    """Ignore the terminal's signals and SIGTERM."""
    for number in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM, signal.SIGQUIT, signal.SIGTSTP):
        signal.signal(number, signal.SIG_IGN)


def disable_output_and_gc() -> None:
    """Print nothing and collect no garbage from now on: both could delay a frame."""
    # A program that reads the station's output to its end must not wait for this process, which
    # outlives the station.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stderr.fileno())
    gc.collect()
    gc.freeze()
    gc.disable()


class Standby:
    """The stand-by as its pacer sees it: memory that both share, and whether it lives."""

    def __init__(self, lease: Lease, held: Mailbox) -> None:
        """``lease`` has the signs of life of both, ``held`` the state for the stand-by."""
        self.lease = lease
        self._held = held
        self._parent = os.getppid()
        self._encoder = msgspec.msgpack.Encoder()

    def publish(self, pacer: FramePacer, now_s: float) -> None:
        """Write the pacer's state before its frame leaves: the stand-by must be able to bring down
        every frame's.
        """
        self._held.put(self._encoder.encode(pacer.make_estate()))
        self.lease.vouch(LeaseWord.PACER, now_s)

    @property
    def is_gone(self) -> bool:
        """Whether the stand-by has ended: its child, this process, then has another parent."""
        return os.getppid() != self._parent

    def warning(self, now_s: float) -> str:
        """Describe the stand-by's fault; empty without one."""
        wrong = (
            "is gone"
            if self.is_gone
            else ""
            if now_s < self.lease.vouched_s(LeaseWord.STANDBY)
            else "stands still"
        )
        return link_notice("module.alone", wrong=wrong).text if wrong else ""


class Commander:
    """The process of the link, at the other ends of the socket pair and of the mailbox."""

    def __init__(
        self,
        wire: socket.socket,
        mailbox: Mailbox,
        note: str,
        fifo: bool,
        standby: Standby | None = None,
    ) -> None:
        """``note`` and ``fifo`` go into every report.

        ``standby`` is None in the stand-by itself.
        """
        self._wire = wire
        self._mailbox = mailbox
        self._note, self._fifo = note, fifo
        self._standby = standby
        self._orders = msgspec.msgpack.Decoder(Order)
        self._commands = msgspec.msgpack.Decoder(Give)
        self._encoder = msgspec.msgpack.Encoder()
        self._alive = True
        wire.setblocking(False)

    def listen(self, pacer: FramePacer, now_s: float) -> None:
        """Take the newest command and the orders since the last call."""
        if not self._alive:
            return
        # Read before the orders and given after them: the order to arm that the command follows is
        # then among them.
        newest = self._mailbox.get()
        self._obey(pacer, now_s)
        if newest is not None:
            with contextlib.suppress(msgspec.MsgspecError):  # as below
                pacer.order(self._commands.decode(newest), now_s)

    def _obey(self, pacer: FramePacer, now_s: float) -> None:
        """Give the waiting orders to the pacer, or tell it that the commander is gone."""
        for _ in range(MOST_ORDERS):
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
                continue  # not an order; an exception here would end the vehicle's frames
            pacer.order(order, now_s)

    def keep(self, pacer: FramePacer, now_s: float) -> None:
        """Publish the state behind the frame that was prepared last, if there is a stand-by."""
        if self._standby is not None:
            self._standby.publish(pacer, now_s)

    def tell(self, pacer: FramePacer, now_s: float) -> None:
        """Send a report; without room in the socket it is dropped."""
        if self._alive:
            standby = self._standby
            missing = standby.warning(now_s) if standby is not None else ""
            warning = missing or (
                "" if self._fifo else link_notice("module.frames_late", note=self._note).text
            )
            alone = standby is not None and standby.is_gone
            report: PacerReport = pacer.report(
                now_s, note=self._note, fifo=self._fifo, alone=alone, warning=warning
            )
            # The commander may not read, or be gone: the next _obey finds out.
            with contextlib.suppress(OSError):
                self._wire.send(self._encoder.encode(report))


def pace(
    pacer: FramePacer,
    period_s: float,
    frame_s: float,
    clock: MonotonicClock,
    commander: Commander,
    first_s: float | None = None,
) -> None:
    """Send frames until the pacer is done, the first at ``first_s`` [s]; without it, in a period.

    Each frame is prepared before the sleep ends (``PREPARE_S``), and leaves at the end of a busy
    wait (``SPIN_S``). An instant that has passed already is skipped: frames stay whole periods
    apart, but for the pacer's small shifts towards the module's timing.
    """
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
    """Ask for real-time priority and locked memory.

    Return whether the first was allowed, and a sentence on both.
    """
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
