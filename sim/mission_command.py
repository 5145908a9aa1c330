"""What ``groundstation-sim mission`` shows: the states of a whole flight, and how well and how softly it went."""

from typing import Any

from sim.mission import Mission


def summary(title: str, mission: Mission) -> str:
    """The mission as text."""
    lines = [title if mission.landed else f"{title}\nNOT AS PLANNED: {mission.fault or mission.why}", ""]
    lines += [f"{one.time_s:9.2f} s  {one.state:12} {one.reason}" for one in mission.states]
    lines.append("")
    figure = "" if mission.rms_cm is None else f" over {mission.figure_s:.0f} s of the figure"
    for label, value, unit, places, more in (
        ("RMS error", mission.rms_cm, "cm", 2, figure),
        ("largest error", mission.max_cm, "cm", 2, ""),
        ("touchdown", mission.touchdown_m_s, "m/s", 2, ""),
        ("from where it took off", 100.0 * mission.home_m, "cm", 1, ""),
        ("largest tilt", mission.tilt_max_deg, "deg", 1, ""),
        ("wall time", mission.wall_s, "s", 2, f" for {mission.duration_s:.0f} s"),
    ):
        shown = "none" if value is None else f"{value:.{places}f} {unit}"
        lines.append(f"{label:24}{shown:>14}{more}")
    return "\n".join(lines)


def facts(asked: dict[str, Any], mission: Mission) -> dict[str, Any]:
    """The mission as one JSON object: what was asked, what came of it; ``states`` in their order."""
    import msgspec

    return {**asked, **msgspec.to_builtins(mission)}
