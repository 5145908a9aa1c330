"""Pre-arm sequence: connect, check what must hold before the motors start, and wait for whoever sends the vehicle off.

Each check is OFF, PASS, WARN or FAIL with a sentence: of the vehicle itself, and of what is beside it, other flights
here, other bodies, and its operator's hand.

Before anything is opened: whether a configuration may fly at all. What it asks of the vehicle, what was proven of it
with its propellers off (kept in a file of the operator's), and who says that its motors may start.
"""

import asyncio
import hashlib
import math
import os
import sys
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path

import msgspec

from groundstation.config import ConfigError
from groundstation.core.control import Law, thrust_bound
from groundstation.core.geometry import Vec3, angle_deg, third_column
from groundstation.core.messages import (
    Check,
    Others,
    Pose,
    PoseSource,
    PoseStatus,
    Say,
    Severity,
    Verdict,
    find_link_drops,
    find_pose_drops,
    notice,
)
from groundstation.core.mission import Event
from groundstation.core.pilot import Pilot
from groundstation.core.safety import (
    ASKEW_DEG,
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
    explain_infeasibility,
)
from groundstation.flight.hold_to_run import HoldToRun
from groundstation.flight.mission_executive import Course, MissionExecutive
from groundstation.machine import FILE, RecordingConfig, Running, folder_of, is_ours, socket_path
from groundstation.pose import check_stamp_rate
from groundstation.pose.sources import describe_drop, describe_unsteady_clock
from groundstation.settings import Config, FlightConfig
from links.core import CommandLink, LinkError, LinkKind, LinkStatus
from links.io import is_pseudo_terminal, read_key


def examine_trajectory(config: Config) -> FeasibilityReport:
    """The trajectory of ``config``, held against its vehicle, its limits and its floor."""
    return check_feasibility(
        config.trajectory.build(),
        config.vehicle,
        config.limits,
        gravity=config.controller.gravity,
        floor_z_m=config.flight.floor_z_m,
    )


ALIKE = 0.1
"""Lengths of two vectors that differ by less than this share are told as one, which has two directions [-]: of the
trajectory's own tolerance."""


def explain_refusal(config: Config, report: FeasibilityReport) -> str | None:
    """Why the trajectory must not fly, with the time, the limit and what to do; None if it may."""
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


def least_braking_room(fence: Fence, way: Trajectory, lasts_s: float) -> tuple[float, float]:
    """Return what is left of the fence after braking, where it is least [m], and when that is [s]."""
    least_m, at_s = math.inf, 0.0
    for i in range(int(lasts_s / STEP_S) + 2):
        time_s = min(i * STEP_S, lasts_s)
        at = way.at(time_s)
        room_m = fence.braking_room_m(at.position_ned, at.velocity_ned)
        if room_m < least_m:
            least_m, at_s = room_m, time_s
    return least_m, at_s


def explain_fence(config: Config) -> str | None:
    """Why the trajectory does not fit into the fence; None where it does, or there is none."""
    if config.fence is None:
        return None
    trajectory = config.trajectory.build()
    fence = Fence(config.fence, config.flight.floor_z_m)
    room_m, at_s = least_braking_room(fence, trajectory, trajectory.joints_s[-1])
    return None if room_m > 0.0 else notice("trajectory.fence", at_s=at_s, short_m=-room_m)


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

    Every kind of link and of poses answers for itself; one that does not counts as real.
    On loopback there are simulators: whoever routes that to a vehicle must set a fence and a speed limit by himself.
    """
    link, pose = config.link, config.pose
    if link.real is not None and not is_simulated(link):
        return f"link.{link.real}"
    return None if pose.real is None else f"pose.{pose.real}"


def is_simulated(link: LinkKind) -> bool:
    """Whether the operator says that a simulator is behind the port of ``link``, and one can be."""
    return link.simulated and is_pseudo_terminal(link.endpoint)


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
    for name, file in config.link.key_files.items():
        key(file, f"link.{name}")


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
        f"stays within north {_range(report, 0)}, east {_range(report, 1)} m, "
        f"{_heights(config, report)} m above the floor",
        f"{'':24}{'needs':>16}{'at':>12}{'limit':>18}",
        *(_line(demand) for demand in report.demands),
    ]
    why = explain_refusal(config, report) or explain_fence(config)
    return "\n".join([*lines, "PASS" if why is None else f"FAIL: {why}"])


def _heights(config: Config, report: FeasibilityReport) -> str:
    floor_z_m = config.flight.floor_z_m
    return f"{floor_z_m - report.highest_ned[2]:.2f} to {floor_z_m - report.lowest_ned[2]:.2f}"


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
"""Sections that decide how motors start and stop: a test on file is void once one of them has
changed."""
COMMAND = "groundstation props-off CONFIG"


class Proof(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One test that was passed."""

    vehicle: str
    """The vehicle's name."""
    digest: str
    """Hash of the configuration, see :func:`digest`."""
    firmware: str
    """Firmware of the autopilot as it reports it; empty where it reports none."""
    date: str
    """When the test was over (ISO 8601, UTC)."""
    steps: dict[str, str]
    """Each step of the test, and what was seen and measured in it."""


def digest(config: Config) -> str:
    """Hash the sections that start and stop motors, without file names and duration."""
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
    """Make the question that confirms arming: ``--arm``, or the operator at the terminal."""

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


LOOK_S = 1.2
"""Poses are looked at for so long before the first checks [s]."""
STEP_S = 0.05
"""Step at which trajectories are checked against the fence [s]."""
FEW_HZ = 20.0
"""Below this pose rate the check fails [1/s]."""
WARN_RATE = 0.8
"""Below this share of the source's nominal rate the check warns [-]."""
OLD_SHARE = 0.5
"""A pose older than this share of ``flight.coast_s`` fails [-]."""
WARN_AGE_S = 0.08
"""A pose older than this is a warning [s]."""
NOISE_M = 0.005
"""Position noise above this fails, 1σ per axis [m]: the tones move the vehicle by 2 mm, and 4 mm
were flown (`alarms --floors`)."""
WARN_NOISE_M = 0.0025
"""Position noise above this is a warning [m]."""
NOISE_DEG = 0.8
"""Roll and pitch noise above this fails, 1σ [°]: 0.6 was flown (`alarms --floors`)."""
WARN_NOISE_DEG = 0.4
"""Roll and pitch noise above this is a warning [°]."""
MOVED_M = 0.03
"""Largest spread of the positions of a vehicle at rest [m]."""
WANDERED_M = 0.5
"""Largest such spread where the source measures velocities (GPS) [m]."""
TILT_DEG = 15.0
"""Tilt at rest above this fails [°]."""
WARN_TILT_DEG = 6.0
"""Tilt at rest above this is a warning [°]."""
FLOOR_M = 0.1
"""Largest difference between ``flight.floor_z_m`` and the height of the vehicle at rest [m]."""
FLOOR_WANDERS_M = 1.0
"""Largest such difference where the source measures velocities (GPS) [m]."""
WARN_RTT = 0.5
"""A longer round trip than this share of its limit is a warning."""


def grade(name: str, value: float, warn: float, fail: float, says: str) -> Check:
    """The larger ``value`` the worse; anything that is not below ``fail``, NaN too, fails."""
    verdict = Verdict.PASS if value <= warn else Verdict.WARN if value <= fail else Verdict.FAIL
    return Check(name, verdict, says)


def tilt_noise_deg(poses: Sequence[Pose]) -> float:
    """The noise of roll and pitch that ``poses`` of a vehicle at rest show, 1σ of each [°]."""
    axes = [third_column(pose.attitude) for pose in poses]
    steps = [
        math.dist([2.0 * y for y in b], [x + z for x, z in zip(a, c, strict=True)])
        for a, b, c in zip(axes, axes[1:], axes[2:], strict=False)
    ]
    # Of two axes, and a second difference of white noise has six times its variance.
    return math.degrees(math.sqrt(sum(step * step for step in steps) / (12.0 * max(1, len(steps)))))


def explain_drops(source: PoseStatus) -> str:
    """Return the source's advice, or the commonest reason of dropped poses; else empty."""
    dropped = source.dropped
    if source.advice:
        return source.advice
    if not any(dropped.values()):
        return ""
    reason = max(dropped, key=lambda reason: dropped[reason])
    return f"{dropped[reason]} were dropped: {describe_drop(reason)}"


class Checks:
    """The checks of one configuration. Times are on the event loop's clock [s]."""

    def __init__(self, config: Config, others: Others | None = None, proof: Proof | None = None) -> None:
        """Make the checks that need no vehicle, once: they take some tenths of a second.

        ``others`` are vehicles to keep away from; ``proof`` is the test with the propellers off
        that is on file.
        """
        self._config = config
        self._proof, self._real = proof, real(config) is not None
        self._separation = None if others is None else Separation(config.separation, others)
        self._fence = None if config.fence is None else Fence(config.fence, config.flight.floor_z_m)
        self._trajectory = config.trajectory.build()
        asked = examine_trajectory(config)
        self._still = [self._flyable(asked), self._certificate(asked), self._take_off(), *self._simulation()]

    def __call__(
        self,
        standing: StandingPoses,
        noise_m: float,
        link: LinkStatus,
        now_s: float,
        witness: Agreement | None = None,
        *,
        source: PoseStatus | None = None,
    ) -> list[Check]:
        """All checks, as the vehicle stands now; ``noise_m`` is the measured noise of its poses [m].

        ``witness`` is what comes of holding the poses against the autopilot's own attitude; None where it tells none.
        ``source`` is the status of the pose source; None where it is not known.
        """
        poses = list(standing.poses)
        source = PoseStatus(accepted=len(poses), dropped={}) if source is None else source
        if len(poses) < 2:
            why = explain_drops(source) or "check the source"
            nothing = Check("poses", Verdict.FAIL, notice("pose.none", why=why))
            return [nothing, self._arm(link), self._frames(link), *self._still]
        place = standing.place_ned
        return [
            self._rate(poses, source),
            self._age(poses[-1], now_s, source),
            self._deadline(),
            self._props_off(link),
            self._noise(noise_m, tilt_noise_deg(poses)),
            self._rest(poses),
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
            *self._still,
            self._ways(place),
        ]

    def _rate(self, poses: list[Pose], source: PoseStatus) -> Check:
        stamps = check_stamp_rate(source, self._config.pose)
        if stamps is not None:
            return stamps
        rate = (len(poses) - 1) / max(poses[-1].arrival_s - poses[0].arrival_s, 1e-6)
        wanted = self._config.pose.rate_hz
        told = "" if wanted is None else f", pose.rate_hz says {wanted:g}"
        says = f"{rate:.0f} poses a second{told}"
        if rate < FEW_HZ:
            return Check("pose rate", Verdict.FAIL, f"{says}: at least {FEW_HZ:g} are needed")
        few = wanted is not None and rate < WARN_RATE * wanted
        return Check("pose rate", Verdict.WARN if few else Verdict.PASS, says)

    def _age(self, pose: Pose, now_s: float, source: PoseStatus) -> Check:
        if source.unsteady_clock:
            return Check("pose age", Verdict.FAIL, describe_unsteady_clock())
        age, fail = now_s - pose.time_s, OLD_SHARE * self._config.flight.coast_s
        says = f"the newest pose is {1e3 * age:.0f} ms old"
        why = explain_drops(source) if age > fail else ""
        return grade("pose age", age, min(WARN_AGE_S, fail), fail, f"{says}; {why}" if why else says)

    def _props_off(self, link: LinkStatus) -> Check:
        """Whether somebody has seen the motors of this vehicle stop, as it is now."""
        if not self._real or self._config.rehearsal is not None:  # a pseudo-terminal looks as any serial port
            return Check("props-off test", Verdict.OFF, "only a real vehicle needs one")
        why = lacks(self._proof, self._config, link.firmware)
        if why or self._proof is None:
            return Check("props-off test", Verdict.WARN, why)
        return Check("props-off test", Verdict.PASS, f"passed on {self._proof.date}")

    def _deadline(self) -> Check:
        """Check the pose age up to which commands are sent against the defaults."""
        coast_s, level_s = self._config.flight.coast_s, self._config.guards.level_s
        usual_s = FlightConfig().coast_s + GuardsConfig().level_s
        says = (
            f"commands rest on a pose for {1e3 * coast_s:.0f} ms (flight.coast_s), in a descent for "
            f"{1e3 * level_s:.0f} ms more (guards.level_s); then the bring-down"
        )
        if coast_s + level_s <= usual_s + 1e-9:
            return Check("deadline", Verdict.PASS, says)
        says += f". Together they are {1e3 * usual_s:.0f} ms unless told otherwise"
        return Check("deadline", Verdict.WARN, says)

    def _noise(self, noise_m: float, noise_deg: float) -> Check:
        """Check the noise of position and of roll and pitch; the worse by its limits decides."""
        quiet = noise_m <= WARN_NOISE_M and noise_deg <= WARN_NOISE_DEG
        more = (
            "" if quiet else ": calibrate the volume, and have more cameras see the body; with more of it flights end"
        )
        says = f"noise of {1e3 * noise_m:.2f} mm on each axis, {noise_deg:.2f}° of roll and pitch{more}"
        place = grade("pose noise", noise_m, WARN_NOISE_M, NOISE_M, says)
        lie = grade("pose noise", noise_deg, WARN_NOISE_DEG, NOISE_DEG, says)
        return next((one for v in (Verdict.FAIL, Verdict.WARN) for one in (place, lie) if one.verdict is v), place)

    def _rest(self, poses: list[Pose]) -> Check:
        far = max(math.dist(poses[0].position_ned, pose.position_ned) for pose in poses)
        limit = MOVED_M if poses[0].velocity_ned is None else WANDERED_M
        says = f"poses lie within {100.0 * far:.1f} cm" + ("" if far <= limit else ": the vehicle must stand still")
        return grade("at rest", far, limit, limit, says)

    def _tilt(self, pose: Pose) -> Check:
        tilt = angle_deg(third_column(pose.attitude)[2])
        more = "" if tilt <= WARN_TILT_DEG else ": level the floor, or correct the object's axes in the capture system"
        return grade("tilt", tilt, WARN_TILT_DEG, TILT_DEG, f"it stands tilted by {tilt:.1f}°{more}")

    def _witness(self, told: Agreement | None) -> Check:
        """Whether the autopilot lies and turns as the tracker sees it."""
        name, config = "second witness", self._config
        if config.pose.by_autopilot:
            return Check(name, Verdict.OFF, "there is none: the poses are the autopilot's own")
        by_radio = not config.link.has_autopilot
        if told is None and by_radio:
            says = "there is none: this radio does not tell how the vehicle lies, ten times a second, as CRSF's may"
            return Check(name, Verdict.OFF, says)
        if told is None:
            says = "the autopilot does not send its attitude, so nothing holds against poses that lie"
            return Check(name, Verdict.WARN, says)
        cure = "is it the right body? `groundstation carry` finds the axes of its object"
        if told.unlike:
            says = f"moved by hand, {' and '.join(told.unlike)} went another way in the poses than in the autopilot"
            sign = "; or correct link.attitude_pitch" if by_radio and told.unlike == ("pitch",) else ""
            return Check(name, Verdict.FAIL, f"{says}: {cure}{sign}")
        says = f"tilt by the poses and by the autopilot is {told.askew_deg:.1f}° apart"
        if told.askew_deg > ASKEW_DEG:
            return Check(name, Verdict.FAIL, f"{says}: {cure}, level the autopilot's accelerometers")
        if told.doubts_s is not None:
            return Check(name, Verdict.WARN, "poses move otherwise than the autopilot feels: does somebody carry it?")
        alike = f"; {', '.join(told.alike)} went the same way as it was moved" if told.alike else ""
        return Check(name, Verdict.PASS, f"{says}{alike}")

    def _floor(self, pose: Pose, place: Vec3) -> Check:
        if self._config.flight.start == "air":
            return Check("floor", Verdict.OFF, "a simulated vehicle is held in the air (flight.start)")
        off = abs(place[2] - self._config.flight.floor_z_m)
        limit = FLOOR_M if pose.velocity_ned is None else FLOOR_WANDERS_M
        says = f"it stands at {place[2]:+.2f} m (down), flight.floor_z_m says {self._config.flight.floor_z_m:+.2f} m"
        more = "" if off <= limit else ": a wrong one makes a wrong bring-down; correct it"
        return grade("floor", off, limit, limit, says + more)

    def _inside(self, place: Vec3) -> Check:
        if self._fence is None:
            return Check("fence", Verdict.OFF, "there is none")
        room = self._fence.room_m(place)
        if room <= 0.0:
            return Check("fence", Verdict.FAIL, f"it stands {-room:.2f} m outside the fence")
        return Check("fence", Verdict.PASS, f"it stands {room:.2f} m inside the fence")

    def _apart(self, place: Vec3, now_s: float) -> Check:
        """Whether every other vehicle is seen, and far enough away."""
        separation = self._separation
        if separation is None:
            return Check("other vehicles", Verdict.OFF, "separation.others names none")
        config, unknown = separation.config, separation.unknown(now_s)
        near = separation.nearest(place, (0.0, 0.0, 0.0), now_s)
        if near is not None and not near.distance_m >= config.distance_m:
            says = f"it stands {near.distance_m:.2f} m from {near.name}, limit {config.distance_m:g} m"
            return Check("other vehicles", Verdict.FAIL, f"{says}: move one of them")
        if unknown:
            says = f"the cameras do not see {', '.join(unknown)}: uncover them, or take them out of separation.others"
            return Check("other vehicles", Verdict.WARN if config.unknown == "warn" else Verdict.FAIL, says)
        assert near is not None, "all are seen"
        return Check("other vehicles", Verdict.PASS, f"{near.name} is nearest, {near.distance_m:.2f} m away")

    def _ways(self, place: Vec3) -> Check:
        """The climb, the way onto the trajectory, all of it, and the way back, each with its braking distance."""
        if self._fence is None:
            return Check("ways in the fence", Verdict.OFF, "there is no fence")
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
            return Check("ways in the fence", Verdict.FAIL, f"the {where}, could not be braked within the fence")
        return Check("ways in the fence", Verdict.PASS, f"{least:.2f} m are left after braking from the {where}")

    def _battery(self, link: LinkStatus) -> Check:
        volts, share, c = link.battery_v, link.battery_share, self._config.guards
        if share is None and (volts is None or c.battery_v is None):
            why = "the vehicle does not tell" if volts is None else f"{volts:.2f} V; set guards.battery_v to judge it"
            return Check("battery", Verdict.OFF, why)
        told = [f"{volts:.2f} V"] if volts is not None else []
        told += [f"{100.0 * share:.0f} %"] if share is not None else []
        low = (share is not None and share < c.battery_share) or (
            volts is not None and c.battery_v is not None and volts < c.battery_v
        )
        soon = share is not None and share < c.battery_share + 0.2
        verdict = Verdict.FAIL if low else Verdict.WARN if soon else Verdict.PASS
        return Check("battery", verdict, f"it is at {', '.join(told)}" + (": charge it" if low else ""))

    def _round_trip(self, link: LinkStatus) -> Check:
        if link.rtt_s is None:
            return Check("round trip", Verdict.OFF, "the link does not know")
        limit = self._config.guards.rtt_s
        says = f"{1e3 * link.rtt_s:.0f} ms to the vehicle and back, limit {1e3 * limit:.0f} ms"
        return grade("round trip", link.rtt_s, WARN_RTT * limit, limit, says)

    def _arm(self, link: LinkStatus) -> Check:
        if link.state == "armed":
            return Check("ready to arm", Verdict.FAIL, "its motors are on already: somebody else has armed it")
        if link.state != "connected":
            return Check("ready to arm", Verdict.FAIL, f"the link is {link.state}: {link.text}".rstrip(": "))
        said = f"; it said last: “{link.text}”" if link.text else ""
        if link.unfit:
            return Check("ready to arm", Verdict.FAIL, link.unfit)
        if link.ready is False:  # a warning: they may ask for what only its present mode needs, and arming tells
            says = "its own pre-arm checks do not pass, so it may refuse to arm: QGroundControl lists what they lack"
            return Check("ready to arm", Verdict.WARN, says + said)
        return Check("ready to arm", Verdict.PASS, f"connected, and disarmed{said}")

    def _frames(self, link: LinkStatus) -> Check:
        if link.conflict:
            return Check("frames", Verdict.FAIL, link.conflict)
        if link.warning:
            return Check("frames", Verdict.WARN, link.warning)
        if self._config.link.has_autopilot:
            return Check("frames", Verdict.OFF, "commands leave as this program sends them")
        return Check("frames", Verdict.PASS, "the pacer and its stand-by have what they need")

    def _link_drops(self, link: LinkStatus) -> Check:
        name, drops = "link drops", find_link_drops(link)
        if drops:
            return Check(name, Verdict.WARN, "; ".join(drop.says for drop in drops))
        return Check(name, Verdict.PASS, notice("link.few_dropped", total=link.received))

    def _pose_drops(self, source: PoseStatus) -> Check:
        name, found = "pose drops", find_pose_drops(source)
        if found is None:
            return Check(name, Verdict.PASS, notice("pose.few_dropped", total=source.accepted))
        reason, count, total = found
        says = notice("pose.dropped", count=count, total=total, why=describe_drop(reason))
        return Check(name, Verdict.WARN, says)

    def _failsafe(self) -> Check:
        """State that the receiver's failsafe can't be checked from here."""
        if self._config.link.has_autopilot:
            return Check("failsafe", Verdict.OFF, "the autopilot's own: `groundstation doctor CONFIG` looks at it")
        says = (
            "the receiver's failsafe must stop the motors, as nothing here can if the module loses its plug or its "
            "computer; it does not tell, and is sold to hold the last frame: once, with the propellers off, "
            "`groundstation fly CONFIG`, then pull the module's plug; the motors must stop"
        )
        return Check("failsafe", Verdict.WARN, says)

    def _take_off(self) -> Check:
        """Check the thrust limit on the floor, where the poses may not yet be this vehicle's."""
        config, weight = self._config, self._config.weight_n
        most, usual = (limit(config) for limit in (limit_n, usual_limit_n))
        says = f"thrust goes to {most:.3g} N before lift-off, {100.0 * most / weight:.0f} % of the weight"
        if most <= usual:
            return Check("take-off thrust", Verdict.PASS, says)
        more = (
            f"{says}, by takeoff.thrust_limit: with wrong poses or a wrong mass it jumps higher than by {usual:.3g} N"
        )
        return Check("take-off thrust", Verdict.WARN, more)

    def _simulation(self) -> list[Check]:
        """A word that takes guards away must not stay in a configuration unseen."""
        link = self._config.link
        if not link.simulated or self._config.rehearsal is not None:
            return []  # in a rehearsal nobody wrote it
        believed = "no fence and no speed limit are asked for" if is_simulated(link) else "not believed of this port"
        says = f"link.simulated = true: {believed}. Behind {link.endpoint} no module may be; else take it out"
        return [Check("simulated", Verdict.WARN, says)]

    def _certificate(self, asked: FeasibilityReport) -> Check:
        law = self._config.controller
        if not isinstance(law, Law):
            return Check("thrust bound", Verdict.OFF, "this controller comes without a Lyapunov function")
        bound = thrust_bound(law, acceleration_sup=asked.acceleration_m_s2, v_start=0.0).bound
        where = f"{bound:+.2f} m/s² from rest on the reference"
        if bound > 0.0:
            return Check("thrust bound", Verdict.PASS, f"the theory keeps thrust over mass above {where}")
        least = f"vehicle.thrust_min_n = {self._config.vehicle.thrust_min_n:g} N keeps it above zero"
        return Check("thrust bound", Verdict.OFF, f"{least}, as the proof alone does not (its bound: {where})")

    def _flyable(self, asked: FeasibilityReport) -> Check:
        why = explain_refusal(self._config, asked)
        if why is not None:
            return Check("trajectory", Verdict.FAIL, why)
        return Check("trajectory", Verdict.PASS, "within the limits of vehicle and configuration")


def describe_failures(checks: list[Check]) -> str:
    """Join the failed checks into one sentence; empty where none failed."""
    return "; ".join(f"{check.name}: {check.says}" for check in checks if check.verdict is Verdict.FAIL)


def describe_checks(checks: list[Check]) -> str:
    """``checks`` for people."""
    return "\n".join(f"{check.verdict:5}{check.name:20}{check.says}" for check in checks)


SEEN_S = 0.5
"""A body that was not seen for so long may be anywhere [s]."""


class Company:
    """Checks of what is beside one flight. Times are on the event loop's clock [s]."""

    def __init__(
        self, config: Config, bodies: Others | None, running: Callable[[], Sequence[Running]], hold: HoldToRun | None
    ) -> None:
        """``bodies`` are all that the source shows, ``running`` what else flies from here, ``hold`` the operator's."""
        self._config = config
        self._bodies = bodies
        self._running = running
        self._hold = hold

    def __call__(self, standing: StandingPoses, now_s: float, *, arming: bool = False) -> list[Check]:
        """The checks, as things are now; what the operator must hold need not be held before ``arming``."""
        return [self._names(), self._bodies_near(standing, now_s), self._hand(Verdict.FAIL if arming else Verdict.WARN)]

    def leave(self) -> None:
        """Stop looking for other bodies: take-off begins."""
        if self._bodies is not None:
            self._bodies.every = False

    def _names(self) -> Check:
        """Whether another flight of this machine has the same body, commands the same vehicle, or has its name."""
        own, name = entry_of(self._config, "", 0), "other flights"
        bad, odd = list[str](), list[str]()
        for one in self._running():
            who = f"{one.command} {one.vehicle} (process {one.pid})"
            if own.link == one.link:
                bad.append(f"{who} commands {one.link} as well: stop one of them")
            elif own.body and own.body == one.body:
                of = f"{who} follows the body {one.body!r} as well"
                told = odd if own.poses != one.poses else bad
                told.append(f"{of}: two vehicles can't be one body, so one of them would fly by the other's poses")
            elif own.vehicle == one.vehicle:
                odd.append(f"{who} has the same name: whoever arms or lands by name may mean the other")
        verdict = Verdict.FAIL if bad else Verdict.WARN if odd else Verdict.PASS
        return Check(name, verdict, "; ".join(bad + odd) or "none of this machine has its name, body or link")

    def _bodies_near(self, standing: StandingPoses, now_s: float) -> Check:
        """Whether another body is where this vehicle is."""
        name, size = "bodies near", self._config.vehicle.size_m
        if self._bodies is None or not standing.poses:
            return Check(name, Verdict.OFF, "the source shows no other bodies")
        place, near = standing.place_ned, list[tuple[float, str]]()
        for body in self._bodies.bodies:
            sight = self._bodies.sighting(body)
            if sight is not None and now_s - sight.time_s < SEEN_S:
                near.append((math.dist(place, sight.position_ned), body))
        if not near:
            return Check(name, Verdict.PASS, "no other body is seen")
        distance, body = min(near)
        says = f"{body!r} is {distance:.2f} m from {self._config.body!r}"
        if distance >= size:
            return Check(name, Verdict.PASS, f"{says}, the nearest")
        more = f"less than vehicle.size_m ({size:g} m): move it away, or find out which name is whose"
        return Check(name, Verdict.FAIL, f"{says}, {more}")

    def _hand(self, otherwise: Verdict) -> Check:
        """Whether the operator holds what must be held."""
        name, hold = "operator's hold", self._hold
        if hold is None:
            return Check(name, Verdict.OFF, "operator.hold names nothing")
        if hold.obstacle:
            return Check(name, otherwise, f"{hold.obstacle}: {hold.advice}")
        return Check(name, Verdict.PASS, hold.advice)


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
"""Period at which the checks are repeated until the operator arms [s]."""


class FlightEnded(Exception):
    """The flight can't go on; the text says why, for the operator."""


class PrearmSequence:
    """One flight's way from connecting until it may be armed."""

    checks: tuple[Check, ...] = ()
    """The newest, until somebody has armed: for the screens."""

    def __init__(
        self,
        config: Config,
        link: CommandLink,
        source: PoseSource,
        pilot: Pilot,
        progress: MissionExecutive,
        witness: Callable[[], Witness],
        *,
        confirm: Callable[[], Awaitable[bool]],
        others: Others | None,
        say: Say,
        company: Company | None = None,
    ) -> None:
        """``confirm`` asks the operator before the vehicle is armed; ``others`` are vehicles to keep away from.

        ``company`` makes more checks, of what is beside the vehicle.
        """
        self._config = config
        self._link = link
        self._source = source
        self._pilot = pilot
        self._progress = progress
        self._witness = witness
        self._confirm = confirm
        self._others = others
        self._say = say
        self._company = company
        self._look: Checks | None = None
        self._arm_asked = asyncio.Event()
        self.first_pose = asyncio.Event()
        """To be set as a pose comes."""

    def arm(self) -> None:
        """Somebody asks to arm."""
        self._arm_asked.set()

    async def depart(self, deliver: Callable[[Pose], None]) -> None:
        """All of it; where it returns, the vehicle may be armed. ``deliver`` gets the poses from now on.

        Raises:
            Ended: no pose comes, a check fails, or the operator does not confirm.
            LinkError: the link can't be connected.
        """
        loop, progress = asyncio.get_running_loop(), self._progress
        from_floor = self._config.flight.start == "floor"
        if from_floor:
            self._pilot.stand()
        progress.go(Event.START, "waiting for the link and for poses", loop.time())
        await self._connect(deliver)
        if from_floor:
            await self._stand()
            bad, checks = self._check()
            for one in checks:
                if one.verdict in (Verdict.WARN, Verdict.FAIL):
                    self._say(f"pre-flight {one.verdict}: {one.name}: {one.says}", Severity.WARNING)
            if bad:
                raise FlightEnded(f"pre-flight checks failed: {bad}")
        status = self._source.status
        poses = f"poses at {status.rate_hz:.0f} Hz, {1e3 * status.latency_s:.0f} ms late"
        progress.go(Event.CONNECTED, f"link and poses are there; {poses}", loop.time())
        await self._operator()
        if from_floor:
            bad, _ = self._check(arming=True)
            if bad:
                raise FlightEnded(f"not armed: {bad}")
        self.checks = ()
        if self._company is not None:
            self._company.leave()
        self._witness().arm()

    async def check(self, deliver: Callable[[Pose], None]) -> list[Check]:
        """Connect and look, and no more; what can't be connected is a check that fails."""
        try:
            await self._connect(deliver)
            await self._stand()
            return self._check()[1]
        except (FlightEnded, LinkError, OSError) as error:
            conflict = self._link.status.conflict
            found = [Check("connection", Verdict.FAIL, str(error))]
            return [*found, Check("frames", Verdict.FAIL, conflict)] if conflict else found

    async def _stand(self) -> None:
        """Look at the vehicle as it stands for a moment."""
        self._look = Checks(self._config, self._others, on_file(place(self._config)))
        await asyncio.gather(asyncio.sleep(LOOK_S), self._link.examine())

    def _check(self, *, arming: bool = False) -> tuple[str, list[Check]]:
        """Return the failures as a sentence, and all checks; ``arming``: motors start next."""
        assert self._look is not None, "nobody has looked yet"
        now = asyncio.get_running_loop().time()
        evidence = self._witness().verdict(now)
        checks = self._look(
            self._progress.standing, self._pilot.noise_m, self._link.status, now, evidence, source=self._source.status
        )
        if self._company is not None:
            checks += self._company(self._progress.standing, now, arming=arming)
        self.checks = tuple(checks)
        return describe_failures(checks), checks

    async def _connect(self, deliver: Callable[[Pose], None]) -> None:
        await self._source.start(deliver)
        await self._link.connect()
        wait = self._config.flight.pose_wait_s
        try:
            await asyncio.wait_for(self.first_pose.wait(), wait)
        except TimeoutError:
            raise FlightEnded(f"no pose within {wait:g} s: {self._why_no_pose()}") from None

    def _why_no_pose(self) -> str:
        pose = self._config.pose
        if pose.by_autopilot:
            said = f"; it said last: “{self._link.status.text}”" if self._link.status.text else ""
            return (
                "the autopilot is heard but has no estimate of its position yet (pose.kind = mavlink). After a start "
                f"that takes it some 40 s, and it needs GPS or an external pose: wait for it, then try again{said}"
            )
        told = {pose.address_key: pose.address, pose.body_key: pose.body_name}
        keys = ", ".join(f"pose.{key} = {value}" for key, value in told.items() if key)
        hint = explain_drops(self._source.status) or "nothing arrived at all; check address and port"
        return f"nothing of use from pose.kind = {pose.kind} ({keys}); {hint}"

    async def _operator(self) -> None:
        """Wait until somebody asks to arm: at the terminal, or by a request."""
        confirmed, asked = asyncio.ensure_future(self._confirm()), asyncio.ensure_future(self._arm_asked.wait())
        try:
            while not (confirmed.done() or asked.done()):
                if self._look is not None:
                    self._check()  # for the screens: whoever arms sees the vehicle as it stands now
                await asyncio.wait({confirmed, asked}, timeout=LOOK_AGAIN_S, return_when=asyncio.FIRST_COMPLETED)
            if not asked.done() and not confirmed.result():
                raise FlightEnded("not armed: the operator did not confirm")
        finally:
            for task in (confirmed, asked):
                task.cancel()
            await asyncio.gather(confirmed, asked, return_exceptions=True)
