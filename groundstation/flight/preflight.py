"""What is looked at before take-off, and before anything is opened: whether this configuration may fly at all."""

from pathlib import Path

from groundstation.config import ConfigError
from groundstation.core.trajectory import Demand, Report, check, refusal
from groundstation.settings import Config
from links.bridge import BridgeLinkConfig
from links.io import is_pseudo_terminal, read_key
from links.mavlink.protocol import MavlinkLinkConfig
from links.rf.codecs import RfLinkConfig


def look(config: Config) -> Report:
    """The trajectory of ``config``, held against its vehicle, its limits and its floor."""
    return check(
        config.trajectory.build(),
        config.vehicle,
        config.limits,
        gravity=config.controller.gravity,
        floor_z_m=config.flight.floor_z_m,
    )


def refused(config: Config, report: Report) -> str | None:
    """Why the trajectory must not fly, with the time, the limit and what to do; None if it may."""
    return refusal(report, getattr(config.trajectory, "speed_m_s", None))


def ensure_flyable(config: Config) -> None:
    """Stop before anything moves if the trajectory asks too much.

    Raises:
        ConfigError: with the time and the limit.
    """
    why = refused(config, look(config))
    if why is not None:
        raise ConfigError("trajectory", f"{why}. To see all of it: groundstation trajectory CONFIG")


def real(config: Config) -> str | None:
    """The key that may lead to a real vehicle or to real poses, and its value; None where all stays on this machine.

    Every kind of link and of poses answers for itself, by its property ``real``; one that does not counts as real.
    On loopback there are simulators: whoever routes that to a vehicle must set a fence and a speed limit by himself.
    """
    for section, kind in (("link", config.link), ("pose", config.pose)):
        key = getattr(kind, "real", f"kind = {kind.__struct_config__.tag}")
        if key is not None and not is_simulated(kind):
            return f"{section}.{key}"
    return None


def is_simulated(link: object) -> bool:
    """Whether the operator says that a simulator is behind the port of ``link``, and one can be."""
    return isinstance(link, RfLinkConfig) and link.simulated and is_pseudo_terminal(link.port)


def ensure_guarded(config: Config) -> None:
    """A real vehicle flies within a fence and a speed limit, which have no default, and takes off from the floor.

    Raises:
        ConfigError: one of them is missing.
    """
    why = real(config)
    if why is None:
        return
    because = f"a real vehicle may fly here ({why})"
    if config.fence is None:
        says = f'missing, and {because}: kind = "box", north_m = [-2, 2], east_m = [-2, 2], height_m = 2.5, or convex'
        raise ConfigError("fence", says)
    if config.limits.max_speed_m_s is None:
        raise ConfigError("limits.max_speed_m_s", f"missing, and {because}: the fastest that it may be told to go")
    if config.flight.start != "floor":
        raise ConfigError("flight.start", f"expected floor, as {because}")


def ensure_link(config: Config) -> None:
    """Stop before anything moves if a link's port or key can't be used.

    Raises:
        ConfigError: by the dotted key.
    """
    if isinstance(config.link, BridgeLinkConfig):
        key(config.link.key_file, "link.key_file")
    if isinstance(config.link, MavlinkLinkConfig) and config.link.signing_key_file is not None:
        key(config.link.signing_key_file, "link.signing_key_file")


def key(file: str, name: str) -> bytes:
    """The key in ``file``, which the configuration calls ``name``.

    Raises:
        ConfigError: it can't be used.
    """
    try:
        return read_key(Path(file))
    except ValueError as error:
        raise ConfigError(name, str(error)) from None


def text(config: Config, report: Report) -> str:
    """``report`` for people."""
    ends = "never ends" if report.duration_s is None else f"lasts {report.duration_s:.2f} s"
    looked = " of it" if report.duration_s is None else ""
    lines = [
        f"{config.trajectory.__struct_config__.tag} for {config.vehicle.name}: {ends}, "
        f"{report.length_m:.2f} m in {report.span_s:.2f} s{looked}, starts at {report.start_speed_m_s:.2f} m/s",
        f"stays within north {_range(report, 0)}, east {_range(report, 1)}, down {_range(report, 2)} m",
        f"{'':24}{'needs':>16}{'at':>12}{'limit':>18}",
        *(_line(demand) for demand in report.demands),
    ]
    why = refused(config, report)
    return "\n".join([*lines, "PASS" if why is None else f"FAIL: {why}"])


def _range(report: Report, axis: int) -> str:
    return f"{report.lowest_ned[axis]:.2f} to {report.highest_ned[axis]:.2f}"


def _line(demand: Demand) -> str:
    sign = "≥" if demand.least else "≤"
    limit = "none" if demand.limit is None else f"{sign} {demand.limit:.4g} {demand.unit}"
    needs = f"{demand.value:.4g} {demand.unit}"
    verdict = "" if demand.limit is None else "  pass" if demand.ok else "  FAIL"
    name = f"least {demand.name}" if demand.least else demand.name
    return f"{name:24}{needs:>16}{demand.time_s:>10.2f} s{limit:>18}{verdict}"
