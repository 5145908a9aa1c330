"""Preflight: whether a configuration may fly at all, before anything is opened.

What it asks of the vehicle, what was proven of it with its propellers off (kept in a file of the operator's), and who
says that its motors may start.
"""

import asyncio
import hashlib
import os
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path

import msgspec

from groundstation.config import ConfigError
from groundstation.core.trajectory import Demand, FeasibilityReport, check_feasibility, explain_infeasibility
from groundstation.runtime import FILE, RecordingConfig, folder_of, is_ours
from groundstation.settings import Config
from links.bridge import BridgeLinkConfig
from links.io import is_pseudo_terminal, read_key
from links.mavlink.protocol import MavlinkLinkConfig
from links.rf import RfLinkConfig


def examine_trajectory(config: Config) -> FeasibilityReport:
    """The trajectory of ``config``, held against its vehicle, its limits and its floor."""
    return check_feasibility(
        config.trajectory.build(),
        config.vehicle,
        config.limits,
        gravity=config.controller.gravity,
        floor_z_m=config.flight.floor_z_m,
    )


def explain_refusal(config: Config, report: FeasibilityReport) -> str | None:
    """Why the trajectory must not fly, with the time, the limit and what to do; None if it may."""
    return explain_infeasibility(report, getattr(config.trajectory, "speed_m_s", None))


def ensure_flyable(config: Config) -> FeasibilityReport:
    """Stop before anything moves if the trajectory asks too much; returns what it asks.

    Raises:
        ConfigError: with the time and the limit.
    """
    report = examine_trajectory(config)
    why = explain_refusal(config, report)
    if why is not None:
        raise ConfigError("trajectory", f"{why}. To see all of it: groundstation trajectory CONFIG")
    return report


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


def describe_trajectory(config: Config, report: FeasibilityReport) -> str:
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
    why = explain_refusal(config, report)
    return "\n".join([*lines, "PASS" if why is None else f"FAIL: {why}"])


def _range(report: FeasibilityReport, axis: int) -> str:
    return f"{report.lowest_ned[axis]:.2f} to {report.highest_ned[axis]:.2f}"


def _line(demand: Demand) -> str:
    sign = "≥" if demand.least else "≤"
    limit = "none" if demand.limit is None else f"{sign} {demand.limit:.4g} {demand.unit}"
    needs = f"{demand.value:.4g} {demand.unit}"
    verdict = "" if demand.limit is None else "  pass" if demand.ok else "  FAIL"
    name = f"least {demand.name}" if demand.least else demand.name
    return f"{name:24}{needs:>16}{demand.time_s:>10.2f} s{limit:>18}{verdict}"


SECTIONS = ("vehicle", "pose", "gate", "link", "flight", "guards")
"""What decides how motors start and stop: a test is of no worth once one of these has changed."""
COMMAND = "groundstation props-off CONFIG"


class Proof(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One test that was passed."""

    vehicle: str
    """The vehicle's name."""
    digest: str
    """Of the configuration, see :func:`digest`."""
    firmware: str
    """Of the autopilot, in its own words; empty where it does not tell."""
    date: str
    """When the test was over (ISO 8601, UTC)."""
    steps: dict[str, str]
    """Each step of the test, and what was seen and measured in it."""


def digest(config: Config) -> str:
    """Of the sections that decide how motors start and stop; names of files, and how long it flies, do not count."""
    told = msgspec.to_builtins(config)
    sections = {name: _without_files(told[name]) for name in SECTIONS}
    del sections["flight"]["duration_s"]
    return hashlib.sha256(msgspec.json.encode(sections, order="deterministic")).hexdigest()[:16]


def place(config: Config) -> Path:
    """Where its newest test is kept: ``$XDG_STATE_HOME/groundstation/props-off/VEHICLE.json``, or in ~/.local/state."""
    return folder_of(RecordingConfig()).parent / "props-off" / f"{config.vehicle.name}.json"


def save(proof: Proof, path: Path) -> None:
    """Keep ``proof`` for its owner alone, in the place of an older one.

    Raises:
        OSError: it can't be written.
    """
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    new = path.with_name(f".{path.name}.{os.getpid()}")
    with open(new, "wb", opener=lambda name, flags: os.open(name, flags | os.O_EXCL | os.O_NOFOLLOW, 0o600)) as file:
        file.write(msgspec.json.format(msgspec.json.encode(proof)) + b"\n")
        file.flush()
        os.fsync(file.fileno())
    new.replace(path)


def on_file(path: Path) -> Proof | None:
    """The test that is kept at ``path``; None where there is none, or none that this user wrote."""
    try:
        if not is_ours(path.lstat(), FILE):
            return None
        return msgspec.json.decode(path.read_bytes(), type=Proof)
    except (OSError, msgspec.MsgspecError):
        return None


def lacks(proof: Proof | None, config: Config, firmware: str) -> str:
    """Why ``proof`` does not hold for this vehicle as it is now; empty where it does."""
    if proof is None or proof.vehicle != config.vehicle.name:
        return f"no test with the propellers off is on file for {config.vehicle.name}: {COMMAND}"
    if proof.digest != digest(config):
        return (
            f"since the test with the propellers off ({proof.date}) the configuration has changed in one of "
            f"[{'], ['.join(SECTIONS)}]: do it again, {COMMAND}"
        )
    if proof.firmware != firmware:
        return (
            f"the test with the propellers off ({proof.date}) was of another firmware, {proof.firmware or 'unknown'}; "
            f"this is {firmware or 'unknown'}: do it again, {COMMAND}"
        )
    return ""


def _without_files(value: object) -> dict[str, object]:
    assert isinstance(value, dict), "a section is a table"
    return {
        key: _without_files(item) if isinstance(item, dict) else item
        for key, item in value.items()
        if not key.endswith("file")
    }


def ensure_named(arm: str | None, config: Config) -> None:
    """``--arm`` must name the vehicle of the config: the operator says which one will move.

    Raises:
        ConfigError: it names another.
    """
    if arm is not None and arm != config.vehicle.name:
        raise ConfigError("--arm", f"expected {config.vehicle.name!r}, the vehicle in the config, got {arm!r}")


def confirmation(config: Config, arm: str | None) -> Callable[[], Awaitable[bool]]:
    """Who confirms arming: ``--arm``, or the operator at the terminal."""

    async def confirm_by_option() -> bool:
        return True

    async def ask_operator() -> bool:
        name, prompt = config.vehicle.name, "{} is ready. Its motors will start. Type its name to arm"
        if config.rehearsal is not None:
            prompt = (
                f"REHEARSAL of {config.rehearsal.vehicle}: it is ready, and nothing real will move. Type {{}} to arm"
            )
        prompt = f"{prompt.format(name)}, anything else to stop: "
        answer = await line_from_terminal(prompt)
        return answer.strip() == name

    return confirm_by_option if arm is not None else ask_operator


async def line_from_terminal(prompt: str) -> str:
    """One line from the terminal, without blocking the event loop; empty at its end."""
    loop = asyncio.get_running_loop()
    line: asyncio.Future[str] = loop.create_future()

    def read() -> None:
        if not line.done():
            line.set_result(sys.stdin.readline())

    print(prompt, end="", flush=True)
    loop.add_reader(sys.stdin.fileno(), read)
    try:
        return await line
    finally:
        loop.remove_reader(sys.stdin.fileno())
