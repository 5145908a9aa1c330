"""Pre-arm: everything between a configuration and an armed vehicle.

- Before anything is opened: may this configuration fly at all? (``explain_…``, ``ensure_…``)
- :class:`Proof`: the result of the last test with the propellers off, kept in a file of the operator's.
- :func:`confirm_arming`: the operator's confirmation that the motors may start.
- :class:`Checks` of the vehicle, and :class:`Company` of its surroundings: other flights on this machine, other bodies,
  the operator's hold. Each check is OFF, PASS, WARN or FAIL, with a sentence.
- :class:`PrearmSequence`: connect, check, and wait for the operator to arm.
"""

import asyncio
import hashlib
import math
import os
import sys
from collections.abc import Awaitable, Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import msgspec

from groundstation.config import ConfigError
from groundstation.core.control import Law, thrust_bound
from groundstation.core.geometry import Vec3, angle_deg, third_column
from groundstation.core.messages import (
    USUAL_POSE_DROPS,
    Check,
    Others,
    Pose,
    PoseSource,
    PoseStatus,
    Say,
    Sentence,
    Verdict,
    find_link_drops,
    find_pose_drops,
    notice,
    notice_fact,
)
from groundstation.core.mission import Event
from groundstation.core.pilot import Pilot
from groundstation.core.safety import (
    MOUNTING_DEG,
    Agreement,
    Fence,
    GuardsConfig,
    Separation,
    StandingPoses,
    Witness,
    limit_n,
    usual_limit_n,
)
from groundstation.core.trajectory import (
    Demand,
    FeasibilityReport,
    Reference,
    Trajectory,
    check_feasibility,
)
from groundstation.flight.course import Course
from groundstation.flight.flight_controller import FlightController
from groundstation.flight.hold_to_run import HoldToRun
from groundstation.machine import FILE, RecordingConfig, Running, folder_of, is_ours, socket_path
from groundstation.pose import check_stamp_rate
from groundstation.pose.sources import describe_drop, describe_origin_moves, describe_unsteady_clock
from groundstation.settings import Config, FlightConfig
from links.core import CommandLink, LinkError, LinkKind, LinkStatus
from links.io import is_pseudo_terminal, read_key


def examine_trajectory(config: Config) -> FeasibilityReport:
    """Compare the trajectory of ``config`` with its vehicle, its limits and its floor."""
    return check_feasibility(
        config.trajectory.build(),
        config.vehicle,
        config.limits,
        gravity=config.controller.gravity,
        floor_z_m=config.flight.floor_z_m,
    )


ALIKE = 0.1
"""Relative difference up to which a declared and a computed derivative count as equally long [-]: then their
directions differ, and the sentence says so. Chosen."""


def explain_refusal(config: Config, report: FeasibilityReport) -> Sentence | None:
    """Return why the trajectory must not be flown, with the time, the limit and the remedy; None if it may."""
    odd = report.inconsistency
    if odd is not None and odd.name == "period":
        return notice("trajectory.period", at_s=odd.time_s, span_s=odd.declared, far_m=odd.found)
    if odd is not None:
        alike = math.isclose(odd.declared, odd.found, rel_tol=ALIKE)
        return notice(
            "trajectory.direction" if alike else "trajectory.derivative",
            at_s=odd.time_s,
            name=odd.name,
            declared=odd.declared,
            found=odd.found,
            unit=odd.unit,
            of=odd.of,
        )
    return explain_infeasibility(report, getattr(config.trajectory, "speed_m_s", None))


def explain_infeasibility(report: FeasibilityReport, speed_m_s: float | None = None) -> Sentence | None:
    """Return why the vehicle or its room can't follow the trajectory, and the remedy; None if they can.

    ``speed_m_s`` is the trajectory's configured speed; None if it has no such key.
    """
    worst = next((demand for demand in report.demands if not demand.ok), None)
    if worst is None or worst.limit is None:
        return None
    if worst.key == "flight.floor_z_m":
        return notice("trajectory.below_floor", at_s=worst.time_s, depth_m=-worst.value, key=worst.key)
    needed, limit = f"{worst.value:.3g}", f"{worst.limit:.3g}"
    if needed == limit:
        needed, limit = f"{worst.value:.6g}", f"{worst.limit:.6g}"
    if report.share is None:
        advice = notice("trajectory.slower_no_help")
    elif speed_m_s is None:
        advice = notice("trajectory.slow_down", percent=math.floor(100.0 * report.share))
    else:
        advice = notice("trajectory.slow_down_to", speed_m_s=math.floor(1000.0 * report.share * speed_m_s) / 1000.0)
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


def least_braking_room(fence: Fence, way: Trajectory, lasts_s: float) -> tuple[float, float]:
    """Return the least room to the fence after braking from a point of ``way`` [m], and the time of that point [s]."""
    least_m, at_s = math.inf, 0.0
    for i in range(int(lasts_s / STEP_S) + 2):
        time_s = min(i * STEP_S, lasts_s)
        at = way.at(time_s)
        room_m = fence.braking_room_m(at.position_ned, at.velocity_ned)
        if room_m < least_m:
            least_m, at_s = room_m, time_s
    return least_m, at_s


def explain_fence(config: Config) -> Sentence | None:
    """Return why the trajectory does not fit into the fence; None if it does, or without a fence."""
    if config.fence is None:
        return None
    trajectory = config.trajectory.build()
    fence = Fence(config.fence, config.flight.floor_z_m)
    room_m, at_s = least_braking_room(fence, trajectory, trajectory.joints_s[-1])
    return None if room_m > 0.0 else notice("trajectory.fence", at_s=at_s, short_m=-room_m)


def ensure_flyable(config: Config) -> FeasibilityReport:
    """Return the demands of the trajectory; refuse one that can't be flown.

    Raises:
        ConfigError: it can't be flown; the sentence has the time and the limit.
    """
    report = examine_trajectory(config)
    why = explain_refusal(config, report)
    if why is not None:
        raise ConfigError("trajectory", f"{why}. To see all of it: groundstation trajectory CONFIG")
    return report


def find_real_key(config: Config) -> str | None:
    """Return the setting by which a real vehicle or real poses may be reached; None if all stays on this machine.

    Each kind of link and of poses decides; one that does not decide counts as real. Loopback counts as a simulator: a
    user who forwards it to a real vehicle must set a fence and a speed limit without being asked for them.
    """
    link, pose = config.link, config.pose
    if link.real is not None and not is_simulated(link):
        return f"link.{link.real}"
    return None if pose.real is None else f"pose.{pose.real}"


def is_simulated(link: LinkKind) -> bool:
    """Whether ``link`` is configured as simulated, and its port is a pseudo-terminal, as a simulator's is."""
    return link.simulated and is_pseudo_terminal(link.endpoint)


def ensure_guarded(config: Config) -> None:
    """Require a fence, a speed limit and a start from the floor of a configuration that may fly a real vehicle.

    Raises:
        ConfigError: one of them is missing.
    """
    why = find_real_key(config)
    if why is None:
        return
    because = f"a real vehicle may fly here ({why})"
    if config.fence is None:
        says = f'missing, and {because}: kind = "box", north_m = [-2, 2], east_m = [-2, 2], height_m = 2.5, or convex'
        raise ConfigError("fence", says)
    if config.limits.max_speed_m_s is None:
        raise ConfigError("limits.max_speed_m_s", f"missing, and {because}: the highest speed that may be commanded")
    if config.flight.start != "floor":
        raise ConfigError("flight.start", f"expected floor, as {because}")


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
    try:
        return read_key(Path(file))
    except ValueError as error:
        raise ConfigError(name, str(error)) from None


def describe_trajectory(config: Config, report: FeasibilityReport) -> str:
    """Describe the trajectory and its demands as text."""
    ends = "never ends" if report.duration_s is None else f"lasts {report.duration_s:.2f} s"
    looked = " of it" if report.duration_s is None else ""
    floor_z_m, low, high = config.flight.floor_z_m, report.lowest_ned, report.highest_ned
    lines = [
        f"{config.trajectory.__struct_config__.tag} for {config.vehicle.name}: {ends}, "
        f"{report.length_m:.2f} m in {report.span_s:.2f} s{looked}, starts at {report.start_speed_m_s:.2f} m/s",
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


SECTIONS = ("vehicle", "pose", "gate", "link", "flight", "guards")
"""Sections that decide how motors start and stop: a change of one of them voids an earlier test."""
COMMAND = "groundstation props-off CONFIG"
"""Command of the test with the propellers off, for sentences."""


class Proof(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A passed test with the propellers off."""

    vehicle: str
    """The vehicle's name."""
    digest: str
    """Hash of the configuration, see :func:`hash_sections`."""
    firmware: str
    """Firmware of the autopilot as it reports it; empty where it reports none."""
    date: str
    """End of the test (ISO 8601, UTC)."""
    steps: dict[str, str]
    """Findings of each step, by its name."""


def hash_sections(config: Config) -> str:
    """Hash ``SECTIONS``, without file names and ``flight.duration_s``, which start and stop no motor."""
    values = msgspec.to_builtins(config)
    sections = {name: _without_files(values[name]) for name in SECTIONS}
    del sections["flight"]["duration_s"]
    return hashlib.sha256(msgspec.json.encode(sections, order="deterministic")).hexdigest()[:16]


def proof_path(config: Config) -> Path:
    """File of the vehicle's newest test: props-off/VEHICLE.json in $XDG_STATE_HOME/groundstation (~/.local/state)."""
    return folder_of(RecordingConfig()).parent / "props-off" / f"{config.vehicle.name}.json"


def save_proof(proof: Proof, path: Path) -> None:
    """Write ``proof`` to ``path`` in the place of an older one, readable for its owner alone.

    Raises:
        OSError: it can't be written.
    """
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    new = path.with_name(f".{path.name}.{os.getpid()}")
    with open(new, "wb", opener=lambda name, flags: os.open(name, flags | os.O_EXCL | os.O_NOFOLLOW, 0o600)) as file:
        file.write(msgspec.json.format(msgspec.json.encode(proof)) + b"\n")
    new.replace(path)


def read_proof(path: Path) -> Proof | None:
    """Read the test at ``path``; None if there is none, or none that this user wrote."""
    try:
        if not is_ours(path.lstat(), FILE):
            return None
        return msgspec.json.decode(path.read_bytes(), type=Proof)
    except (OSError, msgspec.MsgspecError):
        return None


def explain_missing_proof(proof: Proof | None, config: Config, firmware: str) -> Sentence | None:
    """Return why ``proof`` does not cover this vehicle with its present configuration and firmware; None if it does."""
    if proof is None or proof.vehicle != config.vehicle.name:
        return notice("check.props_off_none", vehicle=config.vehicle.name, command=COMMAND)
    if proof.digest != hash_sections(config):
        sections = f"[{'], ['.join(SECTIONS)}]"
        return notice("check.props_off_changed", date=proof.date, sections=sections, command=COMMAND)
    if proof.firmware != firmware:
        proven, found = proof.firmware or "unknown", firmware or "unknown"
        return notice("check.props_off_firmware", date=proof.date, proven=proven, found=found, command=COMMAND)
    return None


def _without_files(value: dict[str, Any]) -> dict[str, Any]:
    """Leave out the keys that name files."""
    return {
        key: _without_files(item) if isinstance(item, dict) else item
        for key, item in value.items()
        if not key.endswith("file")
    }


def ensure_named(arm: str | None, config: Config) -> None:
    """Require that ``--arm`` names the vehicle of the configuration: the operator must know which one will move.

    Raises:
        ConfigError: it names another.
    """
    if arm is not None and arm != config.vehicle.name:
        raise ConfigError("--arm", f"expected {config.vehicle.name!r}, the vehicle in the config, got {arm!r}")


async def confirm_arming(config: Config, arm: str | None) -> bool:
    """Return whether arming is confirmed: at once with ``--arm``, else by asking the operator at the terminal."""
    if arm is not None:
        return True
    name, rehearsal = config.vehicle.name, config.rehearsal
    prompt = notice("arm.prompt", vehicle=name)
    if rehearsal is not None:
        prompt = notice("arm.prompt_rehearsal", rehearsed=rehearsal.vehicle, vehicle=name)
    answer = await line_from_terminal(notice("arm.question", prompt=prompt).text)
    return answer.strip() == name


async def line_from_terminal(prompt: str) -> str:
    """Read one line from the terminal without blocking the event loop; empty at the end of the input."""
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


# Limits of the checks. Those without a named origin were chosen.
LOOK_S = 1.2
"""Time over which poses are collected before the first checks [s]."""
STEP_S = 0.05
"""Step at which trajectories are checked against the fence [s]."""
FEW_HZ = 20.0
"""Pose rate below which the check fails [1/s]."""
WARN_RATE = 0.8
"""Share of the source's nominal rate below which the check warns [-]."""
OLD_SHARE = 0.5
"""Pose age above which the check fails, as a share of ``flight.coast_s`` [-]."""
WARN_AGE_S = 0.08
"""Pose age above which the check warns [s]."""
NOISE_M = 0.005
"""Position noise above this fails, 1σ per axis [m]: the excitation tones move the vehicle by 2 mm, and 4 mm of noise
were flown (`groundstation-sim dev alarms --floors`)."""
NOISE_DEG = 0.8
"""Roll and pitch noise above this fails, 1σ [°]: 0.6 was flown (`groundstation-sim dev alarms --floors`)."""
WARN_NOISE = 0.5
"""Share of either noise limit above which the check warns [-]."""
MOVED_M = 0.03
"""Largest spread of the positions of a vehicle at rest [m]."""
WANDERED_M = 0.5
"""Largest such spread if the poses have a velocity [m]: an autopilot's own estimate wanders, by GPS."""
TILT_DEG = 15.0
"""Tilt at rest above this fails [°]."""
WARN_TILT_DEG = 6.0
"""Tilt at rest above this is a warning [°]."""
FLOOR_M = 0.1
"""Largest difference between ``flight.floor_z_m`` and the height of the vehicle at rest [m]."""
FLOOR_WANDERS_M = 1.0
"""Largest such difference if the poses have a velocity [m]."""
WARN_RTT = 0.5
"""Round trip above which the check warns, as a share of ``guards.rtt_s`` [-]."""
BATTERY_MARGIN = 0.2
"""Charge above ``guards.battery_share`` below which the check warns [-]."""


def find_verdict(value: float, warn: float, fail: float) -> Verdict:
    """Return PASS up to ``warn``, WARN up to ``fail``, and FAIL above, or for NaN."""
    return Verdict.PASS if value <= warn else Verdict.WARN if value <= fail else Verdict.FAIL


def report(check: str, verdict: Verdict, id: str, /, **values: object) -> Check:
    """Make the result of ``check`` with the sentence ``id``; without its remedy if it passes."""
    says = notice_fact(id, **values) if verdict is Verdict.PASS else notice(id, **values)
    return Check.of(check, verdict, says)


def tilt_noise_deg(poses: Sequence[Pose]) -> float:
    """Noise of roll and pitch in ``poses`` of a vehicle at rest, 1σ of each [°]."""
    axes = [third_column(pose.attitude) for pose in poses]
    second_differences = [
        math.dist([2.0 * y for y in b], [x + z for x, z in zip(a, c, strict=True)])
        for a, b, c in zip(axes, axes[1:], axes[2:], strict=False)
    ]
    # The second difference of white noise has 1 + 4 + 1 = 6 times its variance; two axes make it 12.
    squares = sum(one * one for one in second_differences)
    return math.degrees(math.sqrt(squares / (12.0 * max(1, len(second_differences)))))


def explain_drops(source: PoseStatus) -> Sentence | None:
    """Return the source's advice, or else the most frequent reason of dropped poses; None without either."""
    dropped = source.dropped
    if source.advice:
        return notice("pose.advice", says=source.advice)
    if not any(dropped.values()):
        return None
    losses = {reason: count for reason, count in dropped.items() if count and reason not in USUAL_POSE_DROPS}
    most = losses or dropped
    reason = max(most, key=lambda reason: most[reason])
    return notice("pose.most_dropped", count=dropped[reason], why=describe_drop(reason, source.excesses))


class Checks:
    """The checks of one configuration. Times are on the event loop's clock [s]."""

    def __init__(self, config: Config, others: Others | None = None, proof: Proof | None = None) -> None:
        """Make the checks that need no vehicle, once: they take some tenths of a second.

        ``others`` are vehicles to keep away from; ``proof`` is the kept test with the propellers off.
        """
        self._config = config
        self._proof, self._real = proof, find_real_key(config) is not None
        self._separation = None if others is None else Separation(config.separation, others)
        self._fence = None if config.fence is None else Fence(config.fence, config.flight.floor_z_m)
        self._trajectory = config.trajectory.build()
        demands = examine_trajectory(config)
        self._fixed = [
            self._flyable(demands), self._certificate(demands), self._thrust_limit(), *self._simulation(),
        ]  # fmt: skip

    def __call__(
        self,
        standing: StandingPoses,
        noise_m: float,
        link: LinkStatus,
        now_s: float,
        witness: Agreement | None,
        source: PoseStatus,
    ) -> list[Check]:
        """Make all checks of the vehicle at rest.

        Args:
            standing: its poses.
            noise_m: measured noise of these, 1σ [m].
            link: status of the command link.
            now_s: present time [s].
            witness: comparison of the poses with the autopilot's own attitude; None if it sends none.
            source: status of the pose source.
        """
        poses = list(standing.poses)
        if len(poses) < 2:
            moves = describe_origin_moves(source.origin_moves) if source.origin_moves > 1 else None
            why = moves or explain_drops(source) or notice("pose.check_source")
            no_poses = report("poses", Verdict.FAIL, "pose.none", why=why)
            return [no_poses, self._arm(link), self._frames(link), *self._fixed]
        place = standing.place_ned
        return [
            self._rate(poses, source),
            self._age(poses[-1], now_s, source),
            self._deadline(),
            self._props_off(link),
            self._noise(noise_m, tilt_noise_deg(poses)),
            self._rest(poses, source),
            self._tilt(poses[-1]),
            self._witness(witness),
            self._floor(poses[-1], place),
            self._inside(place),
            self._apart(place, now_s),
            self._battery(link),
            self._round_trip(link),
            self._arm(link),
            self._frames(link),
            self._link_drops(link),
            self._pose_drops(source),
            self._failsafe(),
            *self._fixed,
            self._ways(place),
        ]

    def _rate(self, poses: list[Pose], source: PoseStatus) -> Check:
        stamps = check_stamp_rate(source, self._config.pose)
        if stamps is not None:
            return stamps
        rate = (len(poses) - 1) / max(poses[-1].arrival_s - poses[0].arrival_s, 1e-6)
        wanted = self._config.pose.rate_hz
        nominal = "" if wanted is None else f", pose.rate_hz says {wanted:g}"
        if rate < FEW_HZ:
            return report(
                "pose rate", Verdict.FAIL, "check.pose_rate_low", rate_hz=rate, nominal=nominal, limit_hz=FEW_HZ
            )
        verdict = Verdict.WARN if wanted is not None and rate < WARN_RATE * wanted else Verdict.PASS
        return report("pose rate", verdict, "check.pose_rate", rate_hz=rate, nominal=nominal)

    def _age(self, pose: Pose, now_s: float, source: PoseStatus) -> Check:
        if source.unsteady_clock:
            return Check.of("pose age", Verdict.FAIL, describe_unsteady_clock())
        age, fail = now_s - pose.time_s, OLD_SHARE * self._config.flight.coast_s
        verdict = find_verdict(age, min(WARN_AGE_S, fail), fail)
        if verdict is Verdict.FAIL and (why := explain_drops(source)):
            return report("pose age", verdict, "check.pose_age_why", age_ms=1e3 * age, why=why)
        return report("pose age", verdict, "check.pose_age", age_ms=1e3 * age)

    def _props_off(self, link: LinkStatus) -> Check:
        """Check that the test with the propellers off was passed with the present configuration."""
        if not self._real or self._config.rehearsal is not None:  # a rehearsal's pseudo-terminal looks like any port
            return report("props-off test", Verdict.OFF, "check.props_off_simulated")
        why = explain_missing_proof(self._proof, self._config, link.firmware)
        if why is not None:
            return Check.of("props-off test", Verdict.WARN, why)
        assert self._proof is not None, "a missing one is reported above"
        return report("props-off test", Verdict.PASS, "check.props_off", date=self._proof.date)

    def _deadline(self) -> Check:
        """Check the times without poses (coasting, then level) against their defaults."""
        coast_s, level_s = self._config.flight.coast_s, self._config.guards.level_s
        usual_s = FlightConfig().coast_s + GuardsConfig().level_s
        values = {"coast_ms": 1e3 * coast_s, "level_ms": 1e3 * level_s}
        if coast_s + level_s <= usual_s + 1e-9:  # 1 ns for rounding
            return report("deadline", Verdict.PASS, "check.deadline", **values)
        return report("deadline", Verdict.WARN, "check.deadline_long", usual_ms=1e3 * usual_s, **values)

    def _noise(self, noise_m: float, noise_deg: float) -> Check:
        """Check the noise of position and of roll and pitch; the worse by its limit decides."""
        verdict = find_verdict(max(noise_m / NOISE_M, noise_deg / NOISE_DEG), WARN_NOISE, 1.0)
        return report("pose noise", verdict, "check.pose_noise", noise_mm=1e3 * noise_m, noise_deg=noise_deg)

    def _rest(self, poses: list[Pose], source: PoseStatus) -> Check:
        if source.origin_moves > 1:
            many = source.origin_moves > self._config.guards.pose_resets
            verdict = Verdict.FAIL if many else Verdict.WARN
            return Check.of("at rest", verdict, describe_origin_moves(source.origin_moves))
        far = max(math.dist(poses[0].position_ned, pose.position_ned) for pose in poses)
        limit = MOVED_M if poses[0].velocity_ned is None else WANDERED_M
        return report("at rest", find_verdict(far, limit, limit), "check.at_rest", spread_cm=100.0 * far)

    def _tilt(self, pose: Pose) -> Check:
        tilt = angle_deg(third_column(pose.attitude)[2])
        return report("tilt", find_verdict(tilt, WARN_TILT_DEG, TILT_DEG), "check.tilt", tilt_deg=tilt)

    def _witness(self, found: Agreement | None) -> Check:
        """Check that the autopilot's own attitude agrees with the poses."""
        name, config = "second witness", self._config
        if config.pose.by_autopilot:
            return report(name, Verdict.OFF, "check.witness_own")
        by_radio = not config.link.has_autopilot
        if found is None:
            if by_radio:
                return report(name, Verdict.OFF, "check.witness_radio")
            return report(name, Verdict.WARN, "check.witness_silent")
        if found.unlike:
            sign = "; or correct link.attitude_pitch" if by_radio and found.unlike == ("pitch",) else ""
            return report(name, Verdict.FAIL, "check.witness_unlike", axes=" and ".join(found.unlike), sign=sign)
        if found.mounting_deg > MOUNTING_DEG:
            return report(name, Verdict.FAIL, "check.witness_askew", askew_deg=found.mounting_deg)
        if found.disagrees_since_s is not None:
            return report(name, Verdict.WARN, "check.witness_carried")
        alike = f"; {', '.join(found.alike)} went the same way as it was moved" if found.alike else ""
        return report(name, Verdict.PASS, "check.witness", askew_deg=found.mounting_deg, alike=alike)

    def _floor(self, pose: Pose, place: Vec3) -> Check:
        if self._config.flight.start == "air":
            return report("floor", Verdict.OFF, "check.floor_air")
        off = abs(place[2] - self._config.flight.floor_z_m)
        limit = FLOOR_M if pose.velocity_ned is None else FLOOR_WANDERS_M
        floor_m = self._config.flight.floor_z_m
        return report("floor", find_verdict(off, limit, limit), "check.floor", down_m=place[2], floor_m=floor_m)

    def _inside(self, place: Vec3) -> Check:
        if self._fence is None:
            return report("fence", Verdict.OFF, "check.fence_none")
        room = self._fence.room_m(place)
        if room <= 0.0:
            return report("fence", Verdict.FAIL, "check.fence_outside", outside_m=-room)
        return report("fence", Verdict.PASS, "check.fence_inside", inside_m=room)

    def _apart(self, place: Vec3, now_s: float) -> Check:
        """Check that every other vehicle is seen, and far enough away."""
        name, separation = "other vehicles", self._separation
        if separation is None:
            return report(name, Verdict.OFF, "check.others_none")
        config, unknown = separation.config, separation.unknown(now_s)
        near = separation.nearest(place, (0.0, 0.0, 0.0), now_s)
        if near is not None and not near.distance_m >= config.distance_m:
            values = {"distance_m": near.distance_m, "name": near.name, "limit_m": config.distance_m}
            return report(name, Verdict.FAIL, "check.others_near", **values)
        if unknown:
            verdict = Verdict.WARN if config.unknown == "warn" else Verdict.FAIL
            return report(name, verdict, "check.others_unseen", names=", ".join(unknown))
        assert near is not None, "all are seen"
        return report(name, Verdict.PASS, "check.others", name=near.name, distance_m=near.distance_m)

    def _ways(self, place: Vec3) -> Check:
        """Check the hold after take-off, the ways onto the trajectory and the trajectory against the fence.

        Each point counts with the vehicle's braking distance.
        """
        if self._fence is None:
            return report("ways in the fence", Verdict.OFF, "check.ways_none")
        config = self._config
        above = (place[0], place[1], config.flight.floor_z_m - config.takeoff.height_m)
        course = Course(config)
        ways: list[tuple[str, Trajectory, float]] = [
            (f"way {number} onto the trajectory", way, way.duration_s)
            for number, way in enumerate(course.entry(Reference(above)), 1)
        ]
        ways.append(("trajectory", self._trajectory, self._trajectory.joints_s[-1]))
        least, where = self._fence.room_m(above), "hold after take-off"
        for name, way, lasts_s in ways:
            room, at_s = least_braking_room(self._fence, way, lasts_s)
            if room < least:
                least, where = room, f"{name}, {at_s:.1f} s after its start"
        if least <= 0.0:
            return report("ways in the fence", Verdict.FAIL, "check.ways_short", where=where)
        return report("ways in the fence", Verdict.PASS, "check.ways", room_m=least, where=where)

    def _battery(self, link: LinkStatus) -> Check:
        volts, share, c = link.battery_v, link.battery_share, self._config.guards
        if share is None and (volts is None or c.battery_v is None):
            if volts is None:
                return report("battery", Verdict.OFF, "check.battery_silent")
            return report("battery", Verdict.OFF, "check.battery_unjudged", voltage_v=volts)
        charge = [f"{volts:.2f} V"] if volts is not None else []
        charge += [f"{100.0 * share:.0f} %"] if share is not None else []
        low = (share is not None and share < c.battery_share) or (
            volts is not None and c.battery_v is not None and volts < c.battery_v
        )
        soon = share is not None and share < c.battery_share + BATTERY_MARGIN
        verdict = Verdict.FAIL if low else Verdict.WARN if soon else Verdict.PASS
        return report("battery", verdict, "check.battery_low" if low else "check.battery", charge=", ".join(charge))

    def _round_trip(self, link: LinkStatus) -> Check:
        if link.rtt_s is None:
            return report("round trip", Verdict.OFF, "check.rtt_unknown")
        limit = self._config.guards.rtt_s
        verdict = find_verdict(link.rtt_s, WARN_RTT * limit, limit)
        return report("round trip", verdict, "check.rtt", rtt_ms=1e3 * link.rtt_s, limit_ms=1e3 * limit)

    def _arm(self, link: LinkStatus) -> Check:
        name, said = "ready to arm", f"; it said last: “{link.text}”" if link.text else ""
        if link.state == "armed":
            return report(name, Verdict.FAIL, "check.armed_already")
        if link.state != "connected":
            id = "check.link_state_why" if link.text else "check.link_state"
            return report(name, Verdict.FAIL, id, state=link.state, text=link.text)
        if link.unfit:
            return report(name, Verdict.FAIL, "check.unfit", why=link.unfit)
        # Only a warning: the autopilot's own checks may concern its present mode alone, and arming will show.
        if link.ready is False:
            return report(name, Verdict.WARN, "check.prearm_fails", said=said)
        return report(name, Verdict.PASS, "check.ready", said=said)

    def _frames(self, link: LinkStatus) -> Check:
        if link.conflict:
            return report("frames", Verdict.FAIL, "check.conflict", why=link.conflict)
        if link.warning:
            return report("frames", Verdict.WARN, "check.link_warns", why=link.warning)
        if self._config.link.has_autopilot:
            return report("frames", Verdict.OFF, "check.frames_direct")
        return report("frames", Verdict.PASS, "check.frames_paced")

    def _link_drops(self, link: LinkStatus) -> Check:
        name, drops = "link drops", find_link_drops(link)
        if drops:
            return report(name, Verdict.WARN, "check.link_drops", drops="; ".join(drop.says.text for drop in drops))
        return report(name, Verdict.PASS, "link.few_dropped", total=link.received)

    def _pose_drops(self, source: PoseStatus) -> Check:
        name, found = "pose drops", find_pose_drops(source)
        if source.dropped.get("second_sender") and source.advice:
            return report(name, Verdict.FAIL, "pose.advice", says=source.advice)
        if found is None:
            return report(name, Verdict.PASS, "pose.few_dropped", total=source.accepted)
        reason, count, total = found
        why = describe_drop(reason, source.excesses)
        return report(name, Verdict.WARN, "pose.dropped", count=count, total=total, why=why)

    def _failsafe(self) -> Check:
        """Warn that the receiver's failsafe can't be checked from here."""
        if self._config.link.has_autopilot:
            return report("failsafe", Verdict.OFF, "check.failsafe_autopilot")
        return report("failsafe", Verdict.WARN, "check.failsafe_receiver")

    def _thrust_limit(self) -> Check:
        """Check the thrust limit on the floor, where the poses may be another body's."""
        vehicle, weight_n = self._config.vehicle, self._config.weight_n
        limit, usual = limit_n(self._config.takeoff, vehicle, weight_n), usual_limit_n(vehicle, weight_n)
        values = {"thrust_n": limit, "percent": 100.0 * limit / self._config.weight_n}
        if limit <= usual:
            return report("take-off thrust", Verdict.PASS, "check.thrust_limit", **values)
        return report("take-off thrust", Verdict.WARN, "check.thrust_limit_high", usual_n=usual, **values)

    def _simulation(self) -> list[Check]:
        """Warn of ``link.simulated``, which drops the demand for a fence: it must not stay in a file unnoticed."""
        link = self._config.link
        if not link.simulated or self._config.rehearsal is not None:
            return []  # a rehearsal sets the key itself
        believed = "no fence and no speed limit are asked for" if is_simulated(link) else "not believed of this port"
        return [report("simulated", Verdict.WARN, "check.simulated", believed=believed, endpoint=link.endpoint)]

    def _certificate(self, demands: FeasibilityReport) -> Check:
        """Check the a-priori bound on thrust (docs/explanation/law.md, section 4)."""
        law = self._config.controller
        if not isinstance(law, Law):
            return report("thrust bound", Verdict.OFF, "check.bound_no_law")
        bound = thrust_bound(law, acceleration_sup=demands.acceleration_m_s2, v_start=0.0).bound
        if bound > 0.0:
            return report("thrust bound", Verdict.PASS, "check.bound", bound_m_s2=bound)
        least_n = self._config.vehicle.thrust_min_n
        return report("thrust bound", Verdict.OFF, "check.bound_by_limit", thrust_min_n=least_n, bound_m_s2=bound)

    def _flyable(self, demands: FeasibilityReport) -> Check:
        """Check that the vehicle can follow the trajectory."""
        why = explain_refusal(self._config, demands)
        if why is not None:
            return Check.of("trajectory", Verdict.FAIL, why)
        return report("trajectory", Verdict.PASS, "check.trajectory")


def describe_failures(checks: Iterable[Check]) -> str:
    """Join the failed checks into one sentence; empty if none failed."""
    return "; ".join(f"{check.name}: {check.says}" for check in checks if check.verdict is Verdict.FAIL)


def describe_checks(checks: list[Check]) -> str:
    """Describe ``checks`` as text, one on a line."""
    return "\n".join(f"{check.verdict:5}{check.name:20}{check.says}" for check in checks)


SEEN_S = 0.5
"""Time after its last sighting for which a body's place counts [s]. Chosen."""


class Company:
    """Checks of the surroundings of one flight. Times are on the event loop's clock [s]."""

    def __init__(
        self, config: Config, bodies: Others | None, running: Callable[[], Sequence[Running]], hold: HoldToRun | None
    ) -> None:
        """Look at nothing yet.

        Args:
            config: the flight's.
            bodies: all bodies that the source shows; None if it shows no others.
            running: lists the other flights of this machine.
            hold: the control that the operator must hold; None without one.
        """
        self._config = config
        self._bodies = bodies
        self._running = running
        self._hold = hold

    def __call__(self, standing: StandingPoses, now_s: float, *, arming: bool = False) -> list[Check]:
        """Make the checks; the operator's hold fails only with ``arming``, and before that it warns."""
        return [self._names(), self._bodies_near(standing, now_s), self._hand(Verdict.FAIL if arming else Verdict.WARN)]

    def leave(self) -> None:
        """Stop looking for bodies that are not configured: take-off begins."""
        if self._bodies is not None:
            self._bodies.every = False

    def _names(self) -> Check:
        """Check that no other flight of this machine has the same link, body or vehicle name."""
        own, name = entry_of(self._config, "", 0), "other flights"
        failures, warnings = list[Sentence](), list[Sentence]()
        for one in self._running():
            who = f"{one.command} {one.vehicle} (process {one.pid})"
            if own.link == one.link:
                failures.append(notice("flights.same_link", who=who, link=one.link))
            elif own.body and own.body == one.body:
                # Bodies of one name from two pose sources may be two bodies.
                found = failures if own.poses == one.poses else warnings
                found.append(notice("flights.same_body", who=who, body=one.body))
            elif own.vehicle == one.vehicle:
                warnings.append(notice("flights.same_name", who=who))
        if not failures and not warnings:
            return report(name, Verdict.PASS, "check.flights")
        clashes = "; ".join(one.text for one in failures + warnings)
        return report(name, Verdict.FAIL if failures else Verdict.WARN, "check.flights_clash", clashes=clashes)

    def _bodies_near(self, standing: StandingPoses, now_s: float) -> Check:
        """Check that no other body is within the vehicle's size."""
        name, size = "bodies near", self._config.vehicle.size_m
        if self._bodies is None or not standing.poses:
            return report(name, Verdict.OFF, "check.bodies_unknown")
        place, near = standing.place_ned, list[tuple[float, str]]()
        for body in self._bodies.bodies:
            sight = self._bodies.sighting(body)
            if sight is not None and now_s - sight.time_s < SEEN_S:
                near.append((math.dist(place, sight.position_ned), body))
        if not near:
            return report(name, Verdict.PASS, "check.bodies_none")
        distance, body = min(near)
        values = {"body": body, "distance_m": distance, "own": self._config.body}
        if distance >= size:
            return report(name, Verdict.PASS, "check.bodies", **values)
        return report(name, Verdict.FAIL, "check.bodies_near", size_m=size, **values)

    def _hand(self, otherwise: Verdict) -> Check:
        """Check that the operator holds the control that must be held; without it the verdict is ``otherwise``."""
        name, hold = "operator's hold", self._hold
        if hold is None:
            return report(name, Verdict.OFF, "check.hold_none")
        return Check.of(name, Verdict.PASS if hold.obstacle is None else otherwise, hold.advice)


def entry_of(config: Config, command: str, pid: int) -> Running:
    """Return the register's entry for a flight with this configuration."""
    pose = config.pose
    return Running(
        pid=pid,
        command=command,
        vehicle=config.vehicle.name,
        socket=str(socket_path(config.status, config.vehicle.name).absolute()),
        body=pose.body_id,
        poses=f"{pose.kind} {pose.address}",
        link=config.link.destination,
    )


LOOK_AGAIN_S = 1.0
"""Period at which the checks are repeated until the operator arms [s]. Chosen."""


class FlightEnded(Exception):
    """The flight can't go on, for the reason in ``sentence``."""

    def __init__(self, sentence: Sentence) -> None:
        super().__init__(sentence.text)
        self.sentence = sentence


class PrearmSequence:
    """The sequence of one flight from connecting until the vehicle may be armed."""

    checks: tuple[Check, ...] = ()
    """Newest checks, for the screens; empty once the operator has armed."""

    def __init__(
        self,
        config: Config,
        link: CommandLink,
        source: PoseSource,
        pilot: Pilot,
        controller: FlightController,
        witness: Callable[[], Witness],
        *,
        confirm: Callable[[], Awaitable[bool]],
        others: Others | None,
        say: Say,
        company: Company,
    ) -> None:
        """Open nothing yet.

        Args:
            config: the flight's.
            link: command link, to be connected.
            source: pose source, to be started.
            pilot: gets the poses; its noise estimate is checked.
            controller: the flight's.
            witness: returns the present comparison of attitudes.
            confirm: asks the operator before the vehicle is armed.
            others: vehicles to keep away from.
            say: takes sentences for the operator.
            company: checks of the surroundings.
        """
        self._config = config
        self._link = link
        self._source = source
        self._pilot = pilot
        self._controller = controller
        self._witness = witness
        self._confirm = confirm
        self._others = others
        self._say = say
        self._company = company
        self._look: Checks | None = None
        self.arm_asked = asyncio.Event()
        """Set by a request to arm."""
        self.first_pose = asyncio.Event()
        """The owner sets this event at the first pose."""

    async def depart(self, deliver: Callable[[Pose], None]) -> None:
        """Run the whole sequence; when it returns, the vehicle may be armed. ``deliver`` gets all poses from now on.

        Raises:
            FlightEnded: no pose arrives, a check fails, or the operator does not confirm.
            LinkError: the link can't be connected.
        """
        loop, controller = asyncio.get_running_loop(), self._controller
        from_floor = self._config.flight.start == "floor"
        if from_floor:
            self._pilot.set_on_floor()
        controller.go(Event.START, notice("mission.waiting"), loop.time())
        await self._connect(deliver)
        if from_floor:
            await self._stand()
            for one in self._check():
                if one.verdict in (Verdict.WARN, Verdict.FAIL):
                    self._say(notice("flight.preflight", verdict=one.verdict, check=one.name, says=one.says))
            self._ensure_passed("fault.preflight")
        status = self._source.status
        ready = notice("mission.ready", rate_hz=status.rate_hz, latency_ms=1e3 * status.latency_s)
        controller.go(Event.CONNECTED, ready, loop.time())
        await self._operator()
        if from_floor:
            self._check(arming=True)
            self._ensure_passed("fault.not_armed")
        self.checks = ()
        self._company.leave()
        self._witness().arm()

    async def check(self, deliver: Callable[[Pose], None]) -> list[Check]:
        """Connect and make the checks, without arming; a connection that fails is a failed check."""
        try:
            await self._connect(deliver)
            await self._stand()
            return self._check()
        except (FlightEnded, LinkError, OSError) as error:
            conflict = self._link.status.conflict
            found = [report("connection", Verdict.FAIL, "check.connection", why=error)]
            return [*found, report("frames", Verdict.FAIL, "check.conflict", why=conflict)] if conflict else found

    async def _stand(self) -> None:
        """Collect poses of the vehicle at rest for ``LOOK_S``, and let the link examine its autopilot."""
        self._look = Checks(self._config, self._others, read_proof(proof_path(self._config)))
        await asyncio.gather(asyncio.sleep(LOOK_S), self._link.examine())

    def _check(self, *, arming: bool = False) -> list[Check]:
        """Make all checks; ``arming``: the motors start next."""
        assert self._look is not None, "_stand comes first"
        now, standing = asyncio.get_running_loop().time(), self._controller.standing
        agreement = self._witness().verdict(now)
        checks = self._look(standing, self._pilot.noise_m, self._link.status, now, agreement, self._source.status)
        checks += self._company(standing, now, arming=arming)
        self.checks = tuple(checks)
        return checks

    def _ensure_passed(self, id: str) -> None:
        """End the flight by the sentence ``id`` if a newest check failed."""
        if bad := describe_failures(self.checks):
            raise FlightEnded(notice(id, failed=bad))

    async def _connect(self, deliver: Callable[[Pose], None]) -> None:
        """Start the pose source, connect the link, and wait for the first pose."""
        await self._source.start(deliver)
        await self._link.connect()
        wait = self._config.flight.pose_wait_s
        try:
            await asyncio.wait_for(self.first_pose.wait(), wait)
        except TimeoutError:
            raise FlightEnded(notice("fault.no_first_pose", wait_s=wait, why=self._explain_silence())) from None

    def _explain_silence(self) -> Sentence:
        """Return why no pose has arrived."""
        pose = self._config.pose
        if pose.by_autopilot:
            said = f"; it said last: “{self._link.status.text}”" if self._link.status.text else ""
            if hint := explain_drops(self._source.status):
                said = f"; {hint}{said}"
            return notice("pose.no_estimate", said=said)
        settings = {pose.address_key: pose.address, pose.body_key: pose.body_name}
        keys = ", ".join(f"pose.{key} = {value}" for key, value in settings.items() if key)
        why = explain_drops(self._source.status) or notice("pose.nothing_arrived")
        return notice("pose.nothing_of_use", kind=pose.kind, keys=keys, why=why)

    async def _operator(self) -> None:
        """Wait until the operator arms: at the terminal, or by a request."""
        confirmed, asked = asyncio.ensure_future(self._confirm()), asyncio.ensure_future(self.arm_asked.wait())
        try:
            while not (confirmed.done() or asked.done()):
                if self._look is not None:
                    self._check()  # the screens show the present checks until the operator arms
                await asyncio.wait({confirmed, asked}, timeout=LOOK_AGAIN_S, return_when=asyncio.FIRST_COMPLETED)
            if not asked.done() and not confirmed.result():
                raise FlightEnded(notice("fault.not_confirmed"))
        finally:
            for task in (confirmed, asked):
                task.cancel()
            await asyncio.gather(confirmed, asked, return_exceptions=True)
