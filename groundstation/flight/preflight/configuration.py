"""Checks of a configuration before anything is opened: trajectory, fence, key files."""

import math
from pathlib import Path

from groundstation.config import ConfigError, refuse_value
from groundstation.core.messages import Sentence, notice
from groundstation.core.safety import Fence
from groundstation.core.trajectory import Demand, FeasibilityReport, Trajectory, check_feasibility
from groundstation.settings import Config
from links.core import LinkKind
from links.io import is_pseudo_terminal, read_key
from links.text import to_percent


def examine_trajectory(config: Config) -> FeasibilityReport:
    """Compare the trajectory of ``config`` with its vehicle, its limits and its floor."""
    return check_feasibility(
        config.trajectory.build(),
        config.vehicle,
        config.limits,
        gravity=config.controller.gravity,
        floor_z_m=config.flight.floor_z_m,
    )


def explain_refusal(config: Config, report: FeasibilityReport) -> Sentence | None:
    """Return why the trajectory must not be flown, with the time, the limit and the remedy.

    None if it may.
    """
    odd = report.inconsistency
    if odd is not None and odd.name == "period":
        return notice("trajectory.period", at_s=odd.time_s, span_s=odd.declared, far_m=odd.found)
    if odd is not None:
        return notice(
            "trajectory.derivative",
            at_s=odd.time_s,
            name=odd.name,
            declared=odd.declared,
            found=odd.found,
            unit=odd.unit,
            of=odd.of,
        )
    return explain_infeasibility(report, getattr(config.trajectory, "speed_m_s", None))


def explain_infeasibility(
    report: FeasibilityReport, speed_m_s: float | None = None
) -> Sentence | None:
    """Return why the vehicle or its room can't follow the trajectory, and the remedy.

    None if they can.

    ``speed_m_s`` is the trajectory's configured speed; None if it has no such key.
    """
    worst = next((demand for demand in report.demands if not demand.ok), None)
    if worst is None or worst.limit is None:
        return None
    if worst.key == "flight.floor_z_m":
        return notice(
            "trajectory.below_floor", at_s=worst.time_s, depth_m=-worst.value, key=worst.key
        )
    needed, limit = f"{worst.value:.3g}", f"{worst.limit:.3g}"
    if needed == limit:
        needed, limit = f"{worst.value:.6g}", f"{worst.limit:.6g}"
    if report.share is None:
        advice = notice("trajectory.slower_no_help")
    elif speed_m_s is None:
        advice = notice("trajectory.slow_down", percent=math.floor(to_percent(report.share)))
    else:
        advice = notice(
            "trajectory.slow_down_to",
            speed_m_s=math.floor(1000.0 * report.share * speed_m_s) / 1000.0,
        )
    return notice(
        "trajectory.demand",
        at_s=worst.time_s,
        needed=needed,
        limit=limit,
        unit=worst.unit,
        name=worst.name,
        bound="at least" if worst.least else "limit",
        key=worst.key,
        advice=advice,
    )


STEP_S = 0.05
"""Step at which trajectories are checked against the fence [s]: 10 cm at 2 m/s. Chosen."""


def find_braking_room(fence: Fence, trajectory: Trajectory, lasts_s: float) -> tuple[float, float]:
    """Return the least room to the fence after braking from a point of ``trajectory`` [m], and the
    time of that point [s].
    """
    least_m, at_s = math.inf, 0.0
    for i in range(int(lasts_s / STEP_S) + 2):
        time_s = min(i * STEP_S, lasts_s)
        at = trajectory.at(time_s)
        room_m = fence.braking_room_m(at.position_ned, at.velocity_ned)
        if room_m < least_m:
            least_m, at_s = room_m, time_s
    return least_m, at_s


def explain_fence(config: Config) -> Sentence | None:
    """Return why the trajectory does not fit into the fence.

    None if it does, or without a fence.
    """
    if config.fence is None:
        return None
    trajectory = config.trajectory.build()
    fence = Fence(config.fence, config.flight.floor_z_m)
    room_m, at_s = find_braking_room(fence, trajectory, trajectory.joints_s[-1])
    return None if room_m > 0.0 else notice("trajectory.fence", at_s=at_s, short_m=-room_m)


def ensure_flyable(config: Config) -> FeasibilityReport:
    """Return the demands of the trajectory; refuse one that can't be flown.

    Raises:
        ConfigError: it can't be flown; the sentence has the time and the limit.
    """
    report = examine_trajectory(config)
    why = explain_refusal(config, report)
    if why is not None:
        raise ConfigError("trajectory", notice("trajectory.refused", why=why))
    return report


def find_real_key(config: Config) -> str | None:
    """Return the setting by which a real vehicle or real poses may be reached.

    None if all stays on this machine.

    Each kind of link and of poses decides; one that does not decide counts as real. Loopback counts
    as a simulator: a user who forwards it to a real vehicle must set a fence and a speed limit
    without being asked for them.
    """
    link, pose = config.link, config.pose
    if link.real is not None and not is_simulated(link):
        return f"link.{link.real}"
    return None if pose.real is None else f"pose.{pose.real}"


def is_simulated(link: LinkKind) -> bool:
    """Whether ``link`` is configured as simulated, and its port is a pseudo-terminal, as a
    simulator's is.
    """
    return link.simulated and is_pseudo_terminal(link.endpoint)


def ensure_guarded(config: Config) -> None:
    """Require a fence, a speed limit and a start from the floor of a configuration that may fly a
    real vehicle.

    Raises:
        ConfigError: one of them is missing.
    """
    why = find_real_key(config)
    if why is None:
        return
    if config.fence is None:
        raise ConfigError("fence", notice("guarded.no_fence", why=why))
    if config.limits.max_speed_m_s is None:
        raise ConfigError("limits.max_speed_m_s", notice("guarded.no_speed", why=why))
    if config.flight.start != "floor":
        raise ConfigError("flight.start", notice("guarded.start", why=why))


def ensure_link(config: Config) -> None:
    """Require that all key files of the link can be used.

    Raises:
        ConfigError: one can't; the error names its configuration key.
    """
    for name, file in config.link.key_files.items():
        load_link_key(file, f"link.{name}")


def load_link_key(file: str, name: str) -> bytes:
    """Read the secret key in ``file``, which the configuration key ``name`` names.

    Raises:
        ConfigError: the file can't be used.
    """
    with refuse_value(name):
        return read_key(Path(file))


def describe_trajectory(config: Config, report: FeasibilityReport) -> str:
    """Describe the trajectory and its demands as text."""
    ends = "never ends" if report.duration_s is None else f"lasts {report.duration_s:.2f} s"
    looked = " of it" if report.duration_s is None else ""
    floor_z_m, low, high = config.flight.floor_z_m, report.lowest_ned, report.highest_ned
    lines = [
        f"{config.trajectory.__struct_config__.tag} for {config.vehicle.name}: {ends}, "
        f"{report.length_m:.2f} m in {report.span_s:.2f} s{looked}, starts at "
        f"{report.start_speed_m_s:.2f} m/s",
        f"stays within north {low[0]:.2f} to {high[0]:.2f}, east {low[1]:.2f} to {high[1]:.2f} m, "
        f"{floor_z_m - high[2]:.2f} to {floor_z_m - low[2]:.2f} m above the floor",
        f"{'':24}{'needs':>16}{'at':>12}{'limit':>18}",
        *(_line(demand) for demand in report.demands),
    ]
    why = explain_refusal(config, report) or explain_fence(config)
    return "\n".join([*lines, "PASS" if why is None else f"FAIL: {why}"])


def _line(demand: Demand) -> str:
    sign = "≥" if demand.least else "≤"
    limit = "none" if demand.limit is None else f"{sign} {demand.limit:.4g} {demand.unit}"
    needs = f"{demand.value:.4g} {demand.unit}"
    verdict = "" if demand.limit is None else "  pass" if demand.ok else "  FAIL"
    name = f"least {demand.name}" if demand.least else demand.name
    return f"{name:24}{needs:>16}{demand.time_s:>10.2f} s{limit:>18}{verdict}"
