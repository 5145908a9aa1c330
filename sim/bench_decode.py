"""What one datagram costs to decode, from bytes to a pose in our frames, beside pymavlink's bare parse of ODOMETRY."""

from collections.abc import Callable

import msgspec

from sim.pose_bytes import FLIGHTS, PERIOD_S

WARM_UP = 200


class Cost(msgspec.Struct, frozen=True):
    """Of one datagram."""

    name: str
    bytes: int
    """Its length."""
    median_us: float
    p99_us: float


def decode_costs(count: int = 5000) -> list[Cost]:
    """Every source's cost over ``count`` datagrams, and pymavlink's; single calls, timed one by one.

    Raises:
        RuntimeError: a source did not make a pose of every datagram, so the figure would mean nothing.
    """
    return [*(_source(name, count) for name in FLIGHTS), _pymavlink(count)]


def _source(name: str, count: int) -> Cost:
    reader, datagrams = FLIGHTS[name](count + WARM_UP)
    cost = _timed(name, datagrams, lambda n, data: reader.read(data, n * PERIOD_S))
    if reader.status.accepted != len(datagrams):
        raise RuntimeError(f"{name}: {reader.status.accepted} poses of {len(datagrams)} datagrams")
    return cost


def _pymavlink(count: int) -> Cost:
    from pymavlink.dialects.v20 import ardupilotmega

    parse = ardupilotmega.MAVLink(None).parse_buffer
    _, datagrams = FLIGHTS["odometry"](count + WARM_UP)
    return _timed("pymavlink parse of ODOMETRY", datagrams, lambda n, data: parse(data))


def _timed(name: str, datagrams: list[bytes], decode: Callable[[int, bytes], object]) -> Cost:
    import gc
    from time import perf_counter_ns  # noqa: TID251  # what is measured is this machine's time

    took = []
    gc.collect()
    gc.disable()
    try:
        for n, data in enumerate(datagrams):
            begun = perf_counter_ns()
            decode(n, data)
            took.append(perf_counter_ns() - begun)
    finally:
        gc.enable()
    took = sorted(took[WARM_UP:])
    return Cost(name, len(datagrams[-1]), took[len(took) // 2] / 1e3, took[len(took) * 99 // 100] / 1e3)


def table(costs: list[Cost]) -> str:
    """For people."""
    lines = [f"{'':<28} {'bytes':>6} {'median µs':>10} {'p99 µs':>8}"]
    lines += [f"{c.name:<28} {c.bytes:>6} {c.median_us:>10.1f} {c.p99_us:>8.1f}" for c in costs]
    return "\n".join(lines)
