"""What was found, for people and for programs."""

from typing import Any

from groundstation.analysis.identify.found import Found


def number(value: float | None) -> str:
    """Four digits, or a dash."""
    return "–" if value is None else f"{value:.4g}"


def remarks(found: Found) -> list[str]:
    """What to know about all of it."""
    seen = found.seen
    flown = seen.config.trajectory.__struct_config__.tag
    lines = [f"{seen.length_s:.1f} s of {flown}, {len(seen.at_s)} poses. Intervals hold the truth in 95 % of flights."]
    if not seen.recording.whole:
        lines.append(f"The recording {seen.recording.trouble}. This is from what is in it before.")
    return lines


def table(found: Found) -> str:
    """One line a parameter."""
    lines = [*remarks(found), f"{'':30}{'found':>12}{'95 %':>26}{'told':>12}"]
    for one in found.parameters.values():
        interval = "" if one.interval is None else f"{number(one.interval[0])} to {number(one.interval[1])}"
        unit = f" {one.unit}" if one.unit else ""
        lines.append(
            f"{one.title:30}{number(one.value):>12}{interval:>26}{number(one.told):>12}{unit:<7} {one.note}".rstrip()
        )
    return "\n".join(lines)


def facts(found: Found) -> dict[str, Any]:
    """The same as one object for JSON."""
    seen = found.seen
    about = seen.recording.about
    return {
        "file": str(seen.path),
        "whole": seen.recording.whole,
        "flight": {key: about.get(key, "") for key in ("vehicle", "controller", "trajectory", "scenario", "seed")},
        "length_s": seen.length_s,
        "poses": len(seen.at_s),
        "parameters": {
            one.name: {
                "title": one.title,
                "value": one.value,
                "interval": one.interval,
                "unit": one.unit,
                "told": one.told,
                "identified": one.identified,
                "note": one.note,
            }
            for one in found.parameters.values()
        },
    }
