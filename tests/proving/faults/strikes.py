"""How the faults strike: what each changes in the simulated side of a flight, or in the station."""

import asyncio
import math
from collections.abc import Callable

import msgspec

from groundstation.core.geometry import Quat, Vec3, so3
from groundstation.core.mission import Interrupts
from sim.autopilots import Px4Autopilot
from sim.world import Body, Wind, rows, stream
from tests.proving.faults.fault import Scene, Strike
from tests.proving.faults.pictures import WIFI_S, Picture, Struck, Way, jitter, late

GUST_M_S2, GUST_S = (3.0, 2.0, 1.0), 1.5
"""A gust, as the acceleration that it gives, and how long it lasts."""
SAG_SHARE, SAG_S, SAG_STEP_S = 0.75, 6.0, 0.1
"""What a battery that collapses leaves of the thrust, and how fast."""
FULL_V, EMPTY_V = 3.9, 3.1
LOST_FRAMES = 0.7
"""Share of the command frames that get lost on a bad radio."""
STALL_S = 1.5
"""How long nothing passes either way on a link that stalls [s]."""
REBOOT_S = 2.0
"""How long an autopilot takes to restart [s]."""
PUSH_M_S2, PUSH_S = 4.0, 1.0
"""A hand that pushes: the most that it accelerates the vehicle, and for how long."""
STEP_S = 0.01
"""How finely a hand's motion is told [s]."""
SLACK_M, TETHER_PER_S2 = 0.3, 40.0
"""A cable that is caught on the floor: how much farther it lets the vehicle, and how stiff it is for its mass: 3.2 N/m
at 80 g."""
ROTOR_M, CUSHION = 0.05, 0.25
"""Near the floor the rotors give more: by this share on the floor, falling with the height over twice their radius."""
LED_M_S, LED_TILT_DEG, GRIP_S = 0.5, 20.0, 0.3
"""An operator takes the vehicle out of the air: how fast a hand leads it down, how far it leans, and how long it takes
to close."""

RESET_DEG, ASTRAY_S, ASTRAY_STEP_S = 19.0, 3.0, 0.01
"""A heading that an estimator corrects [deg]: PX4 was seen to do so. How long it goes astray [s], in what steps."""
ELSEWHERE_M_S2 = (0.05, -0.03, 0.02)
"""How much another wind a partner feels that flies beside ours."""


def shows(make: Callable[[Struck], Picture]) -> Strike:
    """A wrong picture."""

    async def strike(scene: Scene) -> None:
        scene.between.picture = make(scene.struck)

    return strike


def comes(make: Callable[[], Way]) -> Strike:
    """Frames that come otherwise."""

    async def strike(scene: Scene) -> None:
        scene.between.way = make()

    return strike


def comes_late(delay_s: float | Callable[[float], float], *, fresh: bool) -> Strike:
    """Frames that come so much later [s], or by a function of the time since."""

    async def strike(scene: Scene) -> None:
        of = delay_s if callable(delay_s) else lambda since_s: delay_s
        scene.between.way = late(of, 1.0 / scene.stage.world.pose_rate_hz, fresh=fresh)

    return strike


def jitter_stamps(sigma_s: float) -> Strike:
    """Stamps that jitter."""

    async def strike(scene: Scene) -> None:
        scene.between.way = jitter(sigma_s, scene.normals)

    return strike


async def wifi(scene: Scene) -> None:
    """Poses come over a wireless network: none is lost or overtakes another, each is up to 60 ms late."""
    normals = scene.normals

    def delay_s(_: float) -> float:
        return WIFI_S * min(abs(next(normals)[0]) / 3.0, 1.0)

    scene.between.way = late(delay_s, 1.0 / scene.stage.world.pose_rate_hz, fresh=False)


async def partner(scene: Scene) -> None:
    """The cameras take a partner for ours: as its own station sees the same of it, it is told the same."""
    stage = scene.stage
    assert stage.mocap is not None, "the deck flies with cameras"
    x, y, z = stage.world.wind_mean
    north, east, down = ELSEWHERE_M_S2
    world = msgspec.structs.replace(stage.world, wind_mean=(x + north, y + east, z + down))
    other = stage.plant.twin(scene.now_s, world, Wind(world, rows(stream(0, "partner").standard_normal, 3)))
    stage.plant.partner = other
    stage.mocap.see(other)


async def reset(scene: Scene) -> None:
    """The heading of the autopilot's estimator goes astray; it finds that, turns it to what is true, and says so."""
    vehicle, steps = scene.stage.vehicle, round(ASTRAY_S / ASTRAY_STEP_S)
    for step in range(1, steps + 1):
        vehicle.lead_heading_astray(RESET_DEG * step / steps)
        await asyncio.sleep(ASTRAY_STEP_S)
    vehicle.reset_heading()


async def nothing(scene: Scene) -> None:
    """What is wrong has been so from the beginning."""


async def dropout(scene: Scene) -> None:
    """The cameras are covered."""
    assert scene.stage.mocap is not None, "the deck flies with cameras"
    scene.stage.mocap.cover(True)


async def frame_loss(scene: Scene) -> None:
    """Command frames get lost."""
    scene.stage.frame_loss = LOST_FRAMES


async def stall(scene: Scene) -> None:
    """The link passes nothing for a while."""
    scene.stage.peer.cut(True)
    await asyncio.sleep(STALL_S)
    scene.stage.peer.cut(False)


async def unplug(scene: Scene) -> None:
    """The radio module is pulled out."""
    scene.stage.port.cut = True


async def reboot(scene: Scene) -> None:
    """The autopilot restarts."""
    scene.stage.peer.reboot(REBOOT_S)


async def steal(scene: Scene) -> None:
    """A pilot takes over."""
    autopilot = scene.stage.autopilot
    assert isinstance(autopilot, Px4Autopilot), "the deck flies with a PX4"
    autopilot.take_over(scene.now_s)


def weaken(share: float) -> Strike:
    """The rotors give another share of their thrust."""

    async def strike(scene: Scene) -> None:
        scene.stage.plant.weaken(scene.now_s, share)

    return strike


async def sag(scene: Scene) -> None:
    """The battery collapses."""
    steps = round(SAG_S / SAG_STEP_S)
    for step in range(1, steps + 1):
        share = 1.0 - step / steps
        scene.stage.plant.weaken(scene.now_s, SAG_SHARE + (1.0 - SAG_SHARE) * share)
        scene.stage.autopilot.battery = EMPTY_V + (FULL_V - EMPTY_V) * share, share
        await asyncio.sleep(SAG_STEP_S)


async def gust(scene: Scene) -> None:
    """The wind pushes harder for a while."""
    scene.stage.wind.push = GUST_M_S2
    await asyncio.sleep(GUST_S)
    scene.stage.wind.push = (0.0, 0.0, 0.0)


async def push(scene: Scene) -> None:
    """A hand pushes the vehicle sideways: softly at first, and softly at last."""
    steps = round(PUSH_S / STEP_S)
    for step in range(1, steps):
        share = PUSH_M_S2 * math.sin(math.pi * step / steps)
        scene.stage.wind.push = (0.8 * share, 0.6 * share, 0.0)
        await asyncio.sleep(STEP_S)
    scene.stage.wind.push = (0.0, 0.0, 0.0)


async def tether(scene: Scene) -> None:
    """A cable that trails behind the vehicle is caught on the floor below it."""
    x, y, z = scene.stage.plant.truth(scene.now_s).position_ned
    anchor: Vec3 = (x, y, scene.stage.world.floor_z_m)
    length = anchor[2] - z + SLACK_M

    def pull(body: Body) -> Vec3:
        gap = tuple(a - p for a, p in zip(anchor, body.position, strict=True))
        far = math.hypot(*gap)
        strain = TETHER_PER_S2 * max(far - length, 0.0) / max(far, length)
        return strain * gap[0], strain * gap[1], strain * gap[2]

    scene.stage.plant.pull = pull


async def cushion(scene: Scene) -> None:
    """Near the floor the same rotors lift more, as the air under them can't get away."""
    floor, mass = scene.stage.world.floor_z_m, scene.stage.world.mass_kg

    def pull(body: Body) -> Vec3:
        more = CUSHION / (1.0 + (floor - body.position[2]) / (2.0 * ROTOR_M)) ** 2 * body.thrust / mass
        x, y, z = so3.third_column(body.attitude)
        return -more * x, -more * y, -more * z

    scene.stage.plant.pull = pull


async def take_out(scene: Scene) -> None:
    """An operator grips the vehicle, leads it down to the floor, and holds it there."""
    truth, floor = scene.stage.plant.truth(scene.now_s), scene.stage.world.floor_z_m
    roll, pitch, yaw = so3.euler_zyx(truth.attitude)
    begun_s, (x, y, z), drop = scene.now_s, truth.position_ned, floor - truth.position_ned[2]

    def at(t: float) -> tuple[Vec3, Quat]:
        closed = 1.0 - math.exp(-t / GRIP_S)  # its speed becomes the hand's
        keep, hand = 1.0 - closed, LED_M_S * (t - GRIP_S * closed)
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
        p, q, r = (angle / STEP_S for angle in so3.rotation_vector(so3.multiply(so3.conjugate(turn), then)))
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
