"""PX4's and ArduCopter's firmware in real time by ``groundstation fly``: ``groundstation-sim dev autopilots``.

Both simulate the vehicle themselves (SIH, SITL), and tell what it truly does: PX4 by HIL_STATE_QUATERNION, 25 times a
second, ArduPilot by SIM_STATE, to a centimetre. Somebody has built them from their sources: a folder of PX4-Autopilot
after ``make px4_sitl``, and one of ardupilot after ``./waf copter`` for the board ``sitl``. Each flight has an
autopilot of its own, freshly booted, with the parameters that ``groundstation doctor`` asks for.
"""

import argparse
import asyncio
import json
import math
import os
import signal
import sys
import tempfile
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from groundstation.analysis import FlightData
from groundstation.config import ConfigError, load
from groundstation.core.control import Gains
from groundstation.core.geometry import so3
from groundstation.core.messages import STEADY_S
from groundstation.core.mission import State
from groundstation.machine import replace_between_markers, split_at_markers
from groundstation.runtime import Exit
from groundstation.settings import Config
from links.io import make_child_command
from links.mavlink.protocol import MavCommand, MavlinkCodec
from sim.autopilots import FrameCutter, find_built
from tests.proving.onboard import fly_in_lockstep
from tests.proving.takeoff_start import TakeoffStart, describe_worst

EXAMPLES = Path(__file__).parents[2] / "examples"
FLIGHT_S = 240.0
"""No flight is waited for longer [s]."""
EARTH_M_DEG = 111_319.5
"""A degree of the great circle [m]."""
TRUTH_US = 10_000.0
"""Period of the requested truth [µs]."""


class Built(NamedTuple):
    """One firmware that was built, and how it is flown."""

    name: str
    example: str
    """The configuration that flies it."""
    folder: Path
    """Where it was built."""
    boots_s: float
    """Time from its start until it knows its position [s]."""
    link: str
    """The key that says where it is spoken to, and where that is: a format of its number on this machine."""
    truth_port: int
    """Where it tells the truth, less what its number adds."""
    ports: int
    """Number of ports that its number adds."""

    def port(self, number: int) -> int:
        """Where it is spoken to, or speaks to."""
        return (14540 if self.name == "PX4" else 5762) + self.ports * number

    def command(self, number: int) -> list[str]:
        """The program that runs, as the ``number``-th on this machine."""
        if self.name == "PX4":
            build = self.folder / "build" / "px4_sitl_default"
            words = [build / "bin" / "px4", "-i", str(number), "-d"]
            return [*map(str, words), "-s", str(build / "etc" / "init.d-posix" / "rcS"), "-w", ".", str(build / "etc")]
        defaults = self.folder / "Tools" / "autotest" / "default_params" / "copter.parm"
        program = self.folder / "build" / "sitl" / "bin" / "arducopter"
        return [str(program), "--model", "quad", "--speedup", "1", "--defaults", f"{defaults},ours.parm", f"-I{number}"]


PARAMETERS = {"GUID_OPTIONS": 8, "ATC_ANGLE_BOOST": 0, "GUID_TIMEOUT": 0.5, "FS_GCS_ENABLE": 5, "FS_GCS_TIMEOUT": 2,
              "MAV_GCS_SYSID": 245, "SYSID_MYGCS": 245}  # fmt: skip
"""Parameters of ArduPilot that `groundstation doctor` asks for."""
ENVIRONMENT = {
    "PX4_SIM_MODEL": "sihsim_quadx",
    **{f"PX4_PARAM_{k}": v for k, v in {"COM_RC_IN_MODE": "4", "COM_OF_LOSS_T": "0.4", "COM_OBL_RC_ACT": "4"}.items()},
}
"""And of PX4, which reads parameters from there."""


def find(name: str, folder: Path) -> Built:
    """The firmware that was built in ``folder``; raises ConfigError where there is none."""
    built = {
        "px4": Built("PX4", "px4-sitl.toml", folder, 25.0, "link.listen=127.0.0.1:{}", 19410, 1),
        "ardupilot": Built("ArduCopter", "ardupilot-sitl.toml", folder, 50.0, "link.tcp=127.0.0.1:{}", 5760, 10),
    }[name]
    find_built(f"--{name}", folder, str(Path(built.command(0)[0]).relative_to(folder)), "it was built")
    return built._replace(folder=folder.resolve())


class TruthReceiver(asyncio.DatagramProtocol):
    """Receiver of one simulator's truth; times are on the event loop's clock [s]."""

    def __init__(self) -> None:
        self.rows: list[tuple[float, ...]] = []
        """Time, place [m, NED, from where it stood], speed [m/s, NED], lean [deg]."""
        self._codec = MavlinkCodec(250, 1)
        self._home: tuple[float, float, float] | None = None

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """Take one frame (called by the event loop)."""
        for message in self._codec.feed(data):
            match message.get_type():
                case "HIL_STATE_QUATERNION":
                    where = 1e-7 * message.lat, 1e-7 * message.lon, 1e-3 * message.alt
                    speed = 0.01 * message.vx, 0.01 * message.vy, 0.01 * message.vz
                    w, x, y, z = message.attitude_quaternion
                case "SIM_STATE":
                    where = 1e-7 * message.lat_int, 1e-7 * message.lon_int, message.alt
                    speed = message.vn, message.ve, message.vd
                    w, x, y, z = message.q1, message.q2, message.q3, message.q4
                case _:
                    continue
            north, east, up = self._home = self._home or where
            across = EARTH_M_DEG * math.cos(math.radians(north))
            place = EARTH_M_DEG * (where[0] - north), across * (where[1] - east), up - where[2]
            lean = so3.angle_deg(so3.third_column((w, x, y, z))[2])
            self.rows.append((asyncio.get_running_loop().time(), *place, *speed, lean))

    async def hear_px4(self, port: int) -> None:
        """Receive PX4's truth, which it sends to ``port`` unasked."""
        transport, _ = await asyncio.get_running_loop().create_datagram_endpoint(
            lambda: self, local_addr=("127.0.0.1", port)
        )
        try:
            await asyncio.Event().wait()
        finally:
            transport.close()

    async def hear_ardupilot(self, port: int) -> None:
        """Receive ArduPilot's truth: it boots once connected at ``port``, and is asked for it."""
        cutter = FrameCutter(self.datagram_received)
        number = self._codec.dialect.MAVLINK_MSG_ID_SIM_STATE
        while True:
            with suppress(OSError):
                reader, writer = await asyncio.open_connection("127.0.0.1", port)
                try:
                    while data := await reader.read(4096):
                        cutter.feed(data)
                        if not self.rows:
                            writer.write(self._codec.command(1, 1, MavCommand.SET_MESSAGE_INTERVAL, number, TRUTH_US))
                finally:
                    writer.close()
            await asyncio.sleep(0.2)


@asynccontextmanager
async def boot(built: Built, number: int, folder: Path) -> AsyncIterator[TruthReceiver]:
    """The ``number``-th autopilot of this machine, in a ``folder`` of its own, once it knows where it is."""
    (folder / "ours.parm").write_text("".join(f"{name} {value}\n" for name, value in PARAMETERS.items()), "utf-8")
    truth, port = TruthReceiver(), built.truth_port + built.ports * number
    hears = asyncio.create_task(truth.hear_px4(port) if built.name == "PX4" else truth.hear_ardupilot(port))
    with (folder / "firmware.log").open("wb") as log:
        process = await asyncio.create_subprocess_exec(
            *built.command(number),
            cwd=folder,
            env=os.environ | ENVIRONMENT,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            start_new_session=True,
        )
        try:
            await asyncio.sleep(built.boots_s)
            yield truth
        finally:
            hears.cancel()
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            await process.wait()


class FirmwareFlight(NamedTuple):
    """One flight on real firmware."""

    landed: bool
    why: str
    """The last line that `fly` printed, or the last five where it did not land."""
    rms_cm: float | None
    """RMS error against the autopilot's own estimate over the steady part of the figure [cm]."""
    max_cm: float | None
    start: TakeoffStart
    """The first second after it left the floor, by the simulator's truth; of thrust what was commanded."""
    touchdown_m_s: float
    """Fastest that it sank through the last 10 cm."""
    lean_deg: float
    """Farthest that it leant, from the law's first command until the motors were off."""
    home_m: float
    """Distance from the place before the flight to the place after it [m]."""


class Flown(NamedTuple):
    """One flight that is over, and not looked at yet: that takes time, in which other flights' truth would wait."""

    folder: Path
    """Where its recording is."""
    truth: Any
    """The simulator's rows."""
    config: Config
    landed: bool
    why: str


async def fly(built: Built, number: int, words: Sequence[str], folder: Path) -> Flown:
    """Fly from the floor along ``words`` (``KEY=VALUE``), and down again; ``folder`` is its own."""
    vehicle = f"{built.name.lower()}{number}"
    told = [built.link.format(built.port(number)), f"vehicle.name={vehicle}", f"recording.folder={folder}", *words]
    if built.name == "PX4":
        told.append(f"link.target_system={number + 1}")
    overrides = [word for key in told for word in ("--set", key)]
    command = make_child_command("groundstation", "fly", str(EXAMPLES / built.example), "--arm", vehicle)
    async with boot(built, number, folder) as truth:
        process = await asyncio.create_subprocess_exec(
            *command, *overrides, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT
        )
        async with asyncio.timeout(FLIGHT_S):
            said, _ = await process.communicate()
        await asyncio.sleep(1.0)
    config = load(EXAMPLES / built.example, Config, told)
    lines = said.decode(errors="replace").strip().splitlines()
    why = " / ".join(lines[-1 if process.returncode == 0 else -5 :])
    return Flown(folder, np.array(truth.rows), config, process.returncode == 0, why)


def look(flown: Flown) -> FirmwareFlight:
    """Evaluate a flight by its recording and the simulator's rows."""
    folder, truth, config, landed, why = flown
    (recording,) = folder.glob("*.mcap")
    log, start = FlightData(recording), TakeoffStart()
    command, reference, seen = log["command"], log["reference"], log["measured"]
    if "time_s" not in command:  # it was never off the floor
        return FirmwareFlight(False, why, None, None, start, 0.0, 0.0, 0.0)

    def at(when: Any, rows: Any = truth) -> Any:
        return np.stack([np.interp(when, rows[:, 0], column) for column in rows[:, 1:].T], axis=-1)

    begun_s, over_s = command["time_s"][0], command["time_s"][-1]
    first = command["time_s"] <= begun_s + 1.0
    true = at(command["time_s"][first])
    told = np.column_stack([reference["time_s"], reference["position_ned"], reference["velocity_ned"]])
    start.thrust = (command["thrust_n"][first] / config.weight_n).tolist()
    start.climb = np.abs(true[:, 5] - at(command["time_s"][first], told)[:, 5]).tolist()
    start.tilt_deg = true[:, 6].tolist()
    adapted = log["adaptation"]
    b_hat = np.linalg.norm(adapted["b_hat_m_s2"], axis=1)[adapted["time_s"] <= begun_s + 1.0]
    assert isinstance(config.controller, Gains), "the examples fly ours"
    start.b = (b_hat / config.controller.b_bound).tolist()
    poses = seen["time_s"]
    states = list(zip(log["mission"]["time_s"], log["mission"]["state"], strict=True))
    since_s = next((time_s for time_s, state in states if state == State.TRACKING), math.inf) + STEADY_S
    until_s = next((time_s for time_s, state in states if state == State.RETURNING), over_s)
    steady = (poses >= since_s) & (poses <= until_s)
    errors = np.linalg.norm(seen["position_ned"][steady] - at(poses[steady], told)[:, :3], axis=1)
    low = (truth[:, 0] > over_s - 10.0) & (truth[:, 3] - truth[-1, 3] > -0.1)
    flying = (truth[:, 0] >= begun_s) & (truth[:, 0] <= over_s)
    return FirmwareFlight(
        landed,
        why,
        100.0 * math.sqrt(float(np.mean(errors**2))) if errors.size else None,
        100.0 * float(errors.max()) if errors.size else None,
        start,
        float(truth[low, 6].max()) if low.any() else 0.0,
        float(truth[flying, 7].max()),
        float(np.hypot(*(truth[-1, 1:3] - truth[0, 1:3]))),
    )


def eight(speed_m_s: float) -> tuple[str, ...]:
    """Return the settings of an eight of 1 m at ``speed_m_s``."""
    return ("trajectory.kind=lemniscate", "trajectory.scale_m=1.0", "trajectory.altitude_m=2.0",
            f"trajectory.speed_m_s={speed_m_s}", "flight.duration_s=60")  # fmt: skip


FIGURES: Mapping[str, tuple[str, ...]] = {
    "hover": ("flight.duration_s=60",),
    "eight, 0.5 m/s": eight(0.5),
    "eight, 1.0 m/s": eight(1.0),
}
MUSTS = {"PX4": (15.0, 15.0, 17.0), "ArduCopter": (0.4, 1.0, 2.0)}
"""RMS against its own estimate [cm]."""
FLOWN = 3
"""Number of flights of each: an estimate wanders otherwise from one flight to the next."""
SHORT = ("flight.duration_s=5",)


async def fly_all(builds: Sequence[Built], take_offs: int, workers: int) -> dict[str, Any]:
    """The figures, and so many take-offs, of each; ``workers`` autopilots at once."""
    free = list(range(workers))
    room = asyncio.Semaphore(workers)

    async def one(built: Built, words: Sequence[str]) -> Flown:
        async with room:
            number = free.pop()
            try:
                flown = await fly(built, number, words, Path(tempfile.mkdtemp(dir=home)))
            finally:
                free.append(number)
            print(f"{built.name}, {' '.join(words)}: {flown.why}", file=sys.stderr, flush=True)
            return flown

    figures = [words for words in FIGURES.values() for _ in range(FLOWN)]

    async def all_of(built: Built) -> list[Flown]:
        return await asyncio.gather(*(one(built, words) for words in (*figures, *[SHORT] * take_offs)))

    facts = dict[str, Any]()
    with tempfile.TemporaryDirectory(prefix="firmware-") as home:
        for built, flown in zip(builds, await asyncio.gather(*map(all_of, builds)), strict=True):
            flights = [look(each) for each in flown]
            by_name = {figure: flights[FLOWN * k :][:FLOWN] for k, figure in enumerate(FIGURES)}
            facts[built.name] = {"figures": by_name, "take_offs": flights[len(figures) :]}
    return facts


def autopilots(args: argparse.Namespace) -> Exit:
    """Fly, and print or write the tables."""
    builds = [find(name, folder) for name in ("px4", "ardupilot") if (folder := getattr(args, name)) is not None]
    if not builds:
        raise ConfigError("autopilots", "needs --px4 FOLDER or --ardupilot FOLDER, in which that firmware was built")
    if args.take_offs < 1:
        raise ConfigError("--take-offs", f"expected 1 or more, got {args.take_offs}")
    if args.lockstep:
        return fly_in_lockstep(args)
    if args.write is not None:
        split_at_markers(args.write, "autopilots")  # before minutes go by
    flown = asyncio.run(fly_all(builds, args.take_offs, args.workers or os.cpu_count() or 1))
    print(as_json(flown) if args.json else tables(flown))
    if args.write is not None:
        replace_between_markers(args.write, tables(flown), "autopilots")
    return Exit.DONE


def tables(facts: Mapping[str, Any]) -> str:
    """The facts as Markdown."""
    lines = [
        f"| flown, 100 poses a second of its own estimate | RMS cm, median of {FLOWN} (worst) | largest, cm | must |",
        "|---|---|---|---|",
    ]
    for name, flown in facts.items():
        for (figure, flights), must in zip(flown["figures"].items(), MUSTS[name], strict=True):
            rms = [flight.rms_cm for flight in flights if flight.rms_cm is not None]
            told = f"{median(rms):.2f} ({max(rms):.2f})" if rms else "–"
            lost = f", {len(flights) - len(rms)} lost" if len(rms) < len(flights) else ""
            largest = max((flight.max_cm for flight in flights if flight.max_cm is not None), default=math.nan)
            lines.append(f"| {name}, {figure} | {told}{lost} | {largest:.1f} | {must:g} |")
    lines += [
        "",
        "| from the floor and back | landed | within all limits at lift-off | thrust told, share of the weight "
        "| climb off by | tilt | b̂ of its bound | touchdown, median (worst) | leant at most, median (worst) |",
        "|---" * 9 + "|",
        "| must | all | all | 0.75 to 1.25 | 0.3 m/s | 8° | 0.5 | – | – |",
    ]
    for name, flown in facts.items():
        flights = flown["take_offs"]
        starts = [one.start for one in flights if one.start.thrust]
        sinks, leans = [one.touchdown_m_s for one in flights], [one.lean_deg for one in flights]
        landed = f"| {name} | {sum(one.landed for one in flights)} of {len(flights)} "
        if not starts:  # none left the floor
            lines.append(f"{landed}| 0 of {len(flights)} " + "| – " * 6 + "|")
            continue
        lines.append(
            f"{landed}| {sum(one.smooth for one in starts)} of {len(flights)} "
            f"{describe_worst(starts)}| {median(sinks):.2f} ({max(sinks):.2f}) m/s "
            f"| {median(leans):.0f} ({max(leans):.0f})° |"
        )
    return "\n".join(lines)


def as_json(facts: Mapping[str, Any]) -> str:
    """The facts as one JSON object."""

    def plain(flight: FirmwareFlight) -> dict[str, Any]:
        start = flight.start
        numbers = {key: getattr(start, key) for key in ("thrust", "climb", "tilt_deg", "b")}
        return flight._asdict() | {"smooth": start.smooth, "start": numbers}

    return json.dumps({
        name: {
            "figures": {figure: [*map(plain, flights)] for figure, flights in flown["figures"].items()},
            "take_offs": [plain(flight) for flight in flown["take_offs"]],
        }
        for name, flown in facts.items()
    })  # fmt: skip
