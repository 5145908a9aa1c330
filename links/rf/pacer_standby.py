"""The pacer's stand-by: it starts the pacer, and takes over should that die or stand still.

It holds all that the pacer holds: the port, the socket that orders come in by, and what lay behind
the pacer's newest frame. It is the pacer's parent, so it hears at once of its end, and it ends one
whose sign of life stays out; either way it has reaped it before a byte of its own leaves. What
leaves then is the newest command up to its deadline, its bring-down, and disarm frames: nothing
that lifts ever again. It is started by links/rf/pacer_process.py.
"""

import gc
import os
import select
import socket
import subprocess
import sys

import msgspec

from links.io import start_child
from links.rf.pacer import MESSAGE_BYTES, FramePacer, Held, PacerSetup, StandbyWatch
from links.rf.pacer_child import (
    PREPARE_S,
    Commander,
    MonotonicClock,
    disable_output_and_gc,
    ignore_signals,
    pace,
    prioritise,
)
from links.rf.shared_memory import HeldPort, Lease, LeaseWord, Mailbox, SharedPort
from links.text import link_notice

VOUCH_S = 0.5
"""A stand-by that comes so late to its next look is none [s]."""


def main() -> None:
    """Stand by until the pacer ends; take over where it should not have."""
    ignore_signals()
    wire, mailbox = socket.socket(fileno=int(sys.argv[1])), int(sys.argv[2])
    lease, held = Lease(), Mailbox()
    beside, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with theirs:
        shared = (wire.fileno(), mailbox, lease.fd, held.fd, theirs.fileno())
        pacer = start_child("links.rf.pacer_child", *map(str, shared), apart=False, pass_fds=shared)
    message = wire.recv(MESSAGE_BYTES)
    setup = msgspec.msgpack.decode(message, type=PacerSetup)
    clock = MonotonicClock()
    fifo, note = prioritise(setup.config.fifo_priority, clock)
    port = HeldPort(beside)
    watch = StandbyWatch(setup.config.period_s)
    lease.vouch(LeaseWord.STANDBY, clock.now() + VOUCH_S)
    beside.send(message)
    why = _stand_by(pacer, port, lease, watch, clock)
    last = held.get()
    if not why or last is None:
        sys.exit(pacer.returncode)  # it is done, or has never begun
    disable_output_and_gc()
    commander = Commander(wire, Mailbox(mailbox), note, fifo)
    _take_over(setup, port, lease, msgspec.msgpack.decode(last, type=Held), why, clock, commander)


def _stand_by(
    pacer: "subprocess.Popen[bytes]",
    port: HeldPort,
    lease: Lease,
    watch: StandbyWatch,
    clock: MonotonicClock,
) -> str:
    """Sleep until the pacer has ended; what became of it, or an empty string where it was done."""
    ended, heard = os.pidfd_open(pacer.pid), port.beside.fileno()
    waits = [ended, heard]
    gc.collect()
    gc.freeze()
    while True:
        ready, _, _ = select.select(waits, [], [], max(0.0, watch.next_s - clock.now()))
        if heard in ready and not port.take_messages():
            waits.remove(heard)
        if ended in ready:
            lease.take()
            code = pacer.wait()
            port.take_messages()
            if code < 0:
                return link_notice("module.pacer_killed", signal=-code).text
            return link_notice("module.pacer_failed", code=code).text if code else ""
        if (now := clock.now()) >= watch.next_s:
            if watch.look(now, lease.vouched_s(LeaseWord.PACER)):
                lease.take()
                pacer.kill()
                pacer.wait()
                port.take_messages()
                return link_notice("module.pacer_stood").text
            lease.vouch(LeaseWord.STANDBY, watch.next_s + VOUCH_S)


def _take_over(
    setup: PacerSetup,
    port: HeldPort,
    lease: Lease,
    held: Held,
    why: str,
    clock: MonotonicClock,
    commander: Commander,
) -> None:
    """Let frames go at the pacer's instants until told to end, or until nobody commands."""
    config, now = setup.config, clock.now()
    shared = SharedPort(config.port, config.baud, lease, lease.generation, None, port.fd)
    pacer = FramePacer(config, setup.thrust_max_n, shared, now)
    pacer.inherit(held, why, now)
    periods = (clock.now() + PREPARE_S - held.frame_s) // config.period_s + 1.0
    first_s = held.frame_s + periods * config.period_s
    try:
        pace(pacer, config.period_s, config.frame_s, clock, commander, first_s)
    finally:
        pacer.close()


if __name__ == "__main__":
    main()
