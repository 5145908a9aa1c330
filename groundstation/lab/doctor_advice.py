"""Parameter advice: what a parameter of an autopilot should be, and why, in plain words. Pure.

An :class:`Advice` is a row of the tables below; a :class:`ParameterFinding` is what came of it. Names and meanings are
those of PX4's parameter reference, v1.14 to main of 2026, and of ArduPilot Copter's, 4.2 to master of 2026.
"""

from collections.abc import Callable, Iterable, Mapping
from enum import StrEnum
from typing import NamedTuple

import msgspec

from links.mavlink.protocol import MULTIROTORS, AutopilotParameter

HOVER_SHARE = 0.2
"""How far the hover thrust may be from ours, as a share of it."""


class Weight(StrEnum):
    """How much hangs on a parameter."""

    MUST = "must"
    """With any other value it does not fly, or not safely."""
    SHOULD = "should"
    """Another value is a risk."""
    NOTE = "note"
    """Right or wrong depends on the lab: to be read, not to be fixed."""


class Rule(NamedTuple):
    """Which values are accepted."""

    words: str
    """In words, for the operator."""
    accepts: Callable[[float], bool]
    """True for an accepted value."""
    better: Callable[[float], float]
    """The recommended value, from the one that is there."""


class Advice(NamedTuple):
    """About one parameter."""

    names: tuple[str, ...]
    """Its name, and what other versions of the firmware call it."""
    weight: Weight
    rule: Rule
    why: str
    reboot: bool = False
    """True where a new value counts only after the autopilot was restarted."""


class VehicleFacts(NamedTuple):
    """What the tables must know of our own configuration."""

    own_system: int
    """Our MAVLink system."""
    target_system: int
    """The vehicle's MAVLink system."""
    hover: float
    """Signal 0..1 that carries the vehicle, as we believe: weight over full thrust, through the thrust curve."""
    own_curve: bool
    """True where the link straightens the motors' curve itself (link.thrust_curve, or the vehicle's)."""


class ParameterFinding(msgspec.Struct, frozen=True):
    """One parameter on one vehicle."""

    name: str
    verdict: str
    """``ok``, ``must``, ``should``, ``note``, or ``absent`` where the autopilot does not have it."""
    value: float | None
    accepted: str
    recommended: float | None
    """What --fix would set; None where nothing is wrong or absent."""
    why: str
    reboot: bool


def one_of(values: Mapping[float, str], better: float) -> Rule:
    """Any of ``values`` (value → what it means)."""
    words = ", ".join(f"{value:g} ({meaning})" for value, meaning in values.items())
    return Rule(words, lambda v: v in values, lambda _: better)


def exactly(value: float) -> Rule:
    """This value only."""
    return Rule(f"{value:g}", lambda v: v == value, lambda _: value)


def between(low: float, high: float, better: float) -> Rule:
    """Anything in a range."""
    slack = 1e-6 * max(abs(low), abs(high))  # parameters are 32-bit floats
    return Rule(f"{low:g} to {high:g}", lambda v: low - slack <= v <= high + slack, lambda _: better)


def near(value: float, share: float) -> Rule:
    """Within ``share`` of ``value``."""
    low, high = (1.0 - share) * value, (1.0 + share) * value
    return Rule(f"{low:.2f} to {high:.2f}", lambda v: low <= v <= high, lambda _: round(value, 3))


def with_bit(bit: int, meaning: str) -> Rule:
    """Bit number ``bit`` set, the others as they are."""
    mask = 1 << bit
    return Rule(f"bit {bit} ({mask}) set: {meaning}", lambda v: bool(int(v) & mask), lambda v: float(int(v) | mask))


def without_bit(bit: int, meaning: str) -> Rule:
    """Bit number ``bit`` not set, the others as they are."""
    mask = 1 << bit
    return Rule(f"bit {bit} ({mask}) not set: {meaning}", lambda v: not int(v) & mask, lambda v: float(int(v) & ~mask))


def judge(advice: Advice, found: Mapping[str, AutopilotParameter]) -> ParameterFinding:
    """What ``advice`` says of the parameters that were ``found``."""
    for name in advice.names:
        if name in found:
            value = found[name].value
            fine = advice.rule.accepts(value)
            verdict = "ok" if fine and advice.weight is not Weight.NOTE else str(advice.weight)
            recommended = None if fine or advice.weight is Weight.NOTE else advice.rule.better(value)
            return ParameterFinding(name, verdict, value, advice.rule.words, recommended, advice.why, advice.reboot)
    return ParameterFinding(advice.names[0], "absent", None, advice.rule.words, None, advice.why, advice.reboot)


def is_wrong(findings: Iterable[ParameterFinding]) -> bool:
    """True where something must or should be changed."""
    return any(finding.verdict in (Weight.MUST, Weight.SHOULD) for finding in findings)


def px4_advice(facts: VehicleFacts) -> list[Advice]:
    """The advice for a vehicle of which we believe ``facts``."""
    curve = (
        "Curve of the motors: thrust = f u² + (1 - f) u. With f measured here, link.thrust_curve is 0; "
        "only one of the two may straighten the curve."
    )
    return [
        Advice(
            ("MAV_SYS_ID",),
            Weight.MUST,
            exactly(facts.target_system),
            "The vehicle's MAVLink system: what link.target_system says, and on a network no two the same.",
            reboot=True,
        ),
        Advice(
            ("MAV_TYPE",),
            Weight.MUST,
            one_of({float(number): name for number, name in MULTIROTORS.items()}, 2.0),
            "PX4 takes our thrust as lift only where it knows that the vehicle is a multirotor; generic gives none.",
            reboot=True,
        ),
        Advice(
            ("MAV_FWDEXTSP",),
            Weight.MUST,
            exactly(1.0),
            "With 0, PX4 takes our commands from the wire and gives them to nobody.",
        ),
        Advice(
            ("COM_OF_LOSS_T",),
            Weight.SHOULD,
            between(0.2, 0.5, 0.4),
            "When commands stop, PX4 holds the last one for this long [s], blind. We fall silent on purpose after a "
            "bring-down, so this must be short: with 1 s, as delivered, one that leans may meet the floor at 1.3 m/s. "
            "Below 0.2 s a hiccup of the network already counts.",
        ),
        Advice(
            ("COM_OBL_RC_ACT",),
            Weight.SHOULD,
            one_of({4.0: "land", 6.0: "terminate", 7.0: "disarm"}, 4.0),
            "What PX4 does after that time. Land comes down where it is. Position, altitude and hold (0, 1, 5) leave "
            "it in the air, return (3) flies through the lab.",
        ),
        Advice(
            ("COM_RCL_EXCEPT",),
            Weight.NOTE,
            between(0.0, 31.0, 4.0),
            "Modes in which a lost remote control does not matter. Bit 2 (4) is OFFBOARD: set it only where nobody "
            "holds a remote control, or else a transmitter that fails is not noticed.",
        ),
        Advice(
            ("COM_RC_OVERRIDE",),
            Weight.NOTE,
            between(0.0, 7.0, 3.0),
            "Moving the sticks takes over: bit 0 (1) from automatic modes, bit 1 (2) from OFFBOARD. With bit 1 the "
            "pilot takes over at once; without it he needs the mode switch or the kill switch.",
        ),
        Advice(
            ("COM_RC_IN_MODE",),
            Weight.NOTE,
            between(0.0, 8.0, 0.0),
            "Where sticks come from; 4 is nowhere at all. A lab wants a remote control with a kill switch.",
        ),
        Advice(
            ("COM_DISARM_PRFLT",),
            Weight.NOTE,
            between(-1.0, 60.0, 10.0),
            "An armed vehicle that does not take off within this time [s] disarms itself; 0 or less: it never does.",
        ),
        Advice(
            ("THR_MDL_FAC",),
            Weight.MUST if facts.own_curve else Weight.NOTE,
            exactly(0.0) if facts.own_curve else between(0.0, 1.0, 0.0),
            curve,
        ),
        Advice(
            ("MPC_THR_HOVER",),
            Weight.SHOULD,
            near(facts.hover, HOVER_SHARE),
            "PX4's own idea of the thrust that carries the vehicle, for its landing. Ours is vehicle.hover_thrust, or "
            "vehicle.mass_kg × 9.81 / vehicle.thrust_max_n through the thrust curve: if they differ, one is wrong.",
        ),
        Advice(
            ("EKF2_EV_CTRL",),
            Weight.NOTE,
            between(0.0, 15.0, 15.0),
            "What PX4's estimator takes from an external pose: bit 0 horizontal position, 1 height, 2 velocity, 3 yaw. "
            "Only where something sends it one.",
        ),
        Advice(
            ("EKF2_HGT_REF",),
            Weight.NOTE,
            between(0.0, 3.0, 3.0),
            "Where height comes from: 0 barometer, 1 GPS, 2 range finder, 3 vision. Indoors with an external pose: 3.",
            reboot=True,
        ),
        Advice(
            ("EKF2_EV_DELAY",),
            Weight.NOTE,
            between(0.0, 300.0, 0.0),
            "Age of the external pose when it arrives [ms]; wrong by 50 ms, fast flight is estimated wrongly.",
            reboot=True,
        ),
    ]


def ardupilot_advice(facts: VehicleFacts) -> list[Advice]:
    """The advice for a vehicle of which we believe ``facts``."""
    curve = (
        "Curve of the motors: thrust = f u² + (1 - f) u, about 0.5 to 0.7. With f set here, link.thrust_curve is 0; "
        "only one of the two may straighten the curve."
    )
    source = "Where EKF3 takes {} from: {}."
    places = "3 GPS, 6 external navigation, where something sends it a pose"
    return [
        Advice(
            ("GUID_OPTIONS",),
            Weight.MUST,
            with_bit(3, "thrust means thrust"),
            "Without this bit ArduPilot takes our thrust as a climb rate: half is hovering, full is its fastest climb.",
        ),
        Advice(
            ("ATC_ANGLE_BOOST",),
            Weight.MUST,
            exactly(0.0),
            "With 1, ArduPilot raises our thrust whenever the vehicle leans; the controller has done so already.",
        ),
        Advice(
            ("SYSID_THISMAV", "MAV_SYSID"),
            Weight.MUST,
            exactly(facts.target_system),
            "The vehicle's MAVLink system: what link.target_system says, and on a network no two the same.",
            reboot=True,
        ),
        Advice(
            ("FRAME_CLASS",),
            Weight.MUST,
            one_of({1.0: "quad", 2.0: "hexa", 3.0: "octa", 4.0: "octaquad", 5.0: "Y6", 7.0: "tri"}, 1.0),
            "The vehicle's rotors; 0 is undefined, and then it does not arm.",
            reboot=True,
        ),
        Advice(
            ("GUID_TIMEOUT",),
            Weight.SHOULD,
            between(0.2, 1.0, 0.5),
            "When commands stop, ArduPilot holds the last one for this long [s], blind, then levels out and keeps its "
            "height. We fall silent on purpose after a bring-down, so this must be short.",
        ),
        Advice(
            ("SYSID_MYGCS", "MAV_GCS_SYSID"),
            Weight.SHOULD,
            exactly(facts.own_system),
            "The ground station whose heartbeat FS_GCS_ENABLE watches: us, link.system_id.",
        ),
        Advice(
            ("FS_GCS_ENABLE",),
            Weight.SHOULD,
            one_of({5.0: "land", 7.0: "brake, or land"}, 5.0),
            "What it does when the heartbeat of the ground station stops. 0: nothing, it stays in the air where it "
            "last levelled out. 1 and 3 return through the lab.",
        ),
        Advice(
            ("FS_GCS_TIMEOUT",),
            Weight.SHOULD,
            between(2.0, 3.0, 2.0),
            "How long our heartbeat, which comes once a second, may be missing before that [s]. A program that was "
            "killed in flight is noticed by this alone: with 5 s, as delivered, a vehicle at 1 m/s came down 3 m away. "
            "Below 2 s a single lost heartbeat may count.",
        ),
        Advice(
            ("FS_THR_ENABLE",),
            Weight.NOTE,
            between(0.0, 7.0, 3.0),
            "What it does when the remote control is lost: 0 nothing (only where there is none), 3 lands.",
        ),
        Advice(
            ("RC_OPTIONS",),
            Weight.SHOULD,
            without_bit(0, "the receiver counts"),
            "With bit 0 set it ignores the receiver, and the pilot's switches with it: nobody can take over by hand.",
        ),
        Advice(
            ("MOT_THST_EXPO",),
            Weight.MUST if facts.own_curve else Weight.NOTE,
            exactly(0.0) if facts.own_curve else between(0.0, 1.0, 0.65),
            curve,
        ),
        Advice(
            ("MOT_SPIN_MIN",),
            Weight.SHOULD,
            between(0.03, 0.3, 0.15),
            "The slowest that rotors turn in flight: our thrust 0 is this, so that no motor stops in the air. Too "
            "high, and it does not come down.",
        ),
        Advice(
            ("MOT_THST_HOVER",),
            Weight.SHOULD,
            near(facts.hover, HOVER_SHARE),
            "ArduPilot's own idea of the thrust that carries the vehicle; it learns it in flight (MOT_HOVER_LEARN). "
            "Ours is vehicle.hover_thrust, or else vehicle.mass_kg × 9.81 / vehicle.thrust_max_n through the thrust "
            "curve: if they differ, one is wrong.",
        ),
        Advice(
            ("DISARM_DELAY",),
            Weight.NOTE,
            between(0.0, 127.0, 10.0),
            "An armed vehicle that stands on the ground for this long [s] disarms itself; 0: it never does.",
        ),
        Advice(
            ("VISO_TYPE",),
            Weight.NOTE,
            between(0.0, 3.0, 0.0),
            "Whether it takes an external pose at all: 0 no, 1 over MAVLink.",
            reboot=True,
        ),
        *(
            Advice((f"EK3_SRC1_{name}",), Weight.NOTE, between(0.0, 8.0, 0.0), source.format(what, values))
            for name, what, values in (
                ("POSXY", "horizontal position", places),
                ("POSZ", "height", f"1 barometer, 2 range finder, {places}"),
                ("VELXY", "horizontal velocity", f"{places}, 5 optical flow"),
                ("VELZ", "vertical velocity", places),
                ("YAW", "heading", "1 compass, 6 external navigation, 8 GSF"),
            )
        ),
    ]
