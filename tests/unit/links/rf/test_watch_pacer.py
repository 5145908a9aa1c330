"""When a stand-by believes that its pacer stands still, and what the two share."""

import os
import pty
import socket
from pathlib import Path

import pytest

from links.rf import StandbyWatch
from links.rf.shared_memory import HeldPort, Lease, LeaseWord, SharedPort, Superseded

# A look 10 ms after a doubt, ignored where it is 5 ms late; a sign of life is too old at 60 ms.
LOOK_S = 0.01
LATE_S = 0.005
OLD_S = 0.06


def watching(period_s: float) -> StandbyWatch:
    """One that looks at 10 s for the first time."""
    watch = StandbyWatch(period_s)
    watch.next_s = 10.0
    return watch


def looks(watch: StandbyWatch, *, late_s: float = 0.0, vouched_s: float = 10.0) -> float | None:
    """When a pacer that vouched last at ``vouched_s`` is convicted, looked at in time [s]."""
    now = 10.0
    for _ in range(100):
        if watch.look(now + late_s, vouched_s):
            return now
        now = max(watch.next_s, now) + 1e-6
    return None


def test_a_sign_of_life_that_stays_out_convicts_at_the_second_look_in_time() -> None:
    assert looks(watching(0.0225)) == pytest.approx(10.0 + OLD_S + 0.5 * 0.0225 + LOOK_S, abs=1e-4)
    assert looks(watching(0.004), late_s=1.1 * LATE_S) is None
    convicted = looks(watching(0.1))
    assert convicted is not None and convicted > 10.15, "frames far apart are waited for"


def test_one_look_in_time_and_one_late_begin_anew() -> None:
    watch = watching(0.004)
    assert not watch.look(10.0, 9.9)
    assert not watch.look(10.0 + LOOK_S + 1.1 * LATE_S, 9.9)
    assert not watch.look(watch.next_s, 9.9)
    assert watch.look(watch.next_s, 9.9)


def test_a_sign_in_between_acquits() -> None:
    watch = watching(0.004)
    assert not watch.look(10.0, 9.9)
    assert not watch.look(watch.next_s, 10.005)
    assert not watch.look(10.3, 10.2)


def test_a_pacer_that_has_not_begun_or_vouches_ahead_is_waited_for_and_looked_at() -> None:
    assert looks(watching(0.0225), vouched_s=0.0) is None
    watch = watching(0.0225)
    assert not watch.look(10.0, 12.0)
    assert watch.next_s < 10.1, "it may be done with what takes long, and die"


def test_both_ends_of_a_lease_see_whose_turn_it_is_and_who_lives() -> None:
    lease = Lease()
    other = Lease(os.dup(lease.fd))
    assert other.generation == 0
    lease.take()
    assert other.generation == 1
    lease.vouch(LeaseWord.PACER, 12.5)
    assert other.vouched_s(LeaseWord.PACER) == pytest.approx(12.5)


def test_a_port_is_held_in_common_and_let_go_in_common() -> None:
    far, near = pty.openpty()
    beside, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    lease = Lease()
    port, held = (
        SharedPort(os.ttyname(near), 125000, lease, lease.generation, theirs),
        HeldPort(beside),
    )
    assert held.take_messages()
    assert held.fd is None
    port.open()
    assert held.take_messages()
    assert held.fd is not None
    assert port.write(b"one")
    lease.take()
    with pytest.raises(Superseded):
        port.write(b"two")
    heir = SharedPort("/nowhere", 125000, lease, lease.generation, None, held.fd)
    heir.open()  # it is open
    assert heir.write(b"two")
    came = os.read(far, 100)
    while len(came) < len(b"onetwo"):  # a pseudo-terminal may hand over each write by itself
        came += os.read(far, 100)
    assert came == b"onetwo"
    descriptor = Path(f"/proc/self/fdinfo/{held.fd}")
    assert "lock:" in descriptor.read_text()
    port.close()
    assert "lock:" not in descriptor.read_text(), "who opens it again is not kept out"
    held.take_messages()
    assert held.fd is None
    theirs.close()
    assert not held.take_messages(), "the pacer says nothing any more"
    beside.close()
    os.close(far)
    os.close(near)
