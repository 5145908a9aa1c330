"""The faults by name: how each strikes, and the states and links that it is flown on.

Every one is flown in every state, but for these:

- What is so from the beginning (a wrong mass, another propeller, an estimate that wanders, a floor that holds) is one
  flight: *start*.
- A vehicle that stands can't be pushed, hang on a cable, or be taken out of the air: not in *ready* and *arming*.
- The air under the rotors matters near the floor alone: its cushion is there from the start, or sets in while coming
  down.
- A coordinate that stands, and a position that is scaled, smoothed or late while the attitude is true, strike where
  they are seen in time.
- Another body at rest matters with a wrong thrust or mass before lift-off alone: in the air both are known.
- Over a radio what is false meets something else than over MAVLink in the air alone, where nobody could land the
  vehicle: not in *ready* and *arming*; and of what lies on the way down only the *descent*.
- What needs processes of its own is flown where a process of its own makes a difference.

*start* is before the first pose: the flight begins with the fault. It is flown with what an instrument may be set up
with, and with another body's name.
"""

import asyncio
import math
from collections.abc import Callable, Coroutine
from typing import Any, Concatenate, ParamSpec

import msgspec

from groundstation.core.geometry import Quat, Vec3, so3
from groundstation.core.mission import Interrupts
from sim.autopilots import Px4Autopilot
from sim.world import Body, Wind, generator, rows
from tests.proving.faults import pictures
from tests.proving.faults.fault import (
    MOMENTS,
    Exemption,
    Fault,
    Kind,
    Poses,
    Scene,
    Strike,
    name_of,
)
from tests.proving.faults.pictures import Picture, Way, late

SAG_STEP_S = 0.1
"""Time between its steps [s]."""
FULL_V = 3.9
"""Cell voltage before the collapse [V]."""
EMPTY_V = 3.1
"""Cell voltage after it [V]."""
GUST_M_S2 = (3.0, 2.0, 1.0)
"""Acceleration by a gust, NED [m/s²]."""
TURN_PER_SEED_RAD = math.radians(137.5)
"""Angle from one seed's disturbances to the next one's: no two of some seeds are alike [rad]."""
GRASP_PER_S2 = 400.0
"""Stiffness of a hand, for the vehicle's mass [1/s²]."""
GRASP_MOST_M_S2 = 60.0
"""Strongest pull of a hand, for the vehicle's mass [m/s²]."""
STEP_S = 0.01
"""Step of what moves a vehicle, or its heading, little by little [s]."""
TETHER_PER_S2 = 40.0
"""Stiffness of that cable per mass [1/s²]: 3.2 N/m at 80 g."""
ROTOR_M = 0.05
"""Rotor radius in the ground effect's model [m]."""
LED_TILT_DEG = 20.0
"""Tilt in that hand [deg]."""
GRIP_S = 0.3
"""Time constant of the hand's grip [s]."""

LONG_HOLD = ("takeoff.hold_s=30",)
"""``--set`` of a hold that lasts."""


P = ParamSpec("P")


def takes(act: Callable[Concatenate[Scene, P], Coroutine[Any, Any, None]]) -> Callable[P, Strike]:
    """Make strikes of ``act``, which takes more than the scene: the table tells with what each is flown."""

    def make(*told: P.args, **named: P.kwargs) -> Strike:
        return lambda scene: act(scene, *told, **named)

    return make


@takes
async def shows(scene: Scene, make: Callable[..., Picture], *told: Any) -> None:
    """A wrong picture, made of what was shown last and of what it is ``told``."""
    scene.between.picture = make(scene.struck, *told)


@takes
async def comes(scene: Scene, make: Callable[[], Way]) -> None:
    """Frames that come otherwise."""
    scene.between.way = make()


@takes
async def shows_few(scene: Scene, nth: int, make: Callable[..., Picture], *told: Any) -> None:
    """A wrong picture, of which only every ``nth`` frame comes."""
    scene.between.picture, scene.between.way = make(scene.struck, *told), pictures.every(nth)


@takes
async def shows_in_turns(scene: Scene, turn_s: float, make: Callable[..., Picture], *told: Any) -> None:
    """A picture that is wrong for so long [s], true for as long, and wrong again, from what is true then."""
    while True:
        scene.between.picture = make(scene.struck, *told)
        await asyncio.sleep(turn_s)
        scene.between.picture = None
        await asyncio.sleep(turn_s)


@takes
async def comes_late(scene: Scene, delay_s: float | Callable[[float], float], *, fresh: bool) -> None:
    """Frames that come so much later [s], or by a function of the time since."""
    of = delay_s if callable(delay_s) else lambda since_s: delay_s
    scene.between.way = late(of, 1.0 / scene.stage.world.pose_rate_hz, fresh=fresh)


def grow(rate: float, most_s: float) -> Callable[[float], float]:
    """A delay that grows by ``rate`` [s/s] up to ``most_s`` [s]."""
    return lambda since_s: min(rate * since_s, most_s)


@takes
async def jitter_stamps(scene: Scene, sigma_s: float) -> None:
    """Stamps that jitter."""
    scene.between.way = pictures.shift_stamps(lambda: sigma_s * next(scene.normals)[0])


@takes
async def scatter(scene: Scene, most_s: float) -> None:
    """Poses over a wireless network: none is lost or overtakes another, each is up to so much late [s]."""
    normals = scene.normals

    def delay_s(_: float) -> float:
        return most_s * min(abs(next(normals)[0]) / 3.0, 1.0)

    scene.between.way = late(delay_s, 1.0 / scene.stage.world.pose_rate_hz, fresh=False)


@takes
async def partner(scene: Scene, more_m_s2: Vec3) -> None:
    """The cameras take a partner for ours, told the same, in air that pushes it by so much more [m/s²]."""
    stage = scene.stage
    assert stage.mocap is not None, "the deck flies with cameras"
    x, y, z = stage.world.wind_mean
    north, east, down = more_m_s2
    world = msgspec.structs.replace(stage.world, wind_mean=(x + north, y + east, z + down))
    other = stage.plant.twin(scene.now_s, world, Wind(world, rows(generator(0, "partner").standard_normal, 3)))
    stage.plant.partner = other
    stage.mocap.see(other)


@takes
async def lead_astray(scene: Scene, heading_deg: float, within_s: float) -> None:
    """The heading of the autopilot's estimator goes astray; it finds that, turns it to what is true, and says so."""
    vehicle, steps = scene.stage.vehicle, round(within_s / STEP_S)
    for step in range(1, steps + 1):
        vehicle.lead_heading_astray(heading_deg * step / steps)
        await asyncio.sleep(STEP_S)
    vehicle.reset_heading()


async def nothing(scene: Scene) -> None:
    """Do nothing: the fault has been there from the beginning."""


async def dropout(scene: Scene) -> None:
    """The cameras are covered."""
    assert scene.stage.mocap is not None, "the deck flies with cameras"
    scene.stage.mocap.cover(True)


@takes
async def lose_frames(scene: Scene, share: float) -> None:
    """Command frames get lost."""
    scene.stage.frame_loss = share


@takes
async def cut(scene: Scene, for_s: float, *, hears: bool = False, speaks: bool = False) -> None:
    """The link passes nothing for so long [s], but what the autopilot hears or says."""
    scene.stage.peer.cut(True, hears=hears, speaks=speaks)
    await asyncio.sleep(for_s)
    scene.stage.peer.cut(False)


async def keep_answers(scene: Scene) -> None:
    """No answer to TIMESYNC comes any more; the autopilot hears all, and all else that it says comes."""
    scene.stage.autopilot.answers_timesync = False


async def unplug(scene: Scene) -> None:
    """The radio module is pulled out."""
    scene.stage.port.cut = True


@takes
async def reboot(scene: Scene, for_s: float) -> None:
    """The autopilot restarts."""
    scene.stage.peer.reboot(for_s)


async def steal(scene: Scene) -> None:
    """A pilot takes over."""
    autopilot = scene.stage.autopilot
    assert isinstance(autopilot, Px4Autopilot), "the deck flies with a PX4"
    autopilot.take_over(scene.now_s)


@takes
async def weaken(scene: Scene, share: float) -> None:
    """The rotors give another share of their thrust."""
    scene.stage.plant.weaken(scene.now_s, share)


@takes
async def sag(scene: Scene, to_share: float, within_s: float) -> None:
    """The battery collapses, and leaves a share of the thrust."""
    steps = round(within_s / SAG_STEP_S)
    for step in range(1, steps + 1):
        share = 1.0 - step / steps
        scene.stage.plant.weaken(scene.now_s, to_share + (1.0 - to_share) * share)
        scene.stage.autopilot.battery = EMPTY_V + (FULL_V - EMPTY_V) * share, share
        await asyncio.sleep(SAG_STEP_S)


@takes
async def push(scene: Scene, ned_m_s2: Vec3, for_s: float = math.inf) -> None:
    """A steady push, as acceleration; for ever where no time is told [s]."""
    scene.stage.wind.push = ned_m_s2
    if for_s < math.inf:
        await asyncio.sleep(for_s)
        scene.stage.wind.push = (0.0, 0.0, 0.0)


@takes
async def wave(scene: Scene, peak_m_s2: float, period_s: float, for_s: float) -> None:
    """The wind goes up and down, slowly."""
    for step in range(round(for_s / STEP_S)):
        down = peak_m_s2 * math.sin(2.0 * math.pi * step * STEP_S / period_s)
        scene.stage.wind.push = (0.0, 0.0, down)
        await asyncio.sleep(STEP_S)
    scene.stage.wind.push = (0.0, 0.0, 0.0)


def _aside(seed: int) -> Vec3:
    """Return the horizontal direction of the disturbances of ``seed``."""
    angle = math.atan2(0.6, 0.8) + seed * TURN_PER_SEED_RAD
    return math.cos(angle), math.sin(angle), 0.0


@takes
async def push_along(scene: Scene, where: str, peak_m_s2: float, duration_s: float) -> None:
    """Return a half sine of acceleration, "aside", "up" or "down"."""
    upright: dict[str, Vec3] = {"up": (0.0, 0.0, -1.0), "down": (0.0, 0.0, 1.0)}
    north, east, down = upright.get(where) or _aside(scene.seed)
    steps = round(duration_s / STEP_S)
    for step in range(1, steps):
        now = peak_m_s2 * math.sin(math.pi * step / steps)
        scene.stage.wind.push = (north * now, east * now, down * now)
        await asyncio.sleep(STEP_S)
    scene.stage.wind.push = (0.0, 0.0, 0.0)


@takes
async def step_wind(scene: Scene, step_m_s2: float) -> None:
    """Return a wind that steps sideways and stays."""
    north, east, _ = _aside(scene.seed)
    scene.stage.wind.push = (north * step_m_s2, east * step_m_s2, 0.0)


@takes
async def hang_on(scene: Scene, share: float) -> None:
    """Hang a share of the vehicle's weight onto it."""
    scene.stage.wind.push = (0.0, 0.0, share * scene.stage.world.gravity)


@takes
async def grasp(scene: Scene, for_s: float) -> None:
    """Hold the vehicle in its place by a stiff spring and a critical damper, free to turn, and let it go."""
    damping_per_s = 2.0 * math.sqrt(GRASP_PER_S2)
    place = scene.stage.plant.truth(scene.now_s).position_ned

    def pull(body: Body) -> Vec3:
        force = [
            GRASP_PER_S2 * (there - here) - damping_per_s * speed
            for there, here, speed in zip(place, body.position, body.velocity, strict=True)
        ]
        share = min(1.0, GRASP_MOST_M_S2 / max(math.hypot(*force), GRASP_MOST_M_S2))
        north, east, down = (share * one for one in force)
        return north, east, down

    scene.stage.plant.pull = pull
    await asyncio.sleep(for_s)
    scene.stage.plant.pull = None


@takes
async def tether(scene: Scene, slack_m: float) -> None:
    """A cable that trails behind the vehicle is caught on the floor below it, and lets it fly so far [m]."""
    x, y, z = scene.stage.plant.truth(scene.now_s).position_ned
    anchor: Vec3 = (x, y, scene.stage.world.floor_z_m)
    length = anchor[2] - z + slack_m

    def pull(body: Body) -> Vec3:
        gap = tuple(a - p for a, p in zip(anchor, body.position, strict=True))
        far = math.hypot(*gap)
        strain = TETHER_PER_S2 * max(far - length, 0.0) / max(far, length)
        return strain * gap[0], strain * gap[1], strain * gap[2]

    scene.stage.plant.pull = pull


@takes
async def cushion(scene: Scene, on_floor: float) -> None:
    """Near the floor the same rotors lift more, by that share on it, as the air under them can't get away."""
    floor, mass = scene.stage.world.floor_z_m, scene.stage.world.mass_kg

    def pull(body: Body) -> Vec3:
        more = on_floor / (1.0 + (floor - body.position[2]) / (2.0 * ROTOR_M)) ** 2 * body.thrust / mass
        x, y, z = so3.third_column(body.attitude)
        return -more * x, -more * y, -more * z

    scene.stage.plant.pull = pull


@takes
async def take_out(scene: Scene, speed_m_s: float) -> None:
    """An operator grips the vehicle, leads it down to the floor, and holds it there."""
    truth, floor = scene.stage.plant.truth(scene.now_s), scene.stage.world.floor_z_m
    roll, pitch, yaw = so3.euler_zyx(truth.attitude)
    begun_s, (x, y, z), drop = scene.now_s, truth.position_ned, floor - truth.position_ned[2]

    def at(t: float) -> tuple[Vec3, Quat]:
        closed = 1.0 - math.exp(-t / GRIP_S)  # its speed becomes the hand's
        keep, hand = 1.0 - closed, speed_m_s * (t - GRIP_S * closed)
        down = min(hand + GRIP_S * closed * truth.velocity_ned[2], drop)
        done = min(max(down / drop, 0.0), 1.0) if drop > 0.0 else 1.0
        lean = math.radians(LED_TILT_DEG) * closed * (1.0 - done)
        north = x + GRIP_S * closed * truth.velocity_ned[0] + 0.3 * done
        east = y + GRIP_S * closed * truth.velocity_ned[1]
        turn = so3.from_euler_zyx(keep * roll + lean * math.sin(2.0 * t), keep * pitch + lean, yaw)
        return (north, east, z + down if down < drop else floor), turn

    def lead(time_s: float, thrust: float) -> Body:
        t = time_s - begun_s
        (place, turn), (ahead, then) = at(t), at(t + STEP_S)
        u, v, w = ((q - p) / STEP_S for p, q in zip(place, ahead, strict=True))
        p, q, r = (angle / STEP_S for angle in so3.turn_between(turn, then))
        return Body(place, (u, v, w), turn, thrust, (p, q, r))

    scene.stage.plant.lead = lead


async def controller(scene: Scene) -> None:
    """The controller raises."""
    scene.controller_raises = True


async def recorder(scene: Scene) -> None:
    """The recorder raises."""
    scene.recorder_raises = True


async def terminate(scene: Scene) -> None:
    """SIGTERM."""
    request, _ = Interrupts().press("SIGTERM", scene.now_s)
    if request is not None:
        scene.flight.ask(request)


STATES = tuple(name for name in MOMENTS if name != "start")
FROM_START = ("start", *STATES)
ON_FLOOR = ("start", "ready", "arming", "spool-up")
FLYING = ("lift-off", "take-off", "hold", "tracking", "moving", "returning", "landing", "descent")
RADIO_STATES = ("spool-up", "lift-off", "take-off", "hold", "tracking", "descent")
"""Where a false pose over a radio meets something else than over MAVLink: nobody could land the vehicle."""
SEEN_IN_TIME = ("lift-off", "take-off", "hold", "tracking", "moving", "returning", "descent")
"""Where a coordinate that is frozen, or a position that comes late, is flown."""


BROKEN: dict[str, Fault] = {
    "freeze": Fault("frames go on, the picture stands still", shows(pictures.freeze), poses=Poses.GONE),
    "dropout": Fault("no more poses", dropout, poses=Poses.GONE, also={"dsm": STATES}),
    "teleport": Fault("the vehicle is seen 1 m away from where it is", shows(pictures.teleport, 1.0), poses=Poses.GONE),
    "yaw flip": Fault(
        "the vehicle is seen turned by 180°", shows(pictures.turn_axes, 0.0, 0.0, 180.0), poses=Poses.GONE
    ),
    "marker swap": Fault(
        "our body and another change names", shows(pictures.swap), overrides=("sim.other_bodies=1",), poses=Poses.GONE
    ),
    "duplicates": Fault("every datagram comes three times", comes(lambda: pictures.repeat(3)), obeys=True),
    "reorder": Fault("each second datagram overtakes the one before", comes(pictures.reorder), obeys=True),
    "clock step": Fault(
        "the trackers' clock leaps by 5 s", comes(lambda: pictures.shift_stamps(lambda: 5.0)), source="json", obeys=True
    ),
    "latency step": Fault("poses come 60 ms later than they did", comes_late(0.060, fresh=False)),
    "frame loss": Fault("70 % of the command frames get lost", lose_frames(0.7)),
    "link stall": Fault("for 1.5 s nothing passes on the link", cut(1.5)),
    "serial unplug": Fault("the radio module's plug is out", unplug, link="dsm", exemption=Exemption.NO_LINK),
    "autopilot reboot": Fault("the autopilot restarts in flight", reboot(2.0), exemption=Exemption.NO_MOTORS),
    "mode stolen": Fault("a pilot takes over by the remote control, and lands", steal, silences=True),
    "motors: 70 %": Fault("the rotors give 70 % of their thrust", weaken(0.7), obeys=True),
    "battery sag": Fault("within 6 s the battery is empty, and thrust falls to 75 %", sag(0.75, 6.0), obeys=True),
    "one way silent: telemetry": Fault(
        "for 4 s nothing comes that the autopilot says; it hears all", cut(4.0, hears=True), obeys=True
    ),
    "one way silent: uplink": Fault(
        "for 4 s the autopilot hears nothing; all that it says comes", cut(4.0, speaks=True)
    ),
    "one way silent: answers": Fault("no answer to TIMESYNC comes any more, and all else passes", keep_answers),
    "wind, up and down": Fault(
        "for 12.5 s the wind pushes up and down by 1.5 m/s², once in 5 s",
        wave(1.5, 5.0, 12.5),
        obeys=True,
        states=("take-off", "hold", "tracking", "moving", "returning", "landing"),
    ),
    "gust": Fault("for 1.5 s the wind pushes with 3.7 m/s² more", push(GUST_M_S2, 1.5), obeys=True),
    "controller exception": Fault("the controller raises", controller),
    "recorder failure": Fault("the recorder raises", recorder),
    "SIGTERM": Fault("the process is told to end", terminate),
}
"""Something breaks, and shows it."""

MIRRORED = {"x": "north is south", "y": "east is west", "z": "up is down"}
"""Meaning of each mirrored coordinate."""


def _mirror(name: str) -> tuple[Vec3, ...]:
    """The matrix that gives the coordinate ``name`` the other sign."""
    north, east, down = (-1.0 if name == axis else 1.0 for axis in MIRRORED)
    return (north, 0.0, 0.0), (0.0, east, 0.0), (0.0, 0.0, down)


_LYING: dict[str, Fault] = {
    "frozen: but for a nanometre": Fault(
        "frames go on, the picture stands still but for a nanometre", shows(pictures.flicker)
    ),
    "frozen": Fault("frames go on, the picture stands still but for noise of 0.3 mm and 2 mrad", shows(pictures.still)),
    "position frozen": Fault("the position alone stands still, with noise", shows(pictures.still_position)),
    **{
        f"position frozen: {name}": Fault(
            f"the position's {axis} alone stands still, with noise",
            shows(pictures.still_coordinate, number),
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
    "position frozen: north-west": Fault(
        "the position stands still along north-west alone, with noise",
        shows(pictures.still_along, 1.0, -1.0),
        states=("start", *SEEN_IN_TIME),
    ),
    "attitude frozen": Fault("the attitude alone stands still, with noise", shows(pictures.still_attitude)),
    "body at rest": Fault(
        "the poses are those of a body beside it that rests", shows(pictures.resting), states=FROM_START
    ),
    **{
        f"body at rest: {what}": Fault(
            f"the poses are those of a body beside it that rests, and {says}",
            shows(pictures.resting),
            overrides=(override,),
            states=ON_FLOOR,
        )
        for what, says, override in (
            ("thrust +25 %", "the rotors give 25 % more than told", "sim.thrust_gain=1.25"),
            ("mass told +25 %", "the mass is told 25 % too large", "vehicle.mass_kg=0.1"),
        )
    },
    "body carried": Fault(
        "the poses are those of a body beside it that is carried around at 0.5 m/s",
        shows(pictures.carry),
        states=FROM_START,
    ),
    "partner": Fault(
        "the poses are those of a vehicle beside it that flies the same course: told the same, in other air",
        partner((0.05, -0.03, 0.02)),
        exemption=Exemption.NOT_OBSERVABLE,
        states=FROM_START,
    ),
    **{
        f"drift: {speed:g} m/s": Fault(
            f"the position drifts away at {speed:g} m/s",
            shows(pictures.drift, speed),
            exemption=Exemption.NOT_OBSERVABLE,
        )
        for speed in (0.1, 0.3)
    },
    **{
        f"mirrored: {name}": Fault(
            f"the position's {axis}", shows(pictures.map_positions, _mirror(name)), states=FROM_START
        )
        for name, axis in MIRRORED.items()
    },
    **{
        f"few poses lie: {name} mirrored": Fault(
            f"of four frames only one comes, and its {MIRRORED[name]}",
            shows_few(4, pictures.map_positions, _mirror(name)),
        )
        for name in "xz"
    },
    "few poses lie: position frozen": Fault(
        "of four frames only one comes, and its position stands", shows_few(4, pictures.still_position)
    ),
    "few poses lie: x mirrored, one in ten": Fault(
        f"of ten frames only one comes, and its {MIRRORED['x']}", shows_few(10, pictures.map_positions, _mirror("x"))
    ),
    "few poses lie: position frozen, one in ten": Fault(
        "of ten frames only one comes, and its position stands", shows_few(10, pictures.still_position)
    ),
    **{
        f"frozen in turns: {name}": Fault(
            f"for one second its {what} stands, for one it is true, and so on",
            shows_in_turns(1.0, *picture),
            poses=Poses.FALSE,
            states=FLYING,
        )
        for name, what, *picture in (
            ("z", "height", pictures.still_coordinate, 2),
            ("position", "position", pictures.still_position),
        )
    },
    **{
        f"position frozen: {name}, long hold": Fault(
            f"in a hold of half a minute {what} stands", strike, states=("hold",), overrides=LONG_HOLD
        )
        for name, what, strike in (
            ("x", "north", shows(pictures.still_coordinate, 0)),
            ("z", "the height", shows(pictures.still_coordinate, 2)),
            ("position", "the position", shows(pictures.still_position)),
        )
    },
    "frozen by and by: x": Fault(
        "north goes from the true one to one that stands within four seconds",
        shows(pictures.fading_coordinate, 0, 4.0),
    ),
    "frozen by and by: z": Fault(
        "the height goes from the true one to one that stands within four seconds",
        shows(pictures.fading_coordinate, 2, 4.0),
    ),
    "height sinks": Fault(
        "the height sinks at 0.5 m/s beside the true one for 0.8 s, and then stands",
        shows(pictures.sinking_height, 0.5, 0.8),
        states=("hold", "landing"),
    ),
    "swapped": Fault(
        "the position's north and east have changed places",
        shows(pictures.map_positions, ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))),
        states=FROM_START,
    ),
    "tilt axes: swapped": Fault(
        "roll is seen as pitch, and pitch as roll",
        shows(pictures.mix_angles, lambda roll, pitch: (pitch, roll)),
        states=FROM_START,
    ),
    "tilt axes: roll mirrored": Fault(
        "roll has the wrong sign", shows(pictures.mix_angles, lambda roll, pitch: (-roll, pitch)), states=FROM_START
    ),
    "tilt axes: pitch mirrored": Fault(
        "pitch has the wrong sign", shows(pictures.mix_angles, lambda roll, pitch: (roll, -pitch)), states=FROM_START
    ),
    "yaw off: 14°": Fault(
        "the vehicle is seen turned by 14°", shows(pictures.turn_axes, 0.0, 0.0, 14.0), states=FROM_START
    ),
    "yaw off: 90°": Fault(
        "the vehicle is seen turned by 90°", shows(pictures.turn_axes, 0.0, 0.0, 90.0), states=FROM_START
    ),
    "yaw off: 180°": Fault(
        "the vehicle is seen turned by 180° from the beginning; later this is *yaw flip*",
        shows(pictures.turn_axes, 0.0, 0.0, 180.0),
        states=("start",),
    ),
    "yaw turning": Fault("the vehicle is seen to turn at 20°/s more than it does", shows(pictures.turning, 20.0)),
    "tilt off": Fault(
        "the vehicle is seen to lean by 14° more than it does",
        shows(pictures.turn_axes, 14.0, 0.0, 0.0),
        states=FROM_START,
    ),
    "unit: m for mm": Fault(
        "positions are a thousandth of what they are", shows(pictures.scale_positions, 1e-3), states=FROM_START
    ),
    **{
        f"scaled: {share:g}": Fault(
            f"positions go only {share:g} of the way that the vehicle goes",
            shows(pictures.scale_positions, share),
            states=states,
        )
        for share, states in (
            (0.1, ("take-off", "hold", "tracking", "moving", "descent")),
            (0.3, ("take-off", "tracking", "moving", "descent")),
        )
    },
    "unit: mm for m": Fault(
        "positions are a thousand times what they are", shows(pictures.scale_positions, 1e3), states=FROM_START
    ),
}
LYING = {name: fault._replace(poses=Poses.FALSE) for name, fault in _LYING.items()}
"""Poses look as if they were of our vehicle, and are not."""

LATE: dict[str, Fault] = {
    **{
        f"late: {ms} ms": Fault(
            f"poses come {ms} ms later than they did; their numbers tell", comes_late(1e-3 * ms, fresh=False)
        )
        for ms in (100, 200, 400)
    },
    **{
        f"late: {ms} ms, fresh stamps": Fault(
            f"poses come {ms} ms later than they did, with stamps as if they did not",
            comes_late(1e-3 * ms, fresh=True),
            source="json",
            poses=Poses.FALSE,
        )
        for ms in (100, 200, 400)
    },
    "position late": Fault(
        "the position comes 300 ms later than the attitude, both with fresh stamps",
        shows(pictures.late_position, 0.3),
        poses=Poses.FALSE,
        states=SEEN_IN_TIME,
    ),
    "position smoothed": Fault(
        "the position is smoothed with a time constant of 1 s, the attitude is not",
        shows(pictures.smoothed_position, 1.0),
        poses=Poses.FALSE,
        states=SEEN_IN_TIME,
    ),
    "stands for moments: again and again": Fault(
        "for 0.25 s of each second the picture stands still but for noise",
        shows(pictures.now_and_again, 0.25, 1.0),
        poses=Poses.FALSE,
        states=FLYING,
    ),
    "stands for moments: once": Fault(
        "for 0.3 s the picture stands still but for noise, then it is true again",
        shows(pictures.now_and_again, 0.3, math.inf),
        poses=Poses.FALSE,
        states=FLYING,
    ),
    "later and later: numbers tell": Fault(
        "poses come later by 50 ms more each second, up to 400 ms; their numbers tell",
        comes_late(grow(0.05, 0.4), fresh=False),
    ),
    "later and later: fresh stamps": Fault(
        "poses come later by 50 ms more each second, up to 400 ms, with stamps as if they did not",
        comes_late(grow(0.05, 0.4), fresh=True),
        source="json",
        poses=Poses.FALSE,
    ),
    "few frames: every 8th": Fault("of eight frames only one comes: 6.3 a second", comes(lambda: pictures.every(8))),
    "few frames: every 11th": Fault("of eleven frames only one comes: 4.5 a second", comes(lambda: pictures.every(11))),
    **{
        f"stamps off: {ms} ms": Fault(f"stamps jitter by {ms} ms (1 sigma)", jitter_stamps(1e-3 * ms), source="json")
        for ms in (1, 2, 5)
    },
}
"""Poses are true, but not when they say, or not when they are needed."""

_OBEYING: dict[str, Fault] = {
    **{
        f"{what} wrong: {sign}{share} %": Fault(
            f"{says} by {share} % {how}",
            nothing,
            also={"dsm": ("start",)},
            overrides=(f"{key}={value:g}",),
            states=("start",),
        )
        for what, says, key, one in (
            ("mass told", "the mass is told wrong,", "vehicle.mass_kg", 0.08),
            ("thrust told", "the rotors give another thrust than told,", "sim.thrust_gain", 1.0),
        )
        for sign, how, share, value in (
            ("+", "too much", 30, 1.3 * one),
            ("-", "too little", 30, 0.7 * one),
        )
    },
    "motors: 130 %": Fault("the rotors give 130 % of their thrust", weaken(1.3)),
    "load dropped": Fault("a third of the weight falls off", push((0.0, 0.0, -3.2)), states=FLYING),
    "gust: 25 Hz": Fault(
        "by 25 poses a second: for 1.5 s the wind pushes with 3.7 m/s² more",
        push(GUST_M_S2, 1.5),
        overrides=("sim.pose_rate_hz=25", "pose.rate_hz=25"),
        states=FLYING,
    ),
    "ground effect": Fault(
        "on the floor the same rotors lift 25 % more than far from it, 10 cm above it 6 %",
        cushion(0.25),
        states=("start", "landing", "descent"),
    ),
    "taken out of the air": Fault(
        "an operator grips the vehicle, leads it down to the floor at 0.5 m/s, and holds it there",
        take_out(0.5),
        states=FLYING,
    ),
    "estimator reset": Fault(
        "poses are the autopilot's own, whose heading goes astray by 19° within 3 s; its estimator then finds the true "
        "one, and says so",
        lead_astray(19.0, 3.0),
        source="odometry",
    ),
    "wandering estimate": Fault(
        "poses are the autopilot's own, and wander: a random walk of 5 cm (1 sigma) in 2 s, and one turn by 19°",
        nothing,
        source="odometry",
        overrides=("sim.estimate_wander_m=0.05", "sim.estimate_yaw_step_deg=19"),
        states=("start",),
    ),
    "late floor": Fault(
        "the floor holds the vehicle for 0.6 s while it gathers speed",
        nothing,
        overrides=("sim.floor_hold_s=0.6",),
        states=("start",),
    ),
    "late floor: own estimate": Fault(
        "the same, and poses are the autopilot's own, which feels that it rises",
        nothing,
        source="odometry",
        overrides=("sim.floor_hold_s=0.6",),
        states=("start",),
    ),
    "wireless": Fault("poses come up to 60 ms late, each otherwise; their numbers tell", scatter(0.06)),
}
OBEYING = {name: fault._replace(obeys=True) for name, fault in _OBEYING.items()}
"""Nothing is wrong with the poses, and whoever convicts them is wrong."""

HONEST_STATES = ("take-off", "hold", "tracking", "landing")
"""Where honest disturbances strike."""
PUSHES_M_S2 = (2, 4, 6, 8, 10)
"""Peaks of a hand's sideways push [m/s²]."""
LIFTS_M_S2 = (4, 6)
"""Peaks of a hand's push up and down [m/s²]."""
WIND_STEPS_M_S2 = (2, 3, 4, 5, 8)
"""Accelerations by which the wind steps [m/s²]."""
FLIES_ON_M_S2 = 6
"""A push sideways or down up to this peak must not end a mission [m/s²]."""
STEP_FLIES_ON_M_S2 = 5
"""A wind step up to this acceleration must not end a mission [m/s²]."""
HONEST_HOLD = ("takeoff.hold_s=12",)
"""``--set`` of a hold that lasts longer than an honest flight is looked at."""
ALL_HONEST: dict[str, tuple[str, ...]] = {"dsm": HONEST_STATES}
"""Further links of honest disturbances, and their states there."""


def _flies_on(must: bool) -> tuple[str, ...]:
    return HONEST_STATES if must else ()


_HONEST: dict[str, Fault] = {
    **{
        f"push: {peak} for {duration:g} s": Fault(
            f"a hand pushes sideways for {duration:g} s, with {peak} m/s² at most",
            push_along("aside", peak, duration),
            states=("spool-up", *FLYING) if (peak, duration) == (4, 1.0) else HONEST_STATES,
            flies_on=_flies_on(peak <= FLIES_ON_M_S2),
        )
        for duration in (1.0, 0.4)
        for peak in PUSHES_M_S2
    },
    **{
        f"push: {where} {peak} for 1 s": Fault(
            f"a hand pushes {where} for 1 s, with {peak} m/s² at most",
            push_along(where, peak, 1.0),
            states=HONEST_STATES,
            flies_on=_flies_on(where == "down" or peak < FLIES_ON_M_S2),
        )
        for peak in LIFTS_M_S2
        for where in ("up", "down")
    },
    **{
        f"wind step: {step}": Fault(
            f"the wind steps sideways by {step} m/s² and stays",
            step_wind(step),
            states=HONEST_STATES,
            flies_on=_flies_on(step <= STEP_FLIES_ON_M_S2),
        )
        for step in WIND_STEPS_M_S2
    },
    "tether": Fault(
        "a cable on the floor is caught: 0.3 m farther it pulls like a spring",
        tether(0.3),
        states=("spool-up", *FLYING),
        flies_on=("hold", "tracking", "landing"),  # a climb ends at the cable's length
    ),
    "cable picked up": Fault(
        "10 % of the weight is picked up, and hangs on from then on",
        hang_on(0.1),
        states=HONEST_STATES,
        flies_on=HONEST_STATES,
    ),
    "hand holds": Fault(
        "a hand holds the vehicle in its place for 2 s, free to turn",
        grasp(2.0),
        states=HONEST_STATES,
    ),
}
HONEST = {name: fault._replace(obeys=True, also=ALL_HONEST) for name, fault in _HONEST.items()}
"""Disturbances that poses show truly: no doubt may end such a flight without its poses."""

NOT_BY_RADIO = (
    ("position frozen: x", "start"),
    ("position frozen: x", "spool-up"),
    ("position frozen: x", "hold"),
    ("position late", "hold"),
    ("stands for moments: again and again", "hold"),
)
"""Cells that are flown over MAVLink only."""
BY_RADIO = (
    "frozen: but for a nanometre",
    "frozen",
    "position frozen",
    "position frozen: x",
    "position frozen: z",
    "attitude frozen",
    "body at rest",
    "body carried",
    "mirrored: x",
    "mirrored: z",
    "tilt axes: swapped",
    "yaw off: 90°",
    "scaled: 0.1",
    "scaled: 0.3",
    "unit: m for mm",
    "position late",
    "stands for moments: again and again",
    "later and later: fresh stamps",
    "few frames: every 11th",
)
"""Cases that are flown behind a radio, too."""


def _also_by_radio(name: str, fault: Fault) -> Fault:
    """Return ``fault`` with the states that it is flown in behind a radio."""
    if name not in BY_RADIO:
        return fault
    states = tuple(
        state
        for state in ("start", *RADIO_STATES)
        if state in (fault.states or STATES) and (name, state) not in NOT_BY_RADIO
    )
    return fault._replace(also={"dsm": states})


FAMILIES: tuple[tuple[str, Kind, tuple[str, ...]], ...] = (
    ("frozen", Kind.REQUIRED, ("frozen",)),
    ("position frozen", Kind.REQUIRED, ("position frozen",)),
    ("attitude frozen", Kind.REQUIRED, ("attitude frozen",)),
    ("another body", Kind.REQUIRED, ("body at rest", "body carried")),
    ("mirrored", Kind.REQUIRED, ("mirrored",)),
    ("swapped", Kind.REQUIRED, ("swapped",)),
    ("yaw", Kind.REQUIRED, ("yaw off", "yaw turning")),
    ("tilt", Kind.REQUIRED, ("tilt axes", "tilt off")),
    ("late", Kind.REQUIRED, ("late", "later and later", "position late")),
    ("unit", Kind.REQUIRED, ("unit",)),
    ("lost", Kind.REQUIRED, ("freeze", "dropout")),
    ("jumping", Kind.REQUIRED, ("teleport", "yaw flip", "marker swap")),
    ("fading", Kind.KNOWN_LIMIT, ("frozen by and by", "height sinks")),
    ("in turns", Kind.KNOWN_LIMIT, ("frozen in turns", "stands for moments")),
    ("few poses lie", Kind.KNOWN_LIMIT, ("few poses lie",)),
    ("scaled", Kind.KNOWN_LIMIT, ("scaled",)),
    ("smoothed", Kind.KNOWN_LIMIT, ("position smoothed",)),
    ("pushes", Kind.HONEST, ("push",)),
    ("wind steps", Kind.HONEST, ("wind step",)),
    ("cable, tether, hand", Kind.HONEST, ("tether", "cable picked up", "hand holds")),
    ("not observable", Kind.OTHER, ("partner", "drift")),
    (
        "timing of true poses",
        Kind.OTHER,
        ("duplicates", "reorder", "clock step", "latency step", "few frames", "stamps off", "wireless"),
    ),
    (
        "vehicle and air",
        Kind.OTHER,
        (
            "motors",
            "battery sag",
            "wind, up and down",
            "gust",
            "mass told wrong",
            "thrust told wrong",
            "load dropped",
            "ground effect",
            "taken out of the air",
            "late floor",
        ),
    ),
    ("own estimate", Kind.OTHER, ("estimator reset", "wandering estimate")),
    (
        "link and autopilot",
        Kind.OTHER,
        (
            "frame loss",
            "link stall",
            "serial unplug",
            "autopilot reboot",
            "mode stolen",
            "one way silent",
        ),
    ),
    (
        "programs",
        Kind.OTHER,
        ("controller exception", "recorder failure", "SIGTERM"),
    ),
)
"""Families that the summary counts by: name, how their rows are judged, and their faults."""
LATE_LIFT_OFF = "late radio, lift-off"
"""Family of poses that come late while a vehicle behind a radio lifts off: a known limit."""
LIFTING = ("start", "spool-up", "lift-off", "take-off")
"""States before and in a climb."""
_FAMILY_OF = {name: (family, kind) for family, kind, faults in FAMILIES for name in faults}


CASES: dict[str, Fault] = {}
"""Every case by its name: the fault, and behind a colon the value that it is flown with."""
for _name, _fault in (BROKEN | LYING | LATE | OBEYING | HONEST).items():
    _family, _kind = _FAMILY_OF[name_of(_name)]
    CASES[_name] = _also_by_radio(_name, _fault)._replace(family=_family, kind=_kind)


def find_fault(case: str, state: str, link: str) -> Fault:
    """Return the fault called ``case`` as it is flown in ``state`` on ``link``."""
    fault = CASES[case]
    if fault.family == "late" and link != "mavlink" and state in LIFTING:
        fault = fault._replace(family=LATE_LIFT_OFF, kind=Kind.KNOWN_LIMIT)
    if fault.kind is Kind.HONEST and state == "hold":
        fault = fault._replace(overrides=(*fault.overrides, *HONEST_HOLD))
    return fault._replace(link=link)


FAULTS: dict[str, tuple[str, ...]] = {
    name: tuple(case for case in CASES if name_of(case) == name) for name in dict.fromkeys(map(name_of, CASES))
}
"""Cases of each fault, by its name."""
