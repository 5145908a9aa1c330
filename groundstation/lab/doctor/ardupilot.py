"""What we look at on ArduPilot Copter. Names and meanings: its parameter reference, 4.2 to master of 2026."""

from groundstation.lab.doctor.advice import Advice, Facts, Weight, between, exactly, near, one_of, with_bit, without_bit

HOVER_SHARE = 0.2
"""How far the hover thrust may be from ours, as a share of it."""


def table(facts: Facts) -> list[Advice]:
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
