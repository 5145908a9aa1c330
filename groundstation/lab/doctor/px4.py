"""What we look at on PX4. Names and meanings: PX4's parameter reference, v1.14 to main of 2026."""

from groundstation.lab.doctor.advice import Advice, Facts, Weight, between, exactly, near, one_of
from links.mavlink.protocol import MULTIROTORS

HOVER_SHARE = 0.2
"""How far the hover thrust may be from ours, as a share of it."""


def table(facts: Facts) -> list[Advice]:
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
