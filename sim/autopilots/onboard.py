"""Real firmware on the simulated vehicle: one process in lockstep with the plant, whose rotors it drives.

The firmware is a PX4 or an ArduPilot that somebody has built; px4.py and ardupilot.py speak their simulator interfaces.
Time is the plant's: the process waits for each state of the vehicle, and the plant for the motor outputs that come of
it. What the firmware says and hears over MAVLink passes between its own UDP port and the network in memory.
"""

import asyncio
import errno
import math
import shutil
import socket
import tempfile
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from subprocess import DEVNULL, STDOUT, Popen
from typing import Any, NamedTuple, Self, TypeAlias

from groundstation.config import ConfigError
from groundstation.core.geometry import ZERO, Vec3, so3
from groundstation.machine import sleep_until
from sim.world import FourRotors, Quadrotor, TrueState

LOOPBACK = "127.0.0.1"
Normals: TypeAlias = Iterator[tuple[float, ...]]
"""Rows of ten standard normal numbers."""
PATIENCE_S = 60.0
"""Time without an answer after which a process has stopped [s, wall clock]; on a busy machine PX4 took 20 to start."""
LIFTS = 0.2
"""Motor outputs above this share let go of a vehicle that is held; idling is below .1 [-]."""


LEGS_M_S2 = 40.0
"""Largest specific force as it meets the floor [m/s²]: from 0.8 m/s, legs that give by 8 mm stop it in 20 ms."""


class Told(NamedTuple):
    """One parameter of a parameter file."""

    name: str
    value: str
    reason: str


def read_parameters(name: str) -> list[Told]:
    """The lines ``NAME VALUE # reason`` of the parameter file ``name`` of this folder.

    Raises:
        ValueError: a line has no value, or no reason.
    """
    told = list[Told]()
    for line in Path(__file__).with_name(name).read_text("utf-8").splitlines():
        setting, _, reason = line.partition("#")
        if not setting.strip():
            continue
        words = setting.split()
        if len(words) != 2 or not reason.strip():
            raise ValueError(f"{name}: expected NAME VALUE # reason, got {line!r}")
        told.append(Told(words[0], words[1], reason.strip()))
    return told


def find_built(option: str, folder: Path, program: str, built_by: str) -> Path:
    """Return the ``program`` that ``built_by`` has built in the ``folder`` of the command's ``option``.

    Raises:
        ConfigError: there is none.
    """
    found = folder / program
    if not found.is_file():
        raise ConfigError(option, f"expected a folder in which {built_by}, but there is no {found}")
    return found.resolve()


MOST_AT_ONCE = 10
"""At most this many instances of one firmware run on this machine at once: PX4 has no ports for
more."""


def take_number(port: socket.socket, first: int) -> int:
    """Bind ``port`` to the first free one from ``first`` on; how much that is above it tells this process from others.

    Raises:
        OSError: all are taken.
    """
    for number in range(MOST_AT_ONCE):
        try:
            port.bind((LOOPBACK, first + number))
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise
        else:
            return number
    raise OSError(errno.EADDRINUSE, f"{MOST_AT_ONCE} of them run on this machine: ports from {first} on are taken")


class Firmware(ABC):
    """One process of a firmware, which goes on when it is told to; :meth:`close` ends it."""

    step_s: float
    """Period of the states of the vehicle [s]."""

    def __init__(self, folder: Path) -> None:
        """Its files are in ``folder``; its MAVLink port on this machine is :attr:`mavlink`."""
        self.folder = folder
        self.mavlink = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.mavlink.setblocking(False)
        self._theirs: tuple[str, int] | None = None
        self._process: Popen[bytes] | None = None

    @abstractmethod
    def step(self, truth: TrueState, specific_force: Vec3) -> FourRotors:
        """Let it run for :attr:`step_s`, with this state of the vehicle; its motor outputs, in the plant's order.

        Raises:
            EOFError: it has ended, or stands still.
        """

    @abstractmethod
    def boot(self, truth: TrueState, specific_force: Vec3) -> None:
        """Let it start up at rest; the same is raised."""

    def start(self, command: list[str], environment: Mapping[str, str]) -> None:
        """Run the program ``command`` in its folder."""
        with (self.folder / "firmware.log").open("ab") as log:
            self._process = Popen(  # noqa: S603  # somebody has built it, and named it
                command, cwd=self.folder, env=dict(environment), stdin=DEVNULL, stdout=log, stderr=STDOUT
            )

    @property
    def ended(self) -> bool:
        """Whether it has ended by itself."""
        return self._process is not None and self._process.poll() is not None

    def say(self, datagram: bytes) -> None:
        """Send one datagram to its MAVLink port; lost before it has spoken itself."""
        if self._theirs is not None:
            self.mavlink.sendto(datagram, self._theirs)

    def say_all(self, datagrams: list[bytes]) -> None:
        """Send ``datagrams``; it has taken them before its next step ends."""
        for datagram in datagrams:
            self.say(datagram)

    def hear(self) -> list[bytes]:
        """The datagrams that it has sent since the last time."""
        heard = list[bytes]()
        while True:
            try:
                data, self._theirs = self.mavlink.recvfrom(4096)
            except (BlockingIOError, ConnectionRefusedError):
                return heard
            heard.append(data)

    def close(self) -> None:
        """Switch it off; does nothing the second time."""
        self.mavlink.close()
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None


Make = Callable[[Path, Normals], Firmware]
"""Makes a firmware whose files are in a folder, with rows of standard normal numbers for the noise of its sensors."""


class OnboardFirmware(asyncio.DatagramProtocol):
    """A firmware as the autopilot of one vehicle with rotors, with a MAVLink link to a ground station."""

    def __init__(self, plant: Quadrotor, firmware: Firmware, station: tuple[str, int]) -> None:
        """Boot ``firmware`` on ``plant``; the ground station listens at ``station`` on the network in memory."""
        self.firmware = firmware
        self._plant, self._station = plant, station
        self._unheard = list[bytes]()
        self.on_motors: Callable[[float, FourRotors], None] | None = None
        """Sees the motor outputs (0..1) of each step, and when [s]."""
        self.passes: Callable[[bytes], bool] = lambda datagram: True
        """Whether a datagram from the ground station arrives; may be changed in flight."""
        self.overhear: Callable[[float, bytes], None] | None = None
        """Sees every datagram from the ground station as it comes, and when [s]."""
        self._before, self._unfelt_m_s = plant.truth(0.0), ZERO
        at_rest = plant.specific_force
        self._gravity = math.hypot(*at_rest)
        firmware.boot(self._before, at_rest)

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """Take what the ground station says (called by the event loop)."""
        if self.overhear is not None:
            self.overhear(asyncio.get_running_loop().time(), data)
        if self.passes(data):
            self._unheard.append(data)

    async def run(self) -> None:
        """Fly until cancelled."""
        loop = asyncio.get_running_loop()
        wire, _ = await loop.create_datagram_endpoint(lambda: self, remote_addr=self._station)
        due = loop.time()
        try:
            while True:
                self._fly(due)
                for datagram in self.firmware.hear():
                    wire.sendto(datagram)
                due += self.firmware.step_s
                await sleep_until(due)
        finally:
            wire.abort()
            self.firmware.close()

    def _fly(self, now_s: float) -> None:
        if self._unheard:
            self.firmware.say_all(self._unheard)
            self._unheard.clear()
        plant = self._plant
        truth = plant.truth(now_s)
        motors = self.firmware.step(truth, self._average_force(truth))
        if plant.released_s is None and sum(motors) > 4.0 * LIFTS:
            plant.release(now_s)
        plant.drive_rotors(now_s, motors)
        if self.on_motors is not None:
            self.on_motors(now_s, motors)

    def _average_force(self, truth: TrueState) -> Vec3:
        """Specific force since the step before [m/s², FRD], as an IMU averages it.

        The plant's floor stops a vehicle within a step; its legs give, so a jolt is felt over several.
        """
        before, self._before = self._before, truth
        h = truth.time_s - before.time_s
        if h <= 0.0:
            return self._plant.specific_force
        gains = [v - u + w for u, v, w in zip(before.velocity_ned, truth.velocity_ned, self._unfelt_m_s, strict=True)]
        north, east, down = gains[0] / h, gains[1] / h, gains[2] / h - self._gravity
        share = min(1.0, LEGS_M_S2 / max(math.hypot(north, east, down), LEGS_M_S2))
        felt = share * north, share * east, share * down
        x, y, z = (gain - h * force for gain, force in zip(gains, felt, strict=True))
        self._unfelt_m_s = x, y, z - h * self._gravity
        (p, q, r), back = truth.rates_rad_s, -0.5 * h
        return so3.to_body(so3.rotate(truth.attitude, (back * p, back * q, back * r)), felt)


class Airworthy:
    """Boots one firmware after another from a folder in which its parameters were set once. Use it in ``with``."""

    def __init__(self, make: Make, prepared: Path | None = None) -> None:
        """``prepared``: a folder that a firmware was run in before; each one gets a copy of it."""
        self._make, self._prepared = make, prepared
        self._folder = tempfile.TemporaryDirectory(prefix="groundstation-firmware-")
        self._number = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._folder.cleanup()

    def fit(self, plant: Quadrotor, station: tuple[str, int], noise: Normals) -> OnboardFirmware:
        """A firmware on ``plant``, booted."""
        self._number += 1
        folder = Path(self._folder.name) / f"{self._number}"
        if self._prepared is None:
            folder.mkdir()
        else:
            shutil.copytree(self._prepared, folder, symlinks=True)
        firmware = self._make(folder, noise)
        try:
            return OnboardFirmware(plant, firmware, station)
        except BaseException:
            firmware.close()
            raise
