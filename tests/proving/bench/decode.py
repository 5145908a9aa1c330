"""Cost of one datagram, bytes to pose, beside pymavlink's bare parse of ODOMETRY."""

import gc
from collections.abc import Callable
from contextlib import suppress
from statistics import median
from time import perf_counter_ns
from typing import Any

from sim.runs import percentile
from tests.proving.bench.bench import Options
from tests.proving.fuzz import FLIGHTS, PERIOD_S

DATAGRAMS = 1000
"""For each decoder in each round."""
ROUNDS = 6
"""In turns; the first does not count."""
PARSE = "pymavlink's parse of ODOMETRY"


class Timed:
    """One decoder and what it is fed; every call is timed by itself."""

    def __init__(self, datagrams: list[bytes], decode: Callable[[bytes, float], object]) -> None:
        """``decode`` takes a datagram and when it came [s]."""
        self.bytes = len(datagrams[-1])
        """Length of a datagram."""
        self.took_us: list[float] = []
        """Duration of each call that counts [µs]."""
        self._datagrams = datagrams
        self._decode = decode

    def run(self, turn: int) -> None:
        """Decode the datagrams of round ``turn``."""
        decode, took = self._decode, []
        first = turn * DATAGRAMS
        for n, data in enumerate(self._datagrams[first : first + DATAGRAMS], first):
            begun = perf_counter_ns()
            decode(data, n * PERIOD_S)
            took.append(1e-3 * (perf_counter_ns() - begun))
        if turn:
            self.took_us += took


def measure(options: Options) -> dict[str, Any]:
    """The figures of each decoder.

    Raises:
        RuntimeError: a source did not make a pose of every datagram, so that its figure would mean nothing.
    """
    del options
    count = ROUNDS * DATAGRAMS
    flights = {name: make(count) for name, make in FLIGHTS.items()}
    decoders = {name: Timed(flight.datagrams, flight.reader.read) for name, flight in flights.items()}
    with suppress(ModuleNotFoundError):  # it comes with the tests
        from pymavlink.dialects.v20 import ardupilotmega

        parse = ardupilotmega.MAVLink(None).parse_buffer
        decoders[PARSE] = Timed(flights["odometry"].datagrams, lambda data, _: parse(data))
    gc.collect()
    gc.disable()
    try:
        for turn in range(ROUNDS):
            for decoder in decoders.values():
                decoder.run(turn)
    finally:
        gc.enable()
    for name, flight in flights.items():
        if flight.reader.status.accepted != count:
            raise RuntimeError(f"{name}: {flight.reader.status.accepted} poses of {count} datagrams")
    rows = [
        {"name": name, "bytes": d.bytes, "median_us": median(d.took_us), "p99_us": percentile(d.took_us, 0.99)}
        for name, d in decoders.items()
    ]
    return {"datagrams": (ROUNDS - 1) * DATAGRAMS, "rows": rows}


def text(facts: dict[str, Any]) -> list[str]:
    """One line a decoder."""
    return [
        f"{row['name']:30} {row['bytes']:4} bytes, median {row['median_us']:5.1f} µs, p99 {row['p99_us']:5.1f} µs"
        for row in facts["rows"]
    ]
