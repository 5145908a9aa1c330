"""Parameter advice: what a parameter of an autopilot, or a setting of Betaflight, should be, and
why. Pure.

An :class:`Advice` is a row of the tables below; a :class:`ParameterFinding` is what came of it.
Names and meanings are those of PX4's parameter reference, v1.14 to main of 2026, of ArduPilot
Copter's, 4.2 to master of 2026, and of Betaflight 4.6, src/main/cli/settings.c.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from enum import StrEnum
from functools import partial
from typing import NamedTuple, TypeAlias

import msgspec

from links.mavlink.protocol import MULTIROTORS
from links.rf import BoardMode

Value: TypeAlias = float | str
"""A number, or a word of Betaflight's."""


class Setting(NamedTuple):
    """One parameter with its value."""

    name: str
    value: Value
    kind: int = 0
    """MAV_PARAM_TYPE, where there is one."""


def show(value: Value) -> str:
    """For people."""
    return value if isinstance(value, str) else f"{value:g}"


HOVER_SHARE = 0.2
"""Largest difference of the hover thrust from ours, as a share of it [-]."""


class Weight(StrEnum):
    """Weight of a parameter."""

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
    accepts: Callable[[Value], bool]
    """True for an accepted value."""
    better: Callable[[Value], Value]
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
    only: tuple[str, Value] | None = None
    """Another parameter and its value with which alone this one matters."""

    def only_if(self, name: str, value: Value) -> "Advice":
        """Return this advice for a parameter ``name`` of this ``value`` only."""
        return self._replace(only=(name, value))

    def is_idle(self, found: Mapping[str, Setting]) -> bool:
        """Whether it does not matter, by the parameters that were ``found``."""
        return self.only is not None and (
            self.only[0] not in found or found[self.only[0]].value != self.only[1]
        )


class VehicleFacts(NamedTuple):
    """Facts of our own configuration for the tables."""

    own_system: int
    """Our MAVLink system."""
    target_system: int
    """The vehicle's MAVLink system."""
    hover: float
    """Signal 0..1 that carries the vehicle, as we believe: weight over full thrust, through the
    thrust curve."""
    own_curve: bool
    """True where the link straightens the motors' curve itself, by its key or the vehicle's."""
    forwards: bool = False
    """True where our poses are forwarded to its own estimator (link.forward)."""
    pose_latency_s: float | None = None
    """Configured age of a pose on arrival [s]; None where the source tells it."""


class ParameterFinding(msgspec.Struct, frozen=True):
    """One parameter on one vehicle."""

    name: str
    verdict: str
    """``ok``, ``must``, ``should``, ``note``, or ``absent`` where the autopilot lacks it."""
    value: Value | None
    accepted: str
    recommended: Value | None
    """The value that --fix would set; None where nothing is wrong or absent."""
    why: str
    reboot: bool


def one_of(values: Mapping[float, str], better: float) -> Rule:
    """Any of ``values`` (value → what it means)."""
    words = ", ".join(f"{value:g} ({meaning})" for value, meaning in values.items())
    return Rule(words, lambda v: v in values, lambda _: better)


def exactly(value: Value) -> Rule:
    """This value only."""
    return Rule(show(value), lambda v: v == value, lambda _: value)


def between(low: float, high: float, better: float) -> Rule:
    """Anything in a range."""
    slack = 1e-6 * max(abs(low), abs(high))  # parameters are 32-bit floats
    return Rule(
        f"{low:g} to {high:g}", lambda v: _lies(v, low - slack, high + slack), lambda _: better
    )


def _lies(value: Value, low: float, high: float) -> bool:
    return isinstance(value, float) and low <= value <= high


def near(value: float, share: float) -> Rule:
    """Within ``share`` of ``value``."""
    low, high = (1.0 - share) * value, (1.0 + share) * value
    return Rule(
        f"{low:.2f} to {high:.2f}", lambda v: _lies(v, low, high), lambda _: round(value, 3)
    )


def with_bits(mask: int, meaning: str) -> Rule:
    """All bits of ``mask`` set, the others as they are."""
    return Rule(
        f"bits of {mask} set ({meaning})",
        lambda v: int(v) & mask == mask,
        lambda v: float(int(v) | mask),
    )


def without_bit(bit: int, meaning: str) -> Rule:
    """Bit number ``bit`` not set, the others as they are."""
    mask = 1 << bit
    return Rule(
        f"bit {bit} ({mask}) not set: {meaning}",
        lambda v: not int(v) & mask,
        lambda v: float(int(v) & ~mask),
    )


def judge(advice: Advice, found: Mapping[str, Setting]) -> ParameterFinding:
    """Judge the parameters ``found`` by ``advice``."""
    for name in advice.names:
        if name in found:
            value = found[name].value
            fine = advice.rule.accepts(value) or advice.is_idle(found)
            verdict = "ok" if fine and advice.weight is not Weight.NOTE else str(advice.weight)
            recommended = (
                None if fine or advice.weight is Weight.NOTE else advice.rule.better(value)
            )
            return ParameterFinding(
                name, verdict, value, advice.rule.words, recommended, advice.why, advice.reboot
            )
    return ParameterFinding(
        advice.names[0], "absent", None, advice.rule.words, None, advice.why, advice.reboot
    )


def is_wrong(findings: Iterable[ParameterFinding]) -> bool:
    """True where something must or should be changed."""
    return any(finding.verdict in (Weight.MUST, Weight.SHOULD) for finding in findings)


def _advise(
    weight: Weight, names: str | tuple[str, ...], rule: Rule, why: str, *, reboot: bool = False
) -> Advice:
    return Advice((names,) if isinstance(names, str) else names, weight, rule, why, reboot)


must, should, note = (partial(_advise, weight) for weight in Weight)
"""Advice of that weight about a parameter, or about one that has several names."""


PX4_FLIGHT = (
    must(
        "MAV_TYPE",
        one_of({float(number): name for number, name in MULTIROTORS.items()}, 2.0),
        "PX4 takes our thrust as lift only where it knows that the vehicle is a multirotor; "
        "generic gives none.",
        reboot=True,
    ),
    must(
        "MAV_FWDEXTSP",
        exactly(1.0),
        "With 0, PX4 takes our commands from the wire and gives them to nobody.",
    ),
    should(
        "COM_OF_LOSS_T",
        between(0.2, 0.5, 0.4),
        "When commands stop, PX4 holds the last one for this long [s], blind. We fall silent on "
        "purpose after a bring-down, so this must be short: with 1 s, as delivered, one that "
        "leans may meet the floor at 1.3 m/s. Below 0.2 s a hiccup of the network already counts.",
    ),
    should(
        "COM_OBL_RC_ACT",
        one_of({4.0: "land", 6.0: "terminate", 7.0: "disarm"}, 4.0),
        "What PX4 does after that time. Land comes down where it is. Position, altitude and hold "
        "(0, 1, 5) leave it in the air, return (3) flies through the lab.",
    ),
    note(
        "COM_RCL_EXCEPT",
        between(0.0, 31.0, 4.0),
        "Modes in which a lost remote control does not matter. Bit 2 (4) is OFFBOARD: set it only "
        "where nobody holds a remote control, or else a transmitter that fails is not noticed.",
    ),
    note(
        "COM_RC_OVERRIDE",
        between(0.0, 7.0, 3.0),
        "Moving the sticks takes over: bit 0 (1) from automatic modes, bit 1 (2) from OFFBOARD. "
        "With bit 1 the pilot takes over at once; without it he needs the mode switch or the kill "
        "switch.",
    ),
    note(
        "COM_RC_IN_MODE",
        between(0.0, 8.0, 0.0),
        "Where sticks come from; 4 is nowhere at all. A lab wants a remote control with a kill "
        "switch.",
    ),
    note(
        "COM_DISARM_PRFLT",
        between(-1.0, 60.0, 10.0),
        "An armed vehicle that does not take off within this time [s] disarms itself; 0 or less: "
        "it never does.",
    ),
)
"""PX4 in flight: what it follows, and what it does without us."""

PX4_OUR_POSES = (
    should(
        "EKF2_EV_CTRL",
        with_bits(0b1011, "horizontal position, height and yaw"),
        "What PX4's estimator takes from the poses that link.forward sends it. Without, its own "
        "modes know no position after our flight.",
    ),
    should(
        "EKF2_HGT_REF",
        exactly(3.0),
        "Where height comes from: vision. Indoors a barometer follows doors and the rotors' own "
        "air.",
        reboot=True,
    ),
    should(
        "EKF2_EV_DELAY",
        between(0.0, 20.0, 0.0),
        "What the stamps of our poses do not tell of their age [ms]. They come in PX4's own time, "
        "by TIMESYNC.",
        reboot=True,
    ),
    should(
        "EKF2_EVP_NOISE",
        between(0.01, 0.05, 0.01),
        "The least position noise that PX4 believes in [m]: a tracker's is millimetres, and 0.1 "
        "as delivered lets the accelerometer lead.",
    ),
    should(
        "EKF2_EVA_NOISE",
        between(0.05, 0.1, 0.05),
        "The least yaw noise that PX4 believes in [rad].",
    ),
    should(
        "EKF2_MAG_TYPE",
        exactly(5.0),
        "No compass: steel and currents turn its heading indoors, and yaw comes with our poses.",
        reboot=True,
    ),
    should(
        ("EKF2_GPS_CTRL", "EKF2_AID_MASK"),
        exactly(0.0),
        "No GPS: a fix through the roof is off by metres, and position comes with our poses.",
    ),
    should(
        "SYS_HAS_GPS", exactly(0.0), "With 1, a missing GPS is a failed pre-arm check.", reboot=True
    ),
)
"""PX4's own estimator where our poses are forwarded to it."""

PX4_OTHER_POSES = (
    note(
        "EKF2_EV_CTRL",
        between(0.0, 15.0, 15.0),
        "What PX4's estimator takes from an external pose: bit 0 horizontal position, 1 height, 2 "
        "velocity, 3 yaw. Only where something sends it one.",
    ),
    note(
        "EKF2_HGT_REF",
        between(0.0, 3.0, 3.0),
        "Where height comes from: 0 barometer, 1 GPS, 2 range finder, 3 vision. Indoors with an "
        "external pose: 3.",
        reboot=True,
    ),
    note(
        "EKF2_EV_DELAY",
        between(0.0, 300.0, 0.0),
        "Age of the external pose when it arrives [ms]; wrong by 50 ms, fast flight is estimated "
        "wrongly.",
        reboot=True,
    ),
)
"""PX4's own estimator where they are not."""


def px4_advice(facts: VehicleFacts) -> list[Advice]:
    """The advice for a vehicle of which we believe ``facts``."""
    curve = (
        "Curve of the motors: thrust = f u² + (1 - f) u. With f measured here, link.thrust_curve "
        "is 0; only one of the two may straighten the curve."
    )
    return [
        must(
            "MAV_SYS_ID",
            exactly(facts.target_system),
            "The vehicle's MAVLink system: what link.target_system says, and on a network no two "
            "the same.",
            reboot=True,
        ),
        *PX4_FLIGHT,
        (must if facts.own_curve else note)(
            "THR_MDL_FAC", exactly(0.0) if facts.own_curve else between(0.0, 1.0, 0.0), curve
        ),
        should(
            "MPC_THR_HOVER",
            near(facts.hover, HOVER_SHARE),
            "PX4's own idea of the thrust that carries the vehicle, for its landing. Ours is "
            "vehicle.hover_thrust, or vehicle.mass_kg × 9.81 / vehicle.thrust_max_n through the "
            "thrust curve: if they differ, one is wrong.",
        ),
        *(PX4_OUR_POSES if facts.forwards else PX4_OTHER_POSES),
    ]


WITHOUT_STICKS = (
    "Without a remote control, mode LAND takes the sticks that never came for full deflection."
)
"""Seen on ArduCopter 4.7-dev with FS_THR_ENABLE 0, which it wants where there is none: else it
disarms at once."""

ARDUPILOT_COMMANDS = (
    must(
        "GUID_OPTIONS",
        with_bits(1 << 3, "thrust means thrust"),
        "Without this bit ArduPilot takes our thrust as a climb rate: half is hovering, full is "
        "its fastest climb.",
    ),
    must(
        "ATC_ANGLE_BOOST",
        exactly(0.0),
        "With 1, ArduPilot raises our thrust whenever the vehicle leans; the controller has done "
        "so already.",
    ),
    *(
        should(
            names,
            exactly(0.0),
            "How fast the rate that it follows may change; 0: at once. As delivered by 1,100 "
            "deg/s²: a rate that we swing from 200 to -200 deg/s takes 0.36 s, and the vehicle "
            "sways in strong gusts. It counts in all of its modes.",
        )
        for names in (("ATC_ACCEL_R_MAX", "ATC_ACC_R_MAX"), ("ATC_ACCEL_P_MAX", "ATC_ACC_P_MAX"))
    ),
    must(
        "FRAME_CLASS",
        one_of(
            {1.0: "quad", 2.0: "hexa", 3.0: "octa", 4.0: "octaquad", 5.0: "Y6", 7.0: "tri"}, 1.0
        ),
        "The vehicle's rotors; 0 is undefined, and then it does not arm.",
        reboot=True,
    ),
)
"""ArduPilot: our commands, and the vehicle that they are for."""

ARDUPILOT_SILENCE = (
    should(
        "GUID_TIMEOUT",
        between(0.2, 1.0, 0.5),
        "When commands stop, ArduPilot holds the last one for this long [s], blind, then levels "
        "out and keeps its height. We fall silent on purpose after a bring-down, so this must be "
        "short.",
    ),
    should(
        "FS_GCS_ENABLE",
        one_of({5.0: "land", 7.0: "brake, or land"}, 5.0),
        "What it does when the heartbeat of the ground station stops. 0: nothing, it stays in the "
        "air where it last levelled out. 1 and 3 return through the lab.",
    ),
    should(
        "FS_GCS_TIMEOUT",
        between(2.0, 3.0, 2.0),
        "How long our heartbeat, which comes once a second, may be missing before that [s]. A "
        "program that was killed in flight is noticed by this alone: with 5 s, as delivered, a "
        "vehicle at 1 m/s came down 3 m away. Below 2 s a single lost heartbeat may count.",
    ),
    note(
        "FS_THR_ENABLE",
        between(0.0, 7.0, 3.0),
        "What it does when the remote control is lost: 0 nothing (only where there is none), 3 "
        "lands.",
    ),
    *(
        should(name, exactly(0.0), f"{WITHOUT_STICKS} {what}").only_if("FS_THR_ENABLE", 0.0)
        for name, what in (
            ("LAND_REPOSITION", "With 1 it flies off while it lands."),
            ("PILOT_Y_RATE", "The rate that it turns at meanwhile [deg/s]."),
        )
    ),
    should(
        "RC_OPTIONS",
        without_bit(0, "the receiver counts"),
        "With bit 0 set it ignores the receiver, and the pilot's switches with it: nobody can "
        "take over by hand.",
    ),
    note(
        "DISARM_DELAY",
        between(0.0, 127.0, 10.0),
        "An armed vehicle that stands on the ground for this long [s] disarms itself; 0: it never "
        "does.",
    ),
)
"""ArduPilot without our commands, our heartbeat or a remote control."""

ARDUPILOT_MOTORS = (
    should(
        "MOT_SPIN_MIN",
        between(0.03, 0.3, 0.15),
        "The slowest that rotors turn in flight: our thrust 0 is this, so that no motor stops in "
        "the air. Too high, and it does not come down.",
    ),
    should(
        "MOT_SPOOL_TIME",
        between(0.0, 0.8, 0.5),
        "How long its rotors take to follow thrust at take-off [s]. Ours rises to the weight "
        "within 1.3 s, and is held for a third of a second only: rotors that do not follow by "
        "then are taken for a vehicle that does not lift off.",
    ),
)
"""ArduPilot's motors."""

_PLACES = "3 GPS, 6 external navigation, where something sends it a pose"
_VELOCITIES = {6.0: "external navigation", 0.0: "none"}

ARDUPILOT_OUR_POSES = (
    should(
        "VISO_TYPE",
        exactly(1.0),
        "It takes the poses that link.forward sends, over MAVLink. Without, its own modes know no "
        "position after our flight.",
        reboot=True,
    ),
    *(
        should(f"EK3_SRC1_{name}", rule, f"EKF3 takes {what} from our poses.")
        for name, what, rule in (
            ("POSXY", "horizontal position", exactly(6.0)),
            ("POSZ", "height", exactly(6.0)),
            ("VELXY", "horizontal velocity", one_of(_VELOCITIES, 6.0)),
            ("VELZ", "vertical velocity", one_of(_VELOCITIES, 6.0)),
            ("YAW", "heading", exactly(6.0)),
        )
    ),
    should(
        "VISO_POS_M_NSE",
        between(0.005, 0.1, 0.01),
        "The least position noise that EKF3 believes in [m]: a tracker's is millimetres.",
    ),
    should(
        "VISO_VEL_M_NSE",
        between(0.05, 0.3, 0.1),
        "The velocity noise that EKF3 believes in [m/s]; ours are differences of positions over "
        "40 ms.",
    ),
    should(
        "COMPASS_ENABLE",
        exactly(0.0),
        "No compass: steel and currents turn its heading indoors, and yaw comes with our poses.",
        reboot=True,
    ),
    should(
        ("GPS1_TYPE", "GPS_TYPE"),
        exactly(0.0),
        "No GPS: a missing one is a failed pre-arm check, and a fix through the roof is off by "
        "metres.",
        reboot=True,
    ),
)
"""EKF3 where our poses are forwarded to it; VISO_DELAY_MS is beside them."""

ARDUPILOT_OTHER_POSES = (
    note(
        "VISO_TYPE",
        between(0.0, 3.0, 0.0),
        "Whether it takes an external pose at all: 0 no, 1 over MAVLink.",
        reboot=True,
    ),
    *(
        note(f"EK3_SRC1_{name}", between(0.0, 8.0, 0.0), f"Where EKF3 takes {what} from: {values}.")
        for name, what, values in (
            ("POSXY", "horizontal position", _PLACES),
            ("POSZ", "height", f"1 barometer, 2 range finder, {_PLACES}"),
            ("VELXY", "horizontal velocity", f"{_PLACES}, 5 optical flow"),
            ("VELZ", "vertical velocity", _PLACES),
            ("YAW", "heading", "1 compass, 6 external navigation, 8 GSF"),
        )
    ),
)
"""EKF3 where they are not."""


def ardupilot_advice(facts: VehicleFacts) -> list[Advice]:
    """The advice for a vehicle of which we believe ``facts``."""
    curve = (
        "Curve of the motors: thrust = f u² + (1 - f) u, about 0.5 to 0.7. With f set here, "
        "link.thrust_curve is 0; only one of the two may straighten the curve."
    )
    return [
        *ARDUPILOT_COMMANDS,
        must(
            ("SYSID_THISMAV", "MAV_SYSID"),
            exactly(facts.target_system),
            "The vehicle's MAVLink system: what link.target_system says, and on a network no two "
            "the same.",
            reboot=True,
        ),
        should(
            ("SYSID_MYGCS", "MAV_GCS_SYSID"),
            exactly(facts.own_system),
            "The ground station whose heartbeat FS_GCS_ENABLE watches: us, link.system_id.",
        ),
        *ARDUPILOT_SILENCE,
        (must if facts.own_curve else note)(
            "MOT_THST_EXPO", exactly(0.0) if facts.own_curve else between(0.0, 1.0, 0.65), curve
        ),
        *ARDUPILOT_MOTORS,
        should(
            "MOT_THST_HOVER",
            near(facts.hover, HOVER_SHARE),
            "ArduPilot's own idea of the thrust that carries the vehicle; it learns it in flight "
            "(MOT_HOVER_LEARN). Ours is vehicle.hover_thrust, or else vehicle.mass_kg × 9.81 / "
            "vehicle.thrust_max_n through the thrust curve: if they differ, one is wrong.",
        ),
        *(
            [_advise_delay(facts), *ARDUPILOT_OUR_POSES]
            if facts.forwards
            else ARDUPILOT_OTHER_POSES
        ),
    ]


def _advise_delay(facts: VehicleFacts) -> Advice:
    """The age of our poses as ArduPilot is told it."""
    latency_s = facts.pose_latency_s
    delay = between(0.0, 50.0, 10.0)
    if latency_s is not None:
        delay = between(
            max(1e3 * latency_s - 10.0, 0.0),
            min(1e3 * latency_s + 10.0, 250.0),
            float(round(1e3 * latency_s)),
        )
    return should(
        "VISO_DELAY_MS",
        delay,
        "Age of a pose when it comes [ms]: pose.latency_s, as ArduPilot takes the arrival for its "
        "time.",
    )


FLIGHT_CHANNELS = 4
"""Channels of sticks and throttle of a Betaflight."""
EMPTY_SLOT = "0 0 900 900 0 0"
"""Row that assigns no mode."""
LEVEL_MODES = {
    1: "ANGLE", 2: "HORIZON", 3: "ALTHOLD", 5: "MAG", 6: "HEADFREE", 11: "POS HOLD",
    12: "PASSTHRU", 27: "FAILSAFE",
    29: "3D DISABLE", 30: "FPV ANGLE MIX", 35: "FLIP OVER AFTER CRASH", 45: "PARALYZE",
    46: "GPS RESCUE",
    47: "ACRO TRAINER", 49: "LAUNCH CONTROL", 50: "MSP OVERRIDE", 55: "CHIRP",
}  # fmt: skip
"""Modes in which sticks and throttle are not rates and thrust, or are nobody's; permanent numbers,
msp/msp_box.c."""
RATE_UNIT_DEG_S = 10.0
"""Betaflight stores rates in steps of this [deg/s]."""
RATE_MOST_DEG_S = 1998.0
"""Largest rate that Betaflight commands [deg/s]."""


class ReceiverFacts(NamedTuple):
    """Facts of our own configuration for Betaflight's table; pulses are in µs."""

    order: str
    """Order of the first eight channels, in letters of Betaflight's ``map``."""
    half_us: float
    """Half of what the receiver's pulses can move."""
    rates_deg_s: tuple[float, float, float]
    """Roll, pitch and yaw rates at full stick [deg/s]."""
    throttle_low: float
    """Position -1..1 for no thrust."""
    own_curve: bool
    """True where our side straightens the motors' curve."""
    arm: tuple[int, float, float]
    """AUX channel that arms, from 0; its pulses armed and disarmed."""
    aux_us: tuple[tuple[float, float], ...]
    """Lowest and highest pulse of each AUX channel that our frames may give."""


BETAFLIGHT_THROTTLE = (
    must("thr_expo", exactly(0.0), "The throttle's share is the motors' signal; a curve bends it."),
    note(
        "thr_mid",
        between(0.0, 100.0, 50.0),
        "From 4.6 on the throttle's curve has a corner here, at thr_hover.",
    ),
    must("throttle_limit_type", exactly("OFF"), "Else thrust is less than told."),
    must(
        "motor_output_limit", exactly(100.0), "It scales the motors down: thrust is less than told."
    ),
    note(
        "max_throttle",
        between(1000.0, 2000.0, 2000.0),
        "The full signal of motors by pulses (PWM, OneShot) [µs]: if their controllers take more, "
        "thrust is less.",
    ),
    should(
        "vbat_sag_compensation",
        exactly(0.0),
        "It changes the motors' signals with the battery's voltage; we find lost thrust ourselves.",
    ),
    must("throttle_boost", exactly(0.0), "Else thrust jumps with the throttle."),
    should(
        "anti_gravity_gain",
        exactly(0.0),
        "It raises the integrals as the throttle moves, in hover, too.",
    ),
)
"""Betaflight between throttle and motors."""

BETAFLIGHT_STICKS = (
    must("rates_type", exactly("ACTUAL"), "Else the rates below mean something else."),
    must(
        "mid_rc",
        exactly(1500.0),
        "The pulse that is no rate: else it turns while the sticks are centred.",
    ),
    must("deadband", exactly(0.0), "It swallows small corrections of roll and pitch."),
    must("yaw_deadband", exactly(0.0), "It swallows small corrections of yaw."),
    should("rc_smoothing", exactly("OFF"), "It is a lag more, which is in nobody's model."),
)
"""Betaflight between sticks and rates."""

BETAFLIGHT_STOPS = (
    should("small_angle", exactly(180.0), "It refuses to arm where the floor is not level."),
    should(
        "runaway_takeoff_prevention",
        exactly("OFF"),
        "It disarms on the floor, as our spool-up looks like a runaway.",
    ),
    must(
        "failsafe_procedure",
        exactly("DROP"),
        "Else it hovers away, or lands for seconds, without a pilot.",
    ),
    must(
        "failsafe_delay",
        between(3.0, 12.0, 12.0),
        "If no channel stands for disarmed by then, the motors turn for so long [0.1 s] after the "
        "receiver has given up; where it gives pulses that mean nothing 0.3 s more.",
    ),
    must(
        "msp_override_channels_mask",
        exactly(0.0),
        "Channels that a computer sends by MSP never go stale: the last thrust holds for ever.",
    ),
)
"""Betaflight as it arms, disarms and loses its receiver."""

BETAFLIGHT_GAINS = (
    should(
        "simplified_pids_mode",
        exactly("OFF"),
        "Else the sliders write the gains over at each start, those below too.",
    ),
    should(
        "i_yaw",
        between(0.0, 20.0, 10.0),
        "The firmware's own gains are for fast five-inch vehicles; on slow rotors its 80 here "
        "makes yaw swing for ever, which eats the thrust: on our simulated 80 g a step overshoots "
        "by 95 %, with 20 by 42, 10 by 25.",
    ),
    *(
        note(
            f"f_{axis}",
            exactly(0.0),
            "Feed-forward acts on steps of the stick, and ours moves in steps, one a frame: 0 "
            "flies in our tests.",
        )
        for axis in ("roll", "pitch", "yaw")
    ),
)
"""Gains of Betaflight's rate loop."""


def betaflight_advice(facts: ReceiverFacts, settings: Mapping[str, Value]) -> list[Advice]:
    """The advice for a board behind the receiver of ``facts``, with what is known of its
    ``settings`` and modes.
    """
    return [
        *_advise_channels(facts),
        *BETAFLIGHT_STICKS,
        *_advise_thrust(facts, settings),
        *BETAFLIGHT_THROTTLE,
        *BETAFLIGHT_STOPS,
        *BETAFLIGHT_GAINS,
        *_advise_slots(facts, settings),
    ]


def _advise_channels(facts: ReceiverFacts) -> list[Advice]:
    """Order, range and rates of the channels, and the throttle that counts as down."""
    low, high = 1500.0 - facts.half_us, 1500.0 + facts.half_us
    idle_us = round(1500.0 + 500.0 * facts.throttle_low)
    rows = [
        must(
            "map", exactly(facts.order), "What each channel is: the sticks are mixed up otherwise."
        ),
        *(
            must(
                f"rxrange {k}",
                exactly(f"{low:.0f} {high:.0f}"),
                "Else full stick is not full rate.",
            )
            for k in range(4)
        ),
        must(
            "min_check",
            between(
                max(1001.0, idle_us - 5.0), max(1005.0, idle_us + 5.0), max(1005.0, float(idle_us))
            ),
            "Below this the throttle is down. link.map's thrust.low must be the same place (-0.98 "
            "is 1010): where it is above, nothing arms; far below, our least thrusts are none.",
        ),
    ]
    curve = "A rate is the stick's share of full_rate_deg_s in link.map: any other curve bends it"
    for axis, rate in zip(("roll", "pitch", "yaw"), facts.rates_deg_s, strict=True):
        tenth = exactly(rate / RATE_UNIT_DEG_S)
        rows += [
            must(
                f"{axis}_rc_rate", tenth, f"{curve}; this is its slope in the middle, in 10 deg/s."
            ),
            must(f"{axis}_srate", tenth, f"{curve}; this is the rate at full stick, in 10 deg/s."),
            must(f"{axis}_expo", exactly(0.0), f"{curve}, here around the middle."),
            must(
                f"{axis}_rate_limit",
                between(rate, RATE_MOST_DEG_S, RATE_MOST_DEG_S),
                "It cuts faster rates.",
            ),
        ]
    return rows


def _advise_thrust(facts: ReceiverFacts, settings: Mapping[str, Value]) -> list[Advice]:
    """The curve from throttle to motors, which only one of the two may straighten."""
    linear = (
        "The motors' curve is told by vehicle.thrust_curve; only one of the two may straighten it."
    )
    return [
        must(
            "thr_hover",
            exactly(settings.get("thr_mid", 50.0)),
            "What the motors get where the throttle is at thr_mid [%]: where the two differ, "
            "thrust is bent there.",
        ),
        (must if facts.own_curve else note)("thrust_linear", exactly(0.0), linear),
        note(("motor_idle", "dshot_idle_value"), between(0.0, 2000.0, 550.0), linear),
    ]


def _advise_slots(facts: ReceiverFacts, slots: Mapping[str, Value]) -> list[Advice]:
    """One row arms, by our channel alone.

    No other arms, or is met by what our frames say, in a mode of its own.
    """
    parsed = {name: _parse_slot(row) for name, row in slots.items() if name.startswith("aux ")}
    used = {name: slot for name, slot in parsed.items() if slot[2] < slot[3]}
    free = next((name for name in parsed if name not in used), "aux 0")
    arming = next((name for name, slot in used.items() if slot[0] == BoardMode.ARM), free)
    channel, armed_us, disarmed_us = facts.arm
    name_of = {name: LEVEL_MODES.get(slot[0], "ARM") for name, slot in used.items()}
    return [
        must(
            f"rxfail {FLIGHT_CHANNELS + channel}",
            exactly("s 1000" if disarmed_us < armed_us else "s 2000"),
            "Once its pulses are missing or mean nothing, the arm channel stands for disarmed, "
            "and the motors stop 0.3 s (without frames 0.5 s) after the receiver has given up. "
            "Else it stays armed for failsafe_delay.",
        ),
        must(
            arming,
            _arms_by(facts),
            "Mode, channel, range: it arms by our arm channel, and disarms by it.",
        ),
        *(
            must(
                name,
                _stays_out(facts),
                f"{name_of[name]}: our frames would turn it on, and sticks are then something "
                "else than rates.",
            )
            for name in used
            if name != arming
        ),
    ]


def _arms_by(facts: ReceiverFacts) -> Rule:
    """A row that arms by our arm channel, and by nothing else."""
    channel, armed_us, disarmed_us = facts.arm
    span = "1700 2100" if disarmed_us < armed_us else "900 1300"

    def accepts(value: Value) -> bool:
        mode, at, begin, end, logic, linked = _parse_slot(value)
        here = begin <= armed_us < end and not begin <= disarmed_us < end
        return (mode, at, logic, linked) == (BoardMode.ARM, channel, 0, 0) and here

    words = f"ARM on AUX{channel + 1}, on {armed_us:.0f} and off {disarmed_us:.0f} µs"
    return Rule(words, accepts, lambda _: f"{BoardMode.ARM:d} {channel} {span} 0 0")


def _stays_out(facts: ReceiverFacts) -> Rule:
    """A row that does not arm, and whose mode our frames do not turn on."""

    def accepts(value: Value) -> bool:
        mode, at, begin, end, _, _ = _parse_slot(value)
        low, high = facts.aux_us[at] if at < len(facts.aux_us) else (0.0, math.inf)
        met = begin < end and begin <= high and low < end
        return begin >= end or (mode != BoardMode.ARM and not (met and mode in LEVEL_MODES))

    words = "no mode of its own that our frames would meet"
    return Rule(words, accepts, lambda _: EMPTY_SLOT)


def _parse_slot(value: Value) -> tuple[int, int, int, int, int, int]:
    """Mode, AUX channel, first and last pulse [µs], logic and linked mode.

    Those of an empty row where it is none.
    """
    words = value.split() if isinstance(value, str) else []
    numbers = [int(word) for word in words if word.isdecimal()]
    if len(numbers) != len(words) or not 4 <= len(numbers) <= 6:
        return _parse_slot(EMPTY_SLOT)
    mode, channel, begin, end, logic, linked = (*numbers, 0, 0)[:6]
    return mode, channel, begin, end, logic, linked
