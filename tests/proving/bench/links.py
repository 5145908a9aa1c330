"""How commands keep time: the pacer's frames beside a bare sleep loop, and pose to command beside a bare echo."""

from typing import TYPE_CHECKING, Any

from tests.proving.bench import latency as bench_latency
from tests.proving.bench import pacer as bench_pacer

if TYPE_CHECKING:
    from tests.proving.bench.bench import Options


def measure(options: "Options") -> dict[str, Any]:
    """The pacer idle and with every processor busy, ``options.seconds`` each; the latencies as long, all together."""
    idle = bench_pacer.measure(options.seconds, busy=False)
    busy = bench_pacer.measure(options.seconds, busy=True)
    latency = bench_latency.measure(options.seconds / len(bench_latency.RATES_HZ))
    return {
        **busy,
        "ratios": _ratios(busy["pacer"], busy["floor"]),
        "idle": {**idle, "ratios": _ratios(idle["pacer"], idle["floor"])},
        **latency,
        "latency_ratios": {
            rate: _ratios(figures, latency["echo"][rate]) for rate, figures in latency["pose_to_command"].items()
        },
        "seconds": options.seconds,
        "period_s": bench_pacer.PERIOD_S,
    }


def _ratios(ours: dict[str, float], floor: dict[str, float]) -> dict[str, float]:
    keys = ("p50_us", "p99_us", "p999_us")
    return {key.removesuffix("_us"): round(ours[key] / max(floor[key], 1.0), 2) for key in keys}


def text(facts: dict[str, Any]) -> list[str]:
    """A few lines; see :func:`measure`."""
    policy = "real-time priority" if facts["fifo"] else "ordinary priority: SCHED_FIFO is not allowed here"
    lines = [f"lateness of frames every {1e3 * facts['period_s']:g} ms for {facts['seconds']:g} s, {policy}"]
    for name, these in (("processors busy", facts), ("idle", facts["idle"])):
        for what, label in (("pacer", "the pacer"), ("floor", "a bare loop")):
            lost = these[what]["lost"]
            lines.append(f"  {name:16} {label:12} {_figures(these[what])}; {lost} lost")
        lines.append(f"  {name:16} {'ratio':12} {_words(these['ratios'])}")
    lines.append("pose's datagram in to command's datagram out")
    for rate, ours in facts["pose_to_command"].items():
        lines.append(f"  {rate + ' Hz':16} {'the program':12} {_figures(ours)}; {lost_words(ours)}")
        lines.append(f"  {rate + ' Hz':16} {'a bare echo':12} {_figures(facts['echo'][rate])}")
        lines.append(f"  {rate + ' Hz':16} {'ratio':12} {_words(facts['latency_ratios'][rate])}")
    return lines


def _figures(these: dict[str, float]) -> str:
    return f"50 % within {these['p50_us']:.0f} µs, 99 % {these['p99_us']:.0f}, 99.9 % {these['p999_us']:.0f}"


def lost_words(these: dict[str, float]) -> str:
    """What became of the poses that had no command of their own."""
    return f"{these['overtaken']} overtaken by a newer pose, {these['unanswered']} unanswered"


def _words(ratios: dict[str, float]) -> str:
    return f"{ratios['p50']:g}, {ratios['p99']:g}, {ratios['p999']:g}"
