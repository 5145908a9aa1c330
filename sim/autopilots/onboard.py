"""Real firmware on the simulated vehicle: one process in lockstep with the plant, whose rotors it
drives.

The firmware is a PX4 or an ArduPilot that the user has built; px4.py and ardupilot.py speak their
simulator interfaces. Time is the plant's: the process waits for each state of the vehicle, and the
plant waits for the motor outputs. The firmware's MAVLink datagrams pass between its own UDP port
and the network in memory.
"""

import asyncio
import errno
import math
import shutil
import socket
import tempfile
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from io import DEFAULT_BUFFER_SIZE
from pathlib import Path
from subprocess import DEVNULL, STDOUT, Popen
from typing import Any, NamedTuple, Self, TypeAlias

from groundstation.config import ConfigError
from groundstation.core.geometry import ZERO, Vec3, so3
from groundstation.machine import sleep_until
from sim.text import notice
from sim.world import FourRotors, Quadrotor, TrueState

LOOPBACK = "127.0.0.1"
"""Address on which firmware and simulator talk."""
Normals: TypeAlias = Iterator[tuple[float, ...]]
"""Rows of ten standard normal numbers."""
ANSWER_S = 0.002
"""Duration of one wait for an answer that may not come [s, wall clock]."""
PATIENCE_S = 60.0
"""Time without an answer after which a process counts as stopped [s, wall clock].

Chosen: three times the 20 s that PX4 took to start on a busy machine.
"""
LEGS_M_S2 = 40.0
"""Largest specific force that the IMU measures at a touchdown [m/s²].

Landing legs that yield by 8 mm stop a vehicle from 0.8 m/s within 20 ms: v²/(2 · 8 mm) = 40 m/s².
"""


class FirmwareParameter(NamedTuple):
    """One parameter of a parameter file."""

    name: str
    value: str
    reason: str


def read_parameters(name: str) -> list[FirmwareParameter]:
    """Read the lines ``NAME VALUE # reason`` of the parameter file ``name`` of this folder.

    Raises:
        ValueError: a line has no value, or no reason.
    """
    parameters = list[FirmwareParameter]()
    for line in Path(__file__).with_name(name).read_text("utf-8").splitlines():
        setting, _, reason = line.partition("#")
        if not setting.strip():
            continue
        words = setting.split()
        if len(words) != 2 or not reason.strip():
            raise ValueError(notice("firmware.no_reason", file=name, found=line))
        parameters.append(FirmwareParameter(words[0], words[1], reason.strip()))
    return parameters


def find_built(option: str, folder: Path, program: str, id: str) -> Path:
    """Return the path of ``program`` in the ``folder`` that the command's ``option`` names.

    Raises:
        ConfigError: it is not there; the sentence ``id`` says how it is built.
    """
    found = folder / program
    if not found.is_file():
        raise ConfigError(option, notice(id, path=found))
    return found.resolve()


MOST_AT_ONCE = 10
"""Limit of the instances of one firmware on this machine [-]: PX4 has ports for no more."""


def take_number(port: socket.socket, first: int) -> int:
    """Bind ``port`` to the first free port number from ``first`` on.

    Return the offset, this instance's number.

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
    raise OSError(
        errno.EADDRINUSE, str(notice("firmware.no_port", count=MOST_AT_ONCE, first=first))
    )


class Firmware(ABC):
    """One process of a firmware, which runs step by step; :meth:`close` ends it."""

    step_s: float
    """Length of a step [s]."""

    def __init__(self, folder: Path) -> None:
        """The process keeps its files in ``folder``."""
        self.folder = folder
        self.mavlink = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        """Our end of its MAVLink link on this machine."""
        self.mavlink.setblocking(False)
        self._theirs: tuple[str, int] | None = None
        """Address of its end; None before its first datagram."""
        self._process: Popen[bytes] | None = None

    @abstractmethod
    def step(self, truth: TrueState, specific_force: Vec3) -> FourRotors:
        """Run for :attr:`step_s` with this state of the vehicle.

        Return the motor outputs, in the plant's order.

        Raises:
            EOFError: the process has ended, or does not answer.
        """

    @abstractmethod
    def boot(self, truth: TrueState, specific_force: Vec3) -> None:
        """Start up at rest.

        Raises:
            EOFError: the process has ended, or does not answer.
        """

    def start(self, command: list[str], environment: Mapping[str, str]) -> None:
        """Run the program ``command`` in its folder."""
        with (self.folder / "firmware.log").open("ab") as log:
            self._process = Popen(  # noqa: S603  # the user has built it, and named it
                command,
                cwd=self.folder,
                env=dict(environment),
                stdin=DEVNULL,
                stdout=log,
                stderr=STDOUT,
            )

    @property
    def ended(self) -> bool:
        """Whether the process has ended by itself."""
        return self._process is not None and self._process.poll() is not None

    def say(self, datagram: bytes) -> None:
        """Send one datagram to its MAVLink port; dropped before its own first datagram."""
        if self._theirs is not None:
            self.mavlink.sendto(datagram, self._theirs)

    def say_all(self, datagrams: list[bytes]) -> None:
        """Send ``datagrams``; the firmware takes them before its next step ends."""
        for datagram in datagrams:
            self.say(datagram)

    def hear(self) -> list[bytes]:
        """Return the datagrams that the firmware has sent since the last call."""
        heard = list[bytes]()
        while True:
            try:
                data, self._theirs = self.mavlink.recvfrom(DEFAULT_BUFFER_SIZE)
            except (BlockingIOError, ConnectionRefusedError):
                return heard
            heard.append(data)

    def close(self) -> None:
        """End the process; a second call does nothing."""
        self.mavlink.close()
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None


Make = Callable[[Path, Normals], Firmware]
"""Makes a firmware for a folder of its own, with rows of standard normal numbers for the noise of
its sensors."""


class OnboardFirmware(asyncio.DatagramProtocol):
    """A firmware as the autopilot of one simulated vehicle, with a MAVLink link to a ground
    station.
    """

    def __init__(self, plant: Quadrotor, firmware: Firmware, station: tuple[str, int]) -> None:
        """Boot ``firmware`` on ``plant``.

        The ground station listens at ``station`` on the network in memory.
        """
        self.firmware = firmware
        self._plant, self._station = plant, station
        self._received = list[bytes]()
        """Datagrams of the ground station for the firmware's next step."""
        self.on_motors: Callable[[float, FourRotors], None] | None = None
        """Called with the time [s] and the motor outputs (0..1) of each step."""
        self.passes: Callable[[bytes], bool] = lambda datagram: True
        """Tells whether a datagram of the ground station arrives; tests lose datagrams by it, also
        in flight."""
        self.overhear: Callable[[float, bytes], None] | None = None
        """Called with the time [s] and the bytes of every datagram of the ground station."""
        self._before, self._left_m_s = plant.truth(0.0), ZERO
        """State one step ago, and the change of velocity [m/s, NED] that the IMU has not measured
        yet."""
        at_rest = plant.specific_force
        self._gravity = math.hypot(*at_rest)
        firmware.boot(self._before, at_rest)

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """Take one datagram of the ground station (called by the event loop)."""
        if self.overhear is not None:
            self.overhear(asyncio.get_running_loop().time(), data)
        if self.passes(data):
            self._received.append(data)

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
        """Make one step of firmware and plant."""
        if self._received:
            self.firmware.say_all(self._received)
            self._received.clear()
        plant = self._plant
        truth = plant.truth(now_s)
        motors = self.firmware.step(truth, self._average_force(truth))
        plant.drive_rotors(now_s, motors)
        if self.on_motors is not None:
            self.on_motors(now_s, motors)

    def _average_force(self, truth: TrueState) -> Vec3:
        """Compute the mean specific force since the last step [m/s², FRD], as an IMU measures it.

        The plant's floor stops a vehicle within a step. Real landing legs yield: so the force is
        limited to ``LEGS_M_S2``, and the change of velocity beyond it is left for the next steps.
        """
        before, self._before = self._before, truth
        h = truth.time_s - before.time_s
        if h <= 0.0:
            return self._plant.specific_force
        gains = [
            v - u + w
            for u, v, w in zip(before.velocity_ned, truth.velocity_ned, self._left_m_s, strict=True)
        ]
        north, east, down = gains[0] / h, gains[1] / h, gains[2] / h - self._gravity
        share = min(1.0, LEGS_M_S2 / max(math.hypot(north, east, down), LEGS_M_S2))
        measured = share * north, share * east, share * down
        x, y, z = (gain - h * force for gain, force in zip(gains, measured, strict=True))
        self._left_m_s = x, y, z - h * self._gravity
        # In the body's axes at the middle of the step.
        (p, q, r), back = truth.rates_rad_s, -0.5 * h
        return so3.to_body(so3.rotate(truth.attitude, (back * p, back * q, back * r)), measured)


class Airworthy:
    """Boots firmware, each instance in a folder of its own.

    A context manager: at its end the folders are removed.
    """

    def __init__(self, make: Make, prepared: Path | None = None) -> None:
        """``prepared`` is a folder in which the firmware has run before, with its parameters.

        Each gets a copy.
        """
        self._make, self._prepared = make, prepared
        self._folder = tempfile.TemporaryDirectory(prefix="groundstation-firmware-")
        self._number = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._folder.cleanup()

    def fit(self, plant: Quadrotor, station: tuple[str, int], noise: Normals) -> OnboardFirmware:
        """Boot a firmware on ``plant``, in a new folder."""
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
