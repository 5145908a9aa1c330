"""Checks before arming: of the vehicle at rest, and of its surroundings.

Each is OFF, PASS, WARN or FAIL, with a sentence.
"""

import math
from collections.abc import Callable, Iterable, Sequence

from groundstation.core.control import Law, thrust_bound
from groundstation.core.geometry import FARTHEST_M, Vec3, angle_deg, third_column
from groundstation.core.health import MOUNTING_DEG, Agreement
from groundstation.core.messages import (
    ROUNDING_S,
    SIGHTING_S,
    USUAL_POSE_DROPS,
    Check,
    Others,
    Pose,
    PoseStatus,
    Sentence,
    Verdict,
    find_link_drops,
    find_pose_drops,
    notice,
    notice_fact,
)
from groundstation.core.mission import HoldToRun
from groundstation.core.safety import (
    Fence,
    GuardsConfig,
    Separation,
    StandingPoses,
    limit_n,
    usual_limit_n,
)
from groundstation.core.trajectory import FeasibilityReport, Reference, Trajectory
from groundstation.flight.controller import Course
from groundstation.flight.preflight.configuration import (
    examine_trajectory,
    explain_refusal,
    find_braking_room,
    find_real_key,
    is_simulated,
)
from groundstation.flight.preflight.proof import Proof, explain_missing_proof
from groundstation.machine import Running, socket_path
from groundstation.pose import check_stamp_rate
from groundstation.pose.sources import describe_drop, describe_origin_moves, describe_unsteady_clock
from groundstation.settings import Config, FlightConfig
from links.core import LinkStatus
from links.text import to_cm, to_mm, to_ms, to_percent

# Limits of the checks. Those without a named origin were chosen.
FEW_HZ = 20.0
"""Pose rate below which the check fails [1/s]."""
WARN_RATE = 0.8
"""Share of the source's nominal rate below which the check warns [-]."""
OLD_SHARE = 0.5
"""Pose age above which the check fails, as a share of ``flight.coast_s`` [-]."""
NOISE_M = 0.005
"""Position noise above this fails, 1σ per axis [m]: the excitation tones move the vehicle by 2 mm,
and 4 mm of noise were flown (`groundstation-sim dev alarms --floors`)."""
NOISE_DEG = 0.8
"""Roll and pitch noise above this fails, 1σ [°]: 0.6 was flown
(`groundstation-sim dev alarms --floors`)."""
MOVED_M = 0.03
"""Largest spread of the positions of a vehicle at rest [m]."""
WANDERED_M = 0.5
"""Largest such spread if the poses have a velocity [m]: an autopilot's own estimate wanders, by
GPS."""
TILT_DEG = 15.0
"""Tilt at rest above this fails [°]."""
FLOOR_M = 0.1
"""Largest difference between ``flight.floor_z_m`` and the height of the vehicle at rest [m]."""
FLOOR_WANDERS_M = 1.0
"""Largest such difference if the poses have a velocity [m]."""
WARN_SHARE = 0.5
"""Share of the limit of age, noise, tilt and round trip above which their checks warn [-]."""
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
    # The second difference of white noise has 1 + 4 + 1 = 6 times its variance; two axes make it
    # 12.
    squares = sum(one * one for one in second_differences)
    return math.degrees(math.sqrt(squares / (12.0 * max(1, len(second_differences)))))


def explain_drops(source: PoseStatus) -> Sentence | None:
    """Return the source's advice, or else the most frequent reason of dropped poses.

    None without either.
    """
    dropped = source.dropped
    if source.advice:
        return notice("pose.advice", says=source.advice)
    if not any(dropped.values()):
        return None
    losses = {
        reason: count
        for reason, count in dropped.items()
        if count and reason not in USUAL_POSE_DROPS
    }
    most = losses or dropped
    reason = max(most, key=lambda reason: most[reason])
    return notice(
        "pose.most_dropped", count=dropped[reason], why=describe_drop(reason, source.excesses)
    )


class Checks:
    """The checks of one configuration. Times are on the event loop's clock [s]."""

    def __init__(
        self, config: Config, others: Others | None = None, proof: Proof | None = None
    ) -> None:
        """Make the checks that need no vehicle, once: they take some tenths of a second.

        ``others`` are vehicles to keep away from; ``proof`` is the kept test with the propellers
        off.
        """
        self._config = config
        self._proof, self._real = proof, find_real_key(config) is not None
        self._separation = None if others is None else Separation(config.separation, others)
        self._fence = None if config.fence is None else Fence(config.fence, config.flight.floor_z_m)
        self._trajectory = config.trajectory.build()
        demands = examine_trajectory(config)
        self._fixed = [
            self._flyable(demands), self._certificate(demands), self._thrust_limit(),
            *self._simulation(),
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
            witness: comparison of the poses with the autopilot's own attitude; None if it sends
                none.
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
                "pose rate",
                Verdict.FAIL,
                "check.pose_rate_low",
                rate_hz=rate,
                nominal=nominal,
                limit_hz=FEW_HZ,
            )
        verdict = Verdict.WARN if wanted is not None and rate < WARN_RATE * wanted else Verdict.PASS
        return report("pose rate", verdict, "check.pose_rate", rate_hz=rate, nominal=nominal)

    def _age(self, pose: Pose, now_s: float, source: PoseStatus) -> Check:
        if source.unsteady_clock:
            return Check.of("pose age", Verdict.FAIL, describe_unsteady_clock())
        age, fail = now_s - pose.time_s, OLD_SHARE * self._config.flight.coast_s
        verdict = find_verdict(age, WARN_SHARE * fail, fail)
        if verdict is Verdict.FAIL and (why := explain_drops(source)):
            return report("pose age", verdict, "check.pose_age_why", age_ms=to_ms(age), why=why)
        return report("pose age", verdict, "check.pose_age", age_ms=to_ms(age))

    def _props_off(self, link: LinkStatus) -> Check:
        """Check that the test with the propellers off was passed with the present configuration."""
        # A rehearsal's pseudo-terminal looks like any port.
        if not self._real or self._config.rehearsal is not None:
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
        values = {"coast_ms": to_ms(coast_s), "level_ms": to_ms(level_s)}
        if coast_s + level_s <= usual_s + ROUNDING_S:
            return report("deadline", Verdict.PASS, "check.deadline", **values)
        return report(
            "deadline", Verdict.WARN, "check.deadline_long", usual_ms=to_ms(usual_s), **values
        )

    def _noise(self, noise_m: float, noise_deg: float) -> Check:
        """Check the noise of position and of roll and pitch; the worse by its limit decides."""
        verdict = find_verdict(max(noise_m / NOISE_M, noise_deg / NOISE_DEG), WARN_SHARE, 1.0)
        return report(
            "pose noise", verdict, "check.pose_noise", noise_mm=to_mm(noise_m), noise_deg=noise_deg
        )

    def _rest(self, poses: list[Pose], source: PoseStatus) -> Check:
        if source.origin_moves > 1:
            many = source.origin_moves > self._config.guards.pose_resets
            verdict = Verdict.FAIL if many else Verdict.WARN
            return Check.of("at rest", verdict, describe_origin_moves(source.origin_moves))
        away = max(map(abs, poses[-1].position_ned))
        if away > FARTHEST_M and not self._config.pose.by_autopilot:
            return report("at rest", Verdict.FAIL, "check.far", away_m=away, limit_m=FARTHEST_M)
        far = max(math.dist(poses[0].position_ned, pose.position_ned) for pose in poses)
        limit = MOVED_M if poses[0].velocity_ned is None else WANDERED_M
        return report(
            "at rest", find_verdict(far, limit, limit), "check.at_rest", spread_cm=to_cm(far)
        )

    def _tilt(self, pose: Pose) -> Check:
        tilt = angle_deg(third_column(pose.attitude)[2])
        return report(
            "tilt", find_verdict(tilt, WARN_SHARE * TILT_DEG, TILT_DEG), "check.tilt", tilt_deg=tilt
        )

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
            sign = (
                "; or correct link.attitude_pitch"
                if by_radio and found.unlike == ("pitch",)
                else ""
            )
            return report(
                name,
                Verdict.FAIL,
                "check.witness_unlike",
                axes=" and ".join(found.unlike),
                sign=sign,
            )
        if found.mounting_deg > MOUNTING_DEG:
            return report(name, Verdict.FAIL, "check.witness_askew", askew_deg=found.mounting_deg)
        if found.disagrees_since_s is not None:
            return report(name, Verdict.WARN, "check.witness_carried")
        alike = (
            f"; {', '.join(found.alike)} went the same way as it was moved" if found.alike else ""
        )
        return report(
            name, Verdict.PASS, "check.witness", askew_deg=found.mounting_deg, alike=alike
        )

    def _floor(self, pose: Pose, place: Vec3) -> Check:
        if self._config.flight.start == "air":
            return report("floor", Verdict.OFF, "check.floor_air")
        off = abs(place[2] - self._config.flight.floor_z_m)
        limit = FLOOR_M if pose.velocity_ned is None else FLOOR_WANDERS_M
        floor_m = self._config.flight.floor_z_m
        return report(
            "floor",
            find_verdict(off, limit, limit),
            "check.floor",
            down_m=place[2],
            floor_m=floor_m,
        )

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
            values = {
                "distance_m": near.distance_m,
                "name": near.name,
                "limit_m": config.distance_m,
            }
            return report(name, Verdict.FAIL, "check.others_near", **values)
        if unknown:
            verdict = Verdict.WARN if config.unknown == "warn" else Verdict.FAIL
            return report(name, verdict, "check.others_unseen", names=", ".join(unknown))
        assert near is not None, "all are seen"
        return report(
            name, Verdict.PASS, "check.others", name=near.name, distance_m=near.distance_m
        )

    def _ways(self, place: Vec3) -> Check:
        """Check the hold after take-off, the ways onto the trajectory and the trajectory against
        the fence.

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
            room, at_s = find_braking_room(self._fence, way, lasts_s)
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
        charge += [f"{to_percent(share):.0f} %"] if share is not None else []
        low = (share is not None and share < c.battery_share) or (
            volts is not None and c.battery_v is not None and volts < c.battery_v
        )
        soon = share is not None and share < c.battery_share + BATTERY_MARGIN
        verdict = Verdict.FAIL if low else Verdict.WARN if soon else Verdict.PASS
        return report(
            "battery",
            verdict,
            "check.battery_low" if low else "check.battery",
            charge=", ".join(charge),
        )

    def _round_trip(self, link: LinkStatus) -> Check:
        if link.rtt_s is None:
            return report("round trip", Verdict.OFF, "check.rtt_unknown")
        limit = self._config.guards.rtt_s
        verdict = find_verdict(link.rtt_s, WARN_SHARE * limit, limit)
        return report(
            "round trip", verdict, "check.rtt", rtt_ms=to_ms(link.rtt_s), limit_ms=to_ms(limit)
        )

    def _arm(self, link: LinkStatus) -> Check:
        name, said = "ready to arm", f"; it said last: “{link.text}”" if link.text else ""
        if link.state == "armed":
            return report(name, Verdict.FAIL, "check.armed_already")
        if link.state != "connected":
            id = "check.link_state_why" if link.text else "check.link_state"
            return report(name, Verdict.FAIL, id, state=link.state, text=link.text)
        if link.unfit:
            return report(name, Verdict.FAIL, "check.unfit", why=link.unfit)
        # Only a warning: the autopilot's own checks may concern its present mode alone, and arming
        # will show.
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
            return report(
                name,
                Verdict.WARN,
                "check.link_drops",
                drops="; ".join(drop.says.text for drop in drops),
            )
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
        limit = limit_n(self._config.takeoff, vehicle, weight_n)
        usual = usual_limit_n(vehicle, weight_n)
        values = {"thrust_n": limit, "percent": to_percent(limit / self._config.weight_n)}
        if limit <= usual:
            return report("take-off thrust", Verdict.PASS, "check.thrust_limit", **values)
        return report(
            "take-off thrust", Verdict.WARN, "check.thrust_limit_high", usual_n=usual, **values
        )

    def _simulation(self) -> list[Check]:
        """Warn of ``link.simulated``, which drops the demand for a fence: it must not stay in a
        file unnoticed.
        """
        link = self._config.link
        if not link.simulated or self._config.rehearsal is not None:
            return []  # a rehearsal sets the key itself
        believed = (
            "no fence and no speed limit are asked for"
            if is_simulated(link)
            else "not believed of this port"
        )
        return [
            report(
                "simulated",
                Verdict.WARN,
                "check.simulated",
                believed=believed,
                endpoint=link.endpoint,
            )
        ]

    def _certificate(self, demands: FeasibilityReport) -> Check:
        """Check the a-priori bound on thrust (docs/explanation/law.md, section 4)."""
        law = self._config.controller
        if not isinstance(law, Law):
            return report("thrust bound", Verdict.OFF, "check.bound_no_law")
        bound = thrust_bound(law, acceleration_sup=demands.acceleration_m_s2, v_start=0.0)
        if bound > 0.0:
            return report("thrust bound", Verdict.PASS, "check.bound", bound_m_s2=bound)
        least_n = self._config.vehicle.thrust_min_n
        return report(
            "thrust bound",
            Verdict.OFF,
            "check.bound_by_limit",
            thrust_min_n=least_n,
            bound_m_s2=bound,
        )

    def _flyable(self, demands: FeasibilityReport) -> Check:
        """Check that the vehicle can follow the trajectory."""
        why = explain_refusal(self._config, demands)
        if why is not None:
            return Check.of("trajectory", Verdict.FAIL, why)
        return report("trajectory", Verdict.PASS, "check.trajectory")


def describe_failures(checks: Iterable[Check]) -> str:
    """Join the failed checks into one sentence; empty if none failed."""
    return "; ".join(
        f"{check.name}: {check.says}" for check in checks if check.verdict is Verdict.FAIL
    )


def describe_checks(checks: list[Check]) -> str:
    """Describe ``checks`` as text, one on a line."""
    return "\n".join(f"{check.verdict:5}{check.name:20}{check.says}" for check in checks)


class SurroundingsChecks:
    """Checks of the surroundings of one flight. Times are on the event loop's clock [s]."""

    def __init__(
        self,
        config: Config,
        bodies: Others | None,
        running: Callable[[], Sequence[Running]],
        hold: HoldToRun | None,
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

    def __call__(
        self, standing: StandingPoses, now_s: float, *, arming: bool = False
    ) -> list[Check]:
        """Make the checks; the operator's hold fails only with ``arming``, and before that it
        warns.
        """
        return [
            self._names(),
            self._bodies_near(standing, now_s),
            self._hand(Verdict.FAIL if arming else Verdict.WARN),
        ]

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
        return report(
            name, Verdict.FAIL if failures else Verdict.WARN, "check.flights_clash", clashes=clashes
        )

    def _bodies_near(self, standing: StandingPoses, now_s: float) -> Check:
        """Check that no other body is within the vehicle's size."""
        name, size = "bodies near", self._config.vehicle.size_m
        if self._bodies is None or not standing.poses:
            return report(name, Verdict.OFF, "check.bodies_unknown")
        place, near = standing.place_ned, list[tuple[float, str]]()
        for body in self._bodies.bodies:
            sight = self._bodies.sighting(body)
            if sight is not None and now_s - sight.time_s < SIGHTING_S:
                near.append((math.dist(place, sight.position_ned), body))
        if not near:
            return report(name, Verdict.PASS, "check.bodies_none")
        distance, body = min(near)
        values = {"body": body, "distance_m": distance, "own": self._config.body}
        if distance >= size:
            return report(name, Verdict.PASS, "check.bodies", **values)
        return report(name, Verdict.FAIL, "check.bodies_near", size_m=size, **values)

    def _hand(self, otherwise: Verdict) -> Check:
        """Check that the operator holds the control that must be held.

        Without it the verdict is ``otherwise``.
        """
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
