"""The faults by name: how each strikes, and the states and links that it is flown on.

Every one is flown in every state, but where it makes no difference or can't happen: a wrong mass is
there from the *start*; a vehicle that stands can't be pushed; ground effect matters near the floor
alone; a coordinate that stands still strikes where it is seen in time.
"""

import asyncio
import math
from collections.abc import Callable, Coroutine
from typing import Any, Concatenate, ParamSpec

import msgspec

from groundstation.core.geometry import Quat, Vec3, so3
from groundstation.core.mission import Interrupts
from sim.autopilots import Px4Autopilot
from sim.world import Body, Wind, World, normals
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
"""Time between the steps of a battery's collapse [s]."""
GUST_M_S2 = (3.0, 2.0, 1.0)
"""Acceleration by a gust, NED [m/s²]."""
TURN_PER_SEED_RAD = math.radians(137.5)
"""Angle from one seed's disturbances to the next one's: no two of some seeds are alike [rad]."""
GRASP_PER_S2 = 400.0
"""Stiffness of a hand, for the vehicle's mass [1/s²]."""
STEP_S = 0.01
"""Step of what moves a vehicle, or its heading, little by little [s]."""
TETHER_PER_S2 = 40.0
"""Stiffness of a cable per mass [1/s²]: 3.2 N/m at 80 g."""
LED_TILT_DEG = 20.0
"""Tilt of a vehicle in the hand that takes it out of the air [deg]."""
GRIP_S = 0.3
"""Time constant of that hand's grip [s]."""

LONG_HOLD = ("takeoff.hold_s=30",)
"""``--set`` of a hold that lasts."""

P = ParamSpec("P")


def takes(act: Callable[Concatenate[Scene, P], Coroutine[Any, Any, None]]) -> Callable[P, Strike]:
    """Make strikes of ``act``, which takes more than the scene: the table has what more."""

    def make(*told: P.args, **named: P.kwargs) -> Strike:
        return lambda scene: act(scene, *told, **named)

    return make


@takes
async def shows(scene: Scene, make: Callable[..., Picture], *told: Any) -> None:
    """A wrong picture, made of what was shown last and of what it is ``told``."""
    scene.between.picture = make(scene.struck, *told)


@takes
async def comes(scene: Scene, make: Callable[..., Way], *told: Any) -> None:
    """Frames that come otherwise."""
    scene.between.way = make(*told)


@takes
async def shows_few(scene: Scene, nth: int, make: Callable[..., Picture], *told: Any) -> None:
    """A wrong picture, of which only every ``nth`` frame comes."""
    scene.between.picture, scene.between.way = make(scene.struck, *told), pictures.every(nth)


@takes
async def shows_in_turns(
    scene: Scene, turn_s: float, make: Callable[..., Picture], *told: Any
) -> None:
    """A picture that is by turns wrong and true, for so long each [s]."""
    while True:
        scene.between.picture = make(scene.struck, *told)
        await asyncio.sleep(turn_s)
        scene.between.picture = None
        await asyncio.sleep(turn_s)


@takes
async def comes_late(
    scene: Scene, delay_s: float | Callable[[float], float], *, fresh: bool
) -> None:
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
    """Poses over a wireless network: each is up to so much late [s], and none overtakes another."""
    period_s = 1.0 / scene.stage.world.pose_rate_hz
    scene.between.way = late(
        lambda _: most_s * min(abs(next(scene.normals)[0]) / 3.0, 1.0), period_s, fresh=False
    )


@takes
async def partner(scene: Scene, more_m_s2: Vec3) -> None:
    """The cameras take for ours a partner, told the same, which the air pushes more [m/s²]."""
    stage = scene.stage
    assert stage.mocap is not None, "the deck flies with cameras"
    x, y, z = stage.world.wind_mean
    north, east, down = more_m_s2
    world = msgspec.structs.replace(stage.world, wind_mean=(x + north, y + east, z + down))
    other = stage.plant.twin(scene.now_s, world, Wind(world, normals(0, "partner", 3)))
    stage.plant.partner = other
    stage.mocap.see(other)


@takes
async def lead_astray(scene: Scene, heading_deg: float, within_s: float) -> None:
    """The heading of the autopilot's estimator goes astray, and is then reset to the true one."""
    vehicle, steps = scene.stage.vehicle, round(within_s / STEP_S)
    for step in range(1, steps + 1):
        vehicle.disturb_heading(heading_deg * step / steps)
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
    """The autopilot does not answer TIMESYNC any more, and does all else."""
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
        scene.stage.autopilot.battery_share = share
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
    """A push whose acceleration is a half sine, "aside", "up" or "down"."""
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
    """A wind that steps sideways and stays."""
    north, east, _ = _aside(scene.seed)
    scene.stage.wind.push = (north * step_m_s2, east * step_m_s2, 0.0)


@takes
async def grasp(scene: Scene, for_s: float) -> None:
    """Hold the vehicle in its place by a spring and a critical damper, and let it go."""
    damping_per_s = 2.0 * math.sqrt(GRASP_PER_S2)
    place = scene.stage.plant.truth(scene.now_s).position_ned

    def pull(body: Body) -> Vec3:
        north, east, down = (
            GRASP_PER_S2 * (there - here) - damping_per_s * speed
            for there, here, speed in zip(place, body.position, body.velocity, strict=True)
        )
        return north, east, down

    scene.stage.plant.pull = pull
    await asyncio.sleep(for_s)
    scene.stage.plant.pull = None


@takes
async def tether(scene: Scene, slack_m: float) -> None:
    """A cable behind the vehicle is caught on the floor below it, and lets it fly so far [m]."""
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
    """Near the floor the same rotors lift more, by that share on it."""
    world = scene.stage.world
    floor, mass, radius = world.floor_z_m, world.mass_kg, world.rotor_radius_m

    def pull(body: Body) -> Vec3:
        radii = 1.0 + (floor - body.position[2]) / (2.0 * radius)
        more = on_floor / radii**2 * body.thrust / mass
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
"""Where a false pose has other effects over a radio, whose vehicle nobody else could land."""
SEEN_IN_TIME = ("lift-off", "take-off", "hold", "tracking", "moving", "returning", "descent")
"""Where a coordinate that is frozen, or a position that comes late, is flown."""
DOWN_FROZEN = ("start", "ready", "arming", "spool-up", "take-off", "returning")
"""Where a frozen height is flown."""

BROKEN: dict[str, Fault] = {
    "freeze": Fault(shows(pictures.freeze), poses=Poses.GONE),
    "dropout": Fault(dropout, poses=Poses.GONE, also={"dsm": STATES}),
    "teleport": Fault(shows(pictures.teleport, 1.0), poses=Poses.GONE),
    "yaw flip": Fault(shows(pictures.turn_axes, 0.0, 0.0, 180.0), poses=Poses.GONE),
    "marker swap": Fault(shows(pictures.swap), overrides=("sim.other_bodies=1",), poses=Poses.GONE),
    "duplicates": Fault(comes(pictures.repeat, 3), obeys=True),
    "reorder": Fault(comes(pictures.reorder), obeys=True),
    "clock step": Fault(comes(pictures.shift_stamps, lambda: 5.0), source="json", obeys=True),
    "latency step": Fault(comes_late(0.060, fresh=False)),
    "frame loss": Fault(lose_frames(0.7)),
    "link stall": Fault(cut(1.5)),
    "serial unplug": Fault(unplug, link="dsm", exemption=Exemption.NO_LINK),
    "autopilot reboot": Fault(reboot(2.0), exemption=Exemption.NO_MOTORS),
    "mode stolen": Fault(steal, silences=True),
    "motors: 70 %": Fault(weaken(0.7), obeys=True),
    "battery sag": Fault(sag(0.75, 6.0), obeys=True),
    "one way silent: telemetry": Fault(cut(4.0, hears=True), obeys=True),
    "one way silent: uplink": Fault(cut(4.0, speaks=True)),
    "one way silent: answers": Fault(keep_answers),
    "wind, up and down": Fault(
        wave(1.5, 5.0, 12.5),
        obeys=True,
        states=("take-off", "hold", "tracking", "moving", "returning", "landing"),
    ),
    "gust": Fault(push(GUST_M_S2, 1.5), obeys=True),
    "controller exception": Fault(controller),
    "recorder failure": Fault(recorder),
    "SIGTERM": Fault(terminate),
}
"""Something breaks, and shows it."""

MIRROR: dict[str, tuple[Vec3, Vec3, Vec3]] = {
    "x": ((-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    "y": ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)),
    "z": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)),
    "north is east": ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
}
"""Matrices that give one coordinate the other sign, or swap two."""


def lie(make: Callable[..., Picture], *told: Any, **fault: Any) -> Fault:
    """Return the fault of cameras that show a wrong picture; ``fault`` are its other fields."""
    return Fault(shows(make, *told), **fault)


_LYING: dict[str, Fault] = {
    "frozen: but for a nanometre": lie(pictures.freeze, 1e-9),
    "frozen": lie(pictures.still),
    "position frozen": lie(pictures.still_position),
    "position frozen: x": lie(pictures.still_coordinate, 0, states=("start", *SEEN_IN_TIME)),
    "position frozen: y": lie(
        pictures.still_coordinate, 1, states=("start", "arming", *SEEN_IN_TIME)
    ),
    "position frozen: z": lie(pictures.still_coordinate, 2, states=DOWN_FROZEN),
    "position frozen: north-west": lie(
        pictures.still_along, 1.0, -1.0, states=("start", *SEEN_IN_TIME)
    ),
    "attitude frozen": lie(pictures.still_attitude),
    "body at rest": lie(pictures.resting, states=FROM_START),
    "body at rest: thrust +25 %": lie(
        pictures.resting, overrides=("sim.thrust_gain=1.25",), states=ON_FLOOR
    ),
    "body at rest: mass told +25 %": lie(
        pictures.resting, overrides=("vehicle.mass_kg=0.1",), states=ON_FLOOR
    ),
    "body carried": lie(pictures.carry, states=FROM_START),
    "partner": Fault(
        partner((0.05, -0.03, 0.02)), exemption=Exemption.NOT_OBSERVABLE, states=FROM_START
    ),
    "drift: 0.1 m/s": lie(pictures.drift, 0.1, exemption=Exemption.NOT_OBSERVABLE),
    "drift: 0.3 m/s": lie(pictures.drift, 0.3, exemption=Exemption.NOT_OBSERVABLE),
    "mirrored: x": lie(pictures.map_positions, MIRROR["x"], states=FROM_START),
    "mirrored: y": lie(pictures.map_positions, MIRROR["y"], states=FROM_START),
    "mirrored: z": lie(pictures.map_positions, MIRROR["z"], states=FROM_START),
    "few poses lie: x mirrored": Fault(shows_few(4, pictures.map_positions, MIRROR["x"])),
    "few poses lie: z mirrored": Fault(shows_few(4, pictures.map_positions, MIRROR["z"])),
    "few poses lie: position frozen": Fault(shows_few(4, pictures.still_position)),
    "few poses lie: x mirrored, one in ten": Fault(
        shows_few(10, pictures.map_positions, MIRROR["x"])
    ),
    "few poses lie: position frozen, one in ten": Fault(shows_few(10, pictures.still_position)),
    "frozen in turns: z": Fault(shows_in_turns(1.0, pictures.still_coordinate, 2), states=FLYING),
    "frozen in turns: position": Fault(shows_in_turns(1.0, pictures.still_position), states=FLYING),
    **{
        f"position frozen: {name}, long hold": lie(
            make, *told, states=("hold",), overrides=LONG_HOLD
        )
        for name, make, *told in (
            ("x", pictures.still_coordinate, 0),
            ("z", pictures.still_coordinate, 2),
            ("position", pictures.still_position),
        )
    },
    "frozen by and by: x": lie(pictures.fading_coordinate, 0, 4.0),
    "frozen by and by: z": lie(pictures.fading_coordinate, 2, 4.0),
    "height sinks": lie(pictures.sinking_height, 0.5, 0.8, states=("hold", "landing")),
    "swapped": lie(pictures.map_positions, MIRROR["north is east"], states=FROM_START),
    "tilt axes: swapped": lie(
        pictures.mix_angles, lambda roll, pitch: (pitch, roll), states=FROM_START
    ),
    "tilt axes: roll mirrored": lie(
        pictures.mix_angles, lambda roll, pitch: (-roll, pitch), states=FROM_START
    ),
    "tilt axes: pitch mirrored": lie(
        pictures.mix_angles, lambda roll, pitch: (roll, -pitch), states=FROM_START
    ),
    "yaw off: 14°": lie(pictures.turn_axes, 0.0, 0.0, 14.0, states=FROM_START),
    "yaw off: 90°": lie(pictures.turn_axes, 0.0, 0.0, 90.0, states=FROM_START),
    # In flight this one is *yaw flip*.
    "yaw off: 180°": lie(pictures.turn_axes, 0.0, 0.0, 180.0, states=("start",)),
    "yaw turning": lie(pictures.turning, 20.0),
    "tilt off": lie(pictures.turn_axes, 14.0, 0.0, 0.0, states=FROM_START),
    "unit: m for mm": lie(pictures.scale_positions, 1e-3, states=FROM_START),
    "scaled: 0.1": lie(
        pictures.scale_positions, 0.1, states=("take-off", "hold", "tracking", "moving", "descent")
    ),
    "scaled: 0.3": lie(
        pictures.scale_positions, 0.3, states=("take-off", "tracking", "moving", "descent")
    ),
    "unit: mm for m": lie(pictures.scale_positions, 1e3, states=FROM_START),
    "position late": lie(pictures.late_position, 0.3, states=SEEN_IN_TIME),
    "position smoothed": lie(pictures.smoothed_position, 1.0, states=SEEN_IN_TIME),
    "stands for moments: again and again": lie(pictures.now_and_again, 0.25, 1.0, states=FLYING),
    "stands for moments: once": lie(pictures.now_and_again, 0.3, math.inf, states=FLYING),
}
LYING = {name: fault._replace(poses=Poses.FALSE) for name, fault in _LYING.items()}
"""Poses look as if they were of our vehicle, and are not."""

LATE: dict[str, Fault] = {
    **{f"late: {ms} ms": Fault(comes_late(1e-3 * ms, fresh=False)) for ms in (100, 200, 400)},
    **{
        f"late: {ms} ms, fresh stamps": Fault(
            comes_late(1e-3 * ms, fresh=True), source="json", poses=Poses.FALSE
        )
        for ms in (100, 200, 400)
    },
    "later and later: numbers tell": Fault(comes_late(grow(0.05, 0.4), fresh=False)),
    "later and later: fresh stamps": Fault(
        comes_late(grow(0.05, 0.4), fresh=True), source="json", poses=Poses.FALSE
    ),
    "few frames: every 8th": Fault(comes(pictures.every, 8)),
    "few frames: every 11th": Fault(comes(pictures.every, 11)),
    **{f"stamps off: {ms} ms": Fault(jitter_stamps(1e-3 * ms), source="json") for ms in (1, 2, 5)},
}
"""Poses are true, but not when they say, or not when they are needed."""


def _wrong(override: str) -> Fault:
    """Return the fault of a vehicle that is another than configured, from the beginning."""
    return Fault(nothing, also={"dsm": ("start",)}, overrides=(override,), states=("start",))


_OBEYING: dict[str, Fault] = {
    "mass told wrong: +30 %": _wrong("vehicle.mass_kg=0.104"),
    "mass told wrong: -30 %": _wrong("vehicle.mass_kg=0.056"),
    "thrust told wrong: +30 %": _wrong("sim.thrust_gain=1.3"),
    "thrust told wrong: -30 %": _wrong("sim.thrust_gain=0.7"),
    "motors: 130 %": Fault(weaken(1.3)),
    "load dropped": Fault(push((0.0, 0.0, -3.2)), states=FLYING),  # a third of the weight
    "gust: 25 Hz": Fault(
        push(GUST_M_S2, 1.5), overrides=("sim.pose_rate_hz=25", "pose.rate_hz=25"), states=FLYING
    ),
    "ground effect": Fault(cushion(0.25), states=("start", "landing", "descent")),
    "taken out of the air": Fault(take_out(0.5), states=FLYING),
    "estimator reset": Fault(lead_astray(19.0, 3.0), source="odometry"),
    "wandering estimate": Fault(  # a random walk of 5 cm (1 sigma) in 2 s, and one turn
        nothing,
        source="odometry",
        overrides=("sim.estimate_wander_m=0.05", "sim.estimate_yaw_step_deg=19"),
        states=("start",),
    ),
    # The floor holds the vehicle while it gathers speed.
    "late floor": Fault(nothing, overrides=("sim.floor_hold_s=0.6",), states=("start",)),
    "late floor: own estimate": Fault(
        nothing, source="odometry", overrides=("sim.floor_hold_s=0.6",), states=("start",)
    ),
    "wireless": Fault(scatter(0.06)),
}
OBEYING = {name: fault._replace(obeys=True) for name, fault in _OBEYING.items()}
"""Nothing is wrong with the poses, and whoever convicts them is wrong."""

HONEST_STATES = ("take-off", "hold", "tracking", "landing")
"""Where honest disturbances strike."""
FLIES_ON_M_S2 = 6
"""A push sideways or down up to this peak must not end a mission [m/s²]."""
STEP_FLIES_ON_M_S2 = 5
"""A wind step up to this acceleration must not end a mission [m/s²]."""
HONEST_HOLD = ("takeoff.hold_s=12",)
"""``--set`` of a hold that lasts longer than an honest flight is looked at."""

# Numbers are peaks of a hand's push, and accelerations by which the wind steps [m/s²].
_HONEST: dict[str, Fault] = {
    **{
        f"push: {peak} for {duration:g} s": Fault(
            push_along("aside", peak, duration),
            states=("spool-up", *FLYING) if (peak, duration) == (4, 1.0) else HONEST_STATES,
            flies_on=HONEST_STATES if peak <= FLIES_ON_M_S2 else (),
        )
        for duration in (1.0, 0.4)
        for peak in (2, 4, 6, 8, 10)
    },
    **{
        f"push: {where} {peak} for 1 s": Fault(
            push_along(where, peak, 1.0),
            states=HONEST_STATES,
            flies_on=HONEST_STATES if where == "down" or peak < FLIES_ON_M_S2 else (),
        )
        for peak in (4, 6)
        for where in ("up", "down")
    },
    **{
        f"wind step: {step}": Fault(
            step_wind(step),
            states=HONEST_STATES,
            flies_on=HONEST_STATES if step <= STEP_FLIES_ON_M_S2 else (),
        )
        for step in (2, 3, 4, 5, 8)
    },
    "tether": Fault(
        tether(0.3),
        states=("spool-up", *FLYING),
        flies_on=("hold", "tracking", "landing"),  # a climb ends at the cable's length
    ),
    "cable picked up": Fault(
        push((0.0, 0.0, 0.1 * World().gravity)), states=HONEST_STATES, flies_on=HONEST_STATES
    ),
    "hand holds": Fault(grasp(2.0), states=HONEST_STATES),
}
HONEST = {
    name: fault._replace(obeys=True, also={"dsm": HONEST_STATES}) for name, fault in _HONEST.items()
}
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
    "frozen: but for a nanometre", "frozen", "position frozen", "position frozen: x",
    "position frozen: z", "attitude frozen", "body at rest", "body carried", "mirrored: x",
    "mirrored: z", "tilt axes: swapped", "yaw off: 90°", "scaled: 0.1", "scaled: 0.3",
    "unit: m for mm", "position late", "stands for moments: again and again",
    "later and later: fresh stamps", "few frames: every 11th",
)  # fmt: skip
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
    ("timing of true poses", Kind.OTHER, (
        "duplicates", "reorder", "clock step", "latency step", "few frames", "stamps off",
        "wireless",
    )),
    ("vehicle and air", Kind.OTHER, (
        "motors", "battery sag", "wind, up and down", "gust", "mass told wrong",
        "thrust told wrong", "load dropped", "ground effect", "taken out of the air", "late floor",
    )),
    ("own estimate", Kind.OTHER, ("estimator reset", "wandering estimate")),
    ("link and autopilot", Kind.OTHER, (
        "frame loss", "link stall", "serial unplug", "autopilot reboot", "mode stolen",
        "one way silent",
    )),
    ("programs", Kind.OTHER, ("controller exception", "recorder failure", "SIGTERM")),
)  # fmt: skip
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
    name: tuple(case for case in CASES if name_of(case) == name)
    for name in dict.fromkeys(map(name_of, CASES))
}
"""Cases of each fault, by its name."""
