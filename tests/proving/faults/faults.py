"""The faults by name, each with the states and links that it is flown on.

Every one is flown in every state, but for these:

- What is so from the beginning (a wrong mass, another propeller, an estimate that wanders, a floor that holds) is one
  flight: *start*.
- A vehicle that stands can't be pushed, hang on a cable, or be taken out of the air: not in *ready* and *arming*.
- The air under the rotors matters near the floor alone: its cushion is there from the start, or sets in while coming
  down.
- A coordinate that stands, and a position that is scaled, smoothed or late while the attitude is true, strike where
  they are seen in time. Where they are not, and how far the vehicle went, docs/explanation/guards.md says.
- Another body at rest matters with a wrong thrust or mass before lift-off alone: in the air both are known.
- Over a radio what is false meets something else than over MAVLink in the air alone, where nobody could land the
  vehicle: not in *ready* and *arming*; and of what lies on the way down only the *descent*.
- What needs processes of its own is flown where a process of its own makes a difference.

*start* is before the first pose: the flight begins with the fault. It is flown with what an instrument may be set up
with, and with another body's name.
"""

import math

from tests.proving.faults import pictures, strikes
from tests.proving.faults.fault import MOMENTS, Exemption, Fault, Poses

STATES = tuple(name for name in MOMENTS if name != "start")
FROM_START = ("start", *STATES)
ON_FLOOR = ("start", "ready", "arming", "spool-up")
IN_AIR = ("arming", "spool-up", "take-off", "hold", "tracking", "returning", "landing", "descent")
FLYING = ("take-off", "hold", "tracking", "moving", "returning", "landing", "descent")
PACED = ("spool-up", "hold", "tracking", "descent")
RADIO_STATES = ("spool-up", "take-off", "hold", "tracking", "descent")
"""Where a false pose over a radio meets something else than over MAVLink: nobody could land the vehicle."""
SEEN_IN_TIME = ("take-off", "hold", "tracking", "moving", "returning", "descent")
"""Where a coordinate that stands, or a position that comes late, is seen before it has led the vehicle away; guards.md
tells of the others."""
BEHIND_RADIO = ", on a vehicle behind a radio"


def _radio(fault: Fault, states: tuple[str, ...]) -> Fault:
    return fault._replace(says=fault.says + BEHIND_RADIO, link="dsm", states=states)


BROKEN: dict[str, Fault] = {
    "freeze": Fault("frames go on, the picture stands still", strikes.shows(pictures.freeze), poses=Poses.GONE),
    "dropout": Fault("no more poses", strikes.dropout, poses=Poses.GONE),
    "dropout, radio": Fault("no more poses" + BEHIND_RADIO, strikes.dropout, link="dsm", poses=Poses.GONE),
    "teleport": Fault(
        "the vehicle is seen 1 m away from where it is", strikes.shows(pictures.teleport), poses=Poses.GONE
    ),
    "yaw flip": Fault(
        "the vehicle is seen turned by 180°", strikes.shows(pictures.turn_axes(0.0, 0.0, 180.0)), poses=Poses.GONE
    ),
    "marker swap": Fault(
        "our body and another change names",
        strikes.shows(pictures.swap),
        overrides=("sim.other_bodies=1",),
        poses=Poses.GONE,
    ),
    "duplicates": Fault("every datagram comes three times", strikes.comes(lambda: pictures.duplicates), obeys=True),
    "reorder": Fault("each second datagram overtakes the one before", strikes.comes(pictures.reorder), obeys=True),
    "clock step": Fault(
        "the trackers' clock leaps by 5 s", strikes.comes(lambda: pictures.clock_step), source="json", obeys=True
    ),
    "latency step": Fault("poses come 60 ms later than they did", strikes.comes_late(0.060, fresh=False)),
    "frame loss": Fault("70 % of the command frames get lost", strikes.frame_loss),
    "link stall": Fault("for 1.5 s nothing passes on the link", strikes.stall),
    "serial unplug": Fault("the radio module's plug is out", strikes.unplug, link="dsm", exemption=Exemption.NO_LINK),
    "autopilot reboot": Fault("the autopilot restarts in flight", strikes.reboot, exemption=Exemption.NO_MOTORS),
    "mode stolen": Fault("a pilot takes over by the remote control, and lands", strikes.steal, silences=True),
    "motor at 70 %": Fault("the rotors give 70 % of their thrust", strikes.weaken(0.7), obeys=True),
    "battery sag": Fault("within 6 s the battery is empty, and thrust falls to 75 %", strikes.sag, obeys=True),
    "gust": Fault("for 1.5 s the wind pushes with 3.7 m/s² more", strikes.gust, obeys=True),
    "controller exception": Fault("the controller raises", strikes.controller),
    "recorder failure": Fault("the recorder raises; its process is killed", strikes.recorder, live=("tracking",)),
    "MQTT broker gone": Fault("the broker ends", live=("take-off", "tracking"), states=("take-off", "tracking")),
    "TUI crash": Fault(
        "the screen's process is killed", live=("take-off", "tracking"), states=("take-off", "tracking")
    ),
    "SIGTERM": Fault("the process is told to end", strikes.terminate),
    "SIGKILL": Fault("the process is killed", live=IN_AIR, states=IN_AIR),
    "SIGKILL, radio": Fault(
        "the process is killed, on a vehicle behind a radio whose frames another process paces",
        link="dsm",
        poses=Poses.GONE,
        live=("hold", "tracking"),
        states=("hold", "tracking"),
    ),
    "pacer killed": Fault(
        "the process that paces the radio's frames is killed",
        link="dsm",
        poses=Poses.GONE,
        live=PACED,
        states=PACED,
    ),
    "pacer stopped": Fault(
        "the process that paces the radio's frames is stopped (SIGSTOP)",
        link="dsm",
        poses=Poses.GONE,
        live=("hold", "tracking"),
        states=("hold", "tracking"),
    ),
    "pacer killed, bridge": Fault(
        "the process that paces the frames of a bridge's radio is killed",
        link="rf_bridge",
        poses=Poses.GONE,
        live=("hold", "tracking"),
        states=("hold", "tracking"),
    ),
    "bridge interrupted": Fault(
        "the bridge to the radio is told to end, by Ctrl-C",
        link="rf_bridge",
        poses=Poses.GONE,
        live=("hold", "tracking"),
        states=("hold", "tracking"),
    ),
}
"""Something breaks, and shows it."""

LYING: dict[str, Fault] = {
    "flicker": Fault(
        "frames go on, the picture stands still but for a nanometre", strikes.shows(pictures.flicker), poses=Poses.FALSE
    ),
    "frozen": Fault(
        "frames go on, the picture stands still but for noise of 0.3 mm and 2 mrad",
        strikes.shows(pictures.still),
        poses=Poses.FALSE,
    ),
    "position frozen": Fault(
        "the position alone stands still, with noise", strikes.shows(pictures.still_position), poses=Poses.FALSE
    ),
    **{
        f"{name} frozen": Fault(
            f"the position's {axis} alone stands still, with noise",
            strikes.shows(pictures.still_coordinate(number)),
            poses=Poses.FALSE,
            states=states,
        )
        for number, (name, axis, states) in enumerate(
            (
                ("x", "north", ("start", *SEEN_IN_TIME)),
                ("y", "east", ("start", "arming", *SEEN_IN_TIME)),
                ("z", "height", ("start", "ready", "arming", "spool-up", "take-off", "returning")),
            )
        )
    },
    "attitude frozen": Fault(
        "the attitude alone stands still, with noise", strikes.shows(pictures.still_attitude), poses=Poses.FALSE
    ),
    "body at rest": Fault(
        "the poses are those of a body beside it that rests",
        strikes.shows(pictures.resting),
        poses=Poses.FALSE,
        states=FROM_START,
    ),
    **{
        f"body at rest, {what}": Fault(
            f"the poses are those of a body beside it that rests, and {says}",
            strikes.shows(pictures.resting),
            overrides=(override,),
            poses=Poses.FALSE,
            states=ON_FLOOR,
        )
        for what, says, override in (
            ("thrust +25 %", "the rotors give 25 % more than told", "sim.thrust_gain=1.25"),
            ("mass told +25 %", "the mass is told 25 % too large", "vehicle.mass_kg=0.1"),
        )
    },
    "body carried": Fault(
        "the poses are those of a body beside it that is carried around at 0.5 m/s",
        strikes.shows(pictures.carry),
        poses=Poses.FALSE,
        states=FROM_START,
    ),
    "partner": Fault(
        "the poses are those of a vehicle beside it that flies the same course: told the same, in other air",
        strikes.partner,
        poses=Poses.FALSE,
        exemption=Exemption.NOT_OBSERVABLE,
        states=FROM_START,
    ),
    "drift 0.1 m/s": Fault(
        "the position drifts away at 0.1 m/s",
        strikes.shows(pictures.drift(0.1)),
        poses=Poses.FALSE,
        exemption=Exemption.NOT_OBSERVABLE,
    ),
    "drift 0.3 m/s": Fault(
        "the position drifts away at 0.3 m/s",
        strikes.shows(pictures.drift(0.3)),
        poses=Poses.FALSE,
        exemption=Exemption.NOT_OBSERVABLE,
    ),
    "x mirrored": Fault(
        "the position's north is south",
        strikes.shows(pictures.map_positions(((-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))),
        poses=Poses.FALSE,
        states=FROM_START,
    ),
    "y mirrored": Fault(
        "the position's east is west",
        strikes.shows(pictures.map_positions(((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)))),
        poses=Poses.FALSE,
        states=FROM_START,
    ),
    "z mirrored": Fault(
        "the position's up is down",
        strikes.shows(pictures.map_positions(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)))),
        poses=Poses.FALSE,
        states=FROM_START,
    ),
    "x and y swapped": Fault(
        "the position's north and east have changed places",
        strikes.shows(pictures.map_positions(((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)))),
        poses=Poses.FALSE,
        states=FROM_START,
    ),
    "roll and pitch swapped": Fault(
        "roll is seen as pitch, and pitch as roll",
        strikes.shows(pictures.swap_axes),
        poses=Poses.FALSE,
        states=FROM_START,
    ),
    "roll mirrored": Fault(
        "roll has the wrong sign", strikes.shows(pictures.flip_signs(-1.0, 1.0)), poses=Poses.FALSE, states=FROM_START
    ),
    "pitch mirrored": Fault(
        "pitch has the wrong sign", strikes.shows(pictures.flip_signs(1.0, -1.0)), poses=Poses.FALSE, states=FROM_START
    ),
    "yaw off by 14°": Fault(
        "the vehicle is seen turned by 14°",
        strikes.shows(pictures.turn_axes(0.0, 0.0, 14.0)),
        poses=Poses.FALSE,
        states=FROM_START,
    ),
    "yaw off by 90°": Fault(
        "the vehicle is seen turned by 90°",
        strikes.shows(pictures.turn_axes(0.0, 0.0, 90.0)),
        poses=Poses.FALSE,
        states=FROM_START,
    ),
    "yaw off by 180°": Fault(
        "the vehicle is seen turned by 180° from the beginning; later this is *yaw flip*",
        strikes.shows(pictures.turn_axes(0.0, 0.0, 180.0)),
        poses=Poses.FALSE,
        states=("start",),
    ),
    "yaw turning": Fault(
        "the vehicle is seen to turn at 20°/s more than it does",
        strikes.shows(pictures.turning),
        poses=Poses.FALSE,
    ),
    "tilt off by 14°": Fault(
        "the vehicle is seen to lean by 14° more than it does",
        strikes.shows(pictures.turn_axes(14.0, 0.0, 0.0)),
        poses=Poses.FALSE,
        states=FROM_START,
    ),
    "m for mm": Fault(
        "positions are a thousandth of what they are",
        strikes.shows(pictures.scale_positions(1e-3)),
        poses=Poses.FALSE,
        states=FROM_START,
    ),
    **{
        f"position {share:g} of itself": Fault(
            f"positions go only {share:g} of the way that the vehicle goes",
            strikes.shows(pictures.scale_positions(share)),
            poses=Poses.FALSE,
            states=states,
        )
        for share, states in (
            (0.1, ("take-off", "hold", "tracking", "moving", "descent")),
            (0.3, ("take-off", "tracking", "moving", "descent")),
        )
    },
    "mm for m": Fault(
        "positions are a thousand times what they are",
        strikes.shows(pictures.scale_positions(1e3)),
        poses=Poses.FALSE,
        states=FROM_START,
    ),
}
"""Poses look as if they were of our vehicle, and are not."""

LATE: dict[str, Fault] = {
    **{
        f"late by {ms} ms": Fault(
            f"poses come {ms} ms later than they did; their numbers tell",
            strikes.comes_late(1e-3 * ms, fresh=False),
        )
        for ms in (100, 200, 400)
    },
    **{
        f"late by {ms} ms, fresh": Fault(
            f"poses come {ms} ms later than they did, with stamps as if they did not",
            strikes.comes_late(1e-3 * ms, fresh=True),
            source="json",
            poses=Poses.FALSE,
        )
        for ms in (100, 200, 400)
    },
    "position late by 300 ms": Fault(
        "the position comes 300 ms later than the attitude, both with fresh stamps",
        strikes.shows(pictures.late_position(0.3)),
        poses=Poses.FALSE,
        states=SEEN_IN_TIME,
    ),
    "position smoothed": Fault(
        "the position is smoothed with a time constant of 1 s, the attitude is not",
        strikes.shows(pictures.smoothed_position(1.0)),
        poses=Poses.FALSE,
        states=SEEN_IN_TIME,
    ),
    "stands now and again": Fault(
        "for 0.25 s of each second the picture stands still but for noise",
        strikes.shows(pictures.now_and_again(0.25, 1.0)),
        poses=Poses.FALSE,
        states=FLYING,
    ),
    "stands once": Fault(
        "for 0.3 s the picture stands still but for noise, then it is true again",
        strikes.shows(pictures.now_and_again(0.3, math.inf)),
        poses=Poses.FALSE,
        states=FLYING,
    ),
    "later and later": Fault(
        "poses come later by 50 ms more each second, up to 400 ms; their numbers tell",
        strikes.comes_late(pictures.growing, fresh=False),
    ),
    "later and later, fresh": Fault(
        "poses come later by 50 ms more each second, up to 400 ms, with stamps as if they did not",
        strikes.comes_late(pictures.growing, fresh=True),
        source="json",
        poses=Poses.FALSE,
    ),
    "every 8th frame": Fault("of eight frames only one comes: 6.3 a second", strikes.comes(lambda: pictures.every(8))),
    "every 11th frame": Fault(
        "of eleven frames only one comes: 4.5 a second", strikes.comes(lambda: pictures.every(11))
    ),
    **{
        f"stamps off by {ms} ms": Fault(
            f"stamps jitter by {ms} ms (1 sigma)", strikes.jitter_stamps(1e-3 * ms), source="json"
        )
        for ms in (1, 2, 5)
    },
}
"""Poses are true, but not when they say, or not when they are needed."""

OBEYING: dict[str, Fault] = {
    **{
        f"{what} {sign}{share} %{end}": Fault(
            f"{says} by {share} % {how}{BEHIND_RADIO if end else ''}",
            strikes.nothing,
            link="dsm" if end else "mavlink",
            overrides=(f"{key}={value:g}",),
            obeys=True,
            states=("start",),
        )
        for what, says, key, one in (
            ("mass told", "the mass is told wrong,", "vehicle.mass_kg", 0.08),
            ("thrust", "propellers or battery give another thrust than told,", "sim.thrust_gain", 1.0),
        )
        for sign, how, share, value in (
            ("+", "too much", 30, 1.3 * one),
            ("-", "too little", 30, 0.7 * one),
        )
        for end in ("", ", radio")
    },
    "motor at 130 %": Fault("the rotors give 130 % of their thrust", strikes.weaken(1.3), obeys=True),
    "push": Fault("a hand pushes for 1 s, with 4 m/s² at most", strikes.push, obeys=True, states=("spool-up", *FLYING)),
    "tether": Fault(
        "a cable on the floor is caught: 0.3 m farther it pulls like a spring",
        strikes.tether,
        obeys=True,
        states=("spool-up", *FLYING),
    ),
    "ground effect": Fault(
        "on the floor the same rotors lift 25 % more than far from it, 10 cm above it 6 %",
        strikes.cushion,
        obeys=True,
        states=("start", "landing", "descent"),
    ),
    "taken out of the air": Fault(
        "an operator grips the vehicle, leads it down to the floor at 0.5 m/s, and holds it there",
        strikes.take_out,
        obeys=True,
        states=FLYING,
    ),
    "estimator reset": Fault(
        "poses are the autopilot's own, whose heading goes astray by 19° within 3 s; its estimator then finds the true "
        "one, and says so",
        strikes.reset,
        source="odometry",
        obeys=True,
    ),
    "wandering estimate": Fault(
        "poses are the autopilot's own, and wander: a random walk of 5 cm (1 sigma) in 2 s, and one turn by 19°",
        strikes.nothing,
        source="odometry",
        overrides=("sim.estimate_wander_m=0.05", "sim.estimate_yaw_step_deg=19"),
        obeys=True,
        states=("start",),
    ),
    "late floor": Fault(
        "the floor holds the vehicle for 0.6 s while it gathers speed",
        strikes.nothing,
        overrides=("sim.floor_hold_s=0.6",),
        obeys=True,
        states=("start",),
    ),
    "late floor, own estimate": Fault(
        "the same, and poses are the autopilot's own, which feels that it rises",
        strikes.nothing,
        source="odometry",
        overrides=("sim.floor_hold_s=0.6",),
        obeys=True,
        states=("start",),
    ),
    "wireless": Fault("poses come up to 60 ms late, each otherwise; their numbers tell", strikes.wifi, obeys=True),
}
"""Nothing is wrong with the poses, and whoever convicts them is wrong."""

UNSEEN_BY_RADIO = (
    ("x frozen", "start"),
    ("x frozen", "spool-up"),
    ("x frozen", "hold"),
    ("position late by 300 ms", "hold"),
    ("stands now and again", "hold"),
)
"""Where MAVLink's LAND helps in time and rates alone do not; guards.md has the figures."""
RADIO: dict[str, Fault] = {
    f"{name}, radio": _radio(
        fault,
        tuple(
            state
            for state in ("start", *RADIO_STATES)
            if state in (fault.states or STATES) and (name, state) not in UNSEEN_BY_RADIO
        ),
    )
    for name, fault in (LYING | LATE).items()
    if name
    in (
        "flicker", "frozen", "position frozen", "x frozen", "z frozen", "attitude frozen", "body at rest",
        "body carried", "x mirrored", "z mirrored", "roll and pitch swapped", "yaw off by 90°",
        "position 0.1 of itself", "position 0.3 of itself", "m for mm", "position late by 300 ms",
        "stands now and again", "later and later, fresh", "every 11th frame",
    )
}  # fmt: skip
"""The same on a vehicle behind a radio."""

FAULTS: dict[str, Fault] = BROKEN | LYING | LATE | OBEYING | RADIO
"""By name."""
