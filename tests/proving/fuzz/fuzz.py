"""Feeds every decoder random and damaged bytes.

Nothing may raise, memory may not grow, and a stream that comes in pieces must say the same as one that comes whole.
"""

import random
import struct
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence

import msgspec

from tests.proving.fuzz.pose_bytes import PERIOD_S
from tests.proving.fuzz.subjects import Subject

SHOWN = 1000
"""Of a datagram that made a decoder raise [hex digits]."""
LONGEST = 2000
"""Of random datagrams [bytes]."""
STREAM_PACKETS = 6
"""So many datagrams make one stream, which is fed whole and in pieces."""
_AWKWARD = (
    bytes(8), b"\xff" * 8, b"\xff\xff\xff\x7f", b"\x00\x00\x00\x80", struct.pack("<d", float("nan")),
    struct.pack("<f", float("inf")), struct.pack("<f", float("nan")), struct.pack("<d", -1e308), b"1e999", b"null",
    b'"',
)  # fmt: skip


class Report(msgspec.Struct, frozen=True):
    """What came of one decoder."""

    name: str
    tried: int
    """Datagrams, or pieces of streams' worth of them."""
    events: int
    """Poses or messages that came out."""
    drops: dict[str, int]
    """What was counted as no use, by reason."""
    exceptions: int
    mismatches: int
    """Streams that said something else in pieces."""
    memory_growth_mb: float
    """By how much the peak of the process's memory grew, after the first tenth."""


class Total(msgspec.Struct, frozen=True):
    """What came of all."""

    tried: int
    events: int
    drops: dict[str, int]
    exceptions: int
    mismatches: int
    memory_growth_mb: float
    decoders: list[Report]


def fuzz_all(subjects: Mapping[str, Callable[[], Subject]], count: int, seed: int = 0) -> Total:
    """Try ``count`` datagrams on each of ``subjects``."""
    reports = [fuzz(name, make, count, seed) for name, make in subjects.items()]
    drops: Counter[str] = Counter()
    for report in reports:
        drops.update(report.drops)
    return Total(
        sum(r.tried for r in reports),
        sum(r.events for r in reports),
        dict(drops),
        sum(r.exceptions for r in reports),
        sum(r.mismatches for r in reports),
        max((r.memory_growth_mb for r in reports), default=0.0),
        reports,
    )


def text(total: Total) -> str:
    """For people."""
    lines = [f"{'':<16} {'tried':>9} {'events':>9} {'exceptions':>10} {'in pieces':>10} {'memory MB':>10}  drops"]
    for r in total.decoders:
        grown = r.memory_growth_mb
        drops = ", ".join(f"{reason} {n}" for reason, n in sorted(r.drops.items(), key=lambda item: -item[1])[:4])
        differ = f"{r.mismatches} differ" if r.mismatches else "same"
        lines.append(f"{r.name:<16} {r.tried:>9} {r.events:>9} {r.exceptions:>10} {differ:>10} {grown:>10.1f}  {drops}")
    return "\n".join(lines)


def fuzz(name: str, make: Callable[[], Subject], count: int, seed: int = 0) -> Report:
    """Try ``count`` datagrams on one decoder; what raises is told on stderr, the first three of a kind."""
    subject = make()
    chance = random.Random(f"{seed} {name}")
    exceptions: Counter[str] = Counter()
    tried = events = mismatches = 0
    memory = peak_mb()
    batch: list[bytes] = []
    for n, datagram in enumerate(_damaged(subject, chance, count)):
        if n == count // 10:
            memory = peak_mb()
        tried += 1
        try:
            events += subject.feed(datagram, n * PERIOD_S)
            batch.append(datagram)
            if len(batch) == STREAM_PACKETS:
                stream, batch = b"".join(batch), []
                cuts = sorted(chance.randrange(len(stream) + 1) for _ in range(chance.randrange(1, 12)))
                mismatches += subject.in_pieces(stream, cuts) is False
        except Exception as error:  # noqa: BLE001  # which is what we are here to find
            kind = f"{type(error).__name__}: {error}"
            exceptions[type(error).__name__] += 1
            if exceptions[type(error).__name__] <= 3:
                print(f"fuzz {name}: {kind} on {datagram.hex()[:SHOWN]}", file=sys.stderr)
    growth = max(0.0, peak_mb() - memory)
    return Report(name, tried, events, dict(subject.drops()), sum(exceptions.values()), mismatches, round(growth, 2))


def _damaged(subject: Subject, chance: random.Random, count: int) -> Iterator[bytes]:
    """Random bytes, good datagrams, and good ones with damage of every kind; some with their checksums put right."""
    seeds = subject.seeds
    for _ in range(count):
        draw = chance.random()
        if draw < 0.1:
            yield chance.randbytes(chance.randrange(LONGEST) if draw < 0.05 else chance.randrange(40))
            continue
        data = bytearray(chance.choice(seeds))
        if draw > 0.15:
            for _ in range(chance.choice((1, 1, 2, 4, 8))):
                _damage(data, chance, seeds)
        yield subject.repair(bytes(data)) if chance.random() < 0.5 else bytes(data)


def _damage(data: bytearray, chance: random.Random, seeds: Sequence[bytes]) -> None:
    place = chance.randrange(len(data) + 1)
    match chance.randrange(8):
        case 0 if place < len(data):
            data[place] ^= 1 << chance.randrange(8)
        case 1 if place < len(data):
            data[place] = chance.randrange(256)
        case 2:
            del data[place:]
        case 3:
            del data[place : place + chance.randrange(1, 9)]
        case 4:
            data[place:place] = chance.randbytes(chance.randrange(1, 9))
        case 5:
            data[place:] = chance.choice(seeds)[place:]
        case 6:
            data += data[place:][:LONGEST]
        case _:
            awkward = chance.choice(_AWKWARD)
            data[place : place + len(awkward)] = awkward


def peak_mb() -> float:
    """The most memory that this process has held so far [MB]."""
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1024.0 if sys.platform != "darwin" else peak / 1024.0**2
