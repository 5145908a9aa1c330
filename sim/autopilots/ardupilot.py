"""ArduPilot's JSON interface: its SITL, unmodified, in lockstep with the simulation, on four
rotors.

SITL with ``--model JSON`` sends a packet of servo outputs (UDP, little-endian) and waits for the
state of the vehicle:

    0   uint16  18458: 16 outputs follow; 29569: 32
    2   uint16  frames a second that it wants
    4   uint32  number of the frame
    8   uint16  outputs [µs], 0 for none

The answer is one line of JSON, between two line feeds; the time stamp in it moves its clock on.
What noise its sensors have is its own.

Source: libraries/SITL/SIM_JSON.cpp of ArduPilot master, July 2025.
"""

import json
import os
import socket
import struct
from pathlib import Path
from typing import Any, NamedTuple

from groundstation.core.geometry import Vec3
from sim.autopilots.onboard import (
    LOOPBACK,
    PATIENCE_S,
    Firmware,
    Make,
    Normals,
    find_built,
    read_parameters,
    take_number,
)
from sim.text import notice
from sim.world import FourRotors, TrueState

PROGRAM = "build/sitl/bin/arducopter"
"""Program below the folder in which it was built."""
SERVO_PORT = 9102
"""First UDP port of servo outputs; instance n sends to this + n."""
BOOT_S = 12.0
"""Time from the first state to calibrated gyros and an aligned attitude [s]."""
LOW_US = 1000.0
"""Output of a rotor at rest (MOT_PWM_MIN) [µs]."""
HIGH_US = 2000.0
"""Output of a rotor at its fullest (MOT_PWM_MAX) [µs]."""
HOME = "47.397742,8.545594,488,0"
"""Home: latitude, longitude [deg], height [m], heading [deg]; the simulated compass takes its field
from there."""

_HEAD = struct.Struct("<HHI")
_COUNTS = {18458: 16, 29569: 32}
"""Magic number of a packet → its number of outputs, SIM_JSON.h."""


class Servos(NamedTuple):
    """One packet of servo outputs."""

    rate_hz: int
    frame: int
    pulses_us: tuple[int, ...]

    @property
    def motors(self) -> FourRotors:
        """Front right, rear left, front left, rear right, 0..1: the order of its frame X and of
        plant.py.
        """
        a, b, c, d = (
            min(max((us - LOW_US) / (HIGH_US - LOW_US), 0.0), 1.0) for us in self.pulses_us[:4]
        )
        return a, b, c, d


def read_servos(packet: bytes) -> Servos | None:
    """The outputs in ``packet``; None where it is none."""
    if len(packet) < _HEAD.size:
        return None
    magic, rate, frame = _HEAD.unpack_from(packet)
    count = _COUNTS.get(magic, 0)
    if not count or len(packet) != _HEAD.size + 2 * count:
        return None
    return Servos(rate, frame, struct.unpack_from(f"<{count}H", packet, _HEAD.size))


def write_state(time_s: float, truth: TrueState, specific_force: Vec3) -> bytes:
    """Encode one state: position and velocity [NED], attitude w, x, y, z (FRD to NED), rates and
    specific force [FRD].

    With "no_time_sync" the autopilot does not wait for real time.

    Raises:
        ValueError: a number is infinite, or none.
    """
    state = {
        "timestamp": time_s,
        "imu": {"gyro": truth.rates_rad_s, "accel_body": specific_force},
        "position": truth.position_ned,
        "quaternion": truth.attitude,
        "velocity": truth.velocity_ned,
        "no_time_sync": 1,
    }
    # Its reader looks for '"key":' and for "[a, b, c]": the separators are part of the format.
    return b"\n" + json.dumps(state, separators=(", ", ":"), allow_nan=False).encode() + b"\n"


def find_program(folder: Path) -> Path:
    """ArduCopter's program in ``folder``, where ``./waf copter`` has built it for the board
    ``sitl``.

    Raises:
        ConfigError: there is none.
    """
    return find_built("--ardupilot", folder, PROGRAM, "firmware.no_ardupilot")


class ArduCopter(Firmware):
    """One ArduCopter."""

    step_s = 0.001
    """ArduCopter needs gyro samples at 1.8 times its loop rate of 400 Hz, so at 720 Hz."""

    def __init__(self, program: Path, folder: Path) -> None:
        """``program``: see :func:`find_program`."""
        super().__init__(folder)
        self.mavlink.bind((LOOPBACK, 0))
        self._program = program
        self._wire = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._number = take_number(self._wire, SERVO_PORT)
        self._wire.settimeout(PATIENCE_S)
        self._simulator: Any = None
        self._count = 0

    def boot(self, truth: TrueState, specific_force: Vec3) -> None:
        """Start it, wait for its first outputs, and let it run at rest until it has started up."""
        lines = [f"{name} {value}\n" for name, value, _ in read_parameters("ardupilot.parm")]
        (self.folder / "ours.parm").write_text("".join(lines), "utf-8")
        words = [
            self._program,
            "--model",
            f"JSON:{LOOPBACK}",
            "--sim-port-out",
            self._wire.getsockname()[1],
        ]
        words += [
            "--serial0",
            f"udpclient:{LOOPBACK}:{self.mavlink.getsockname()[1]}",
            "--home",
            HOME,
        ]
        words += ["--defaults", "ours.parm", f"-I{self._number}"]
        self.start(
            [*map(str, words)],
            {name: os.environ[name] for name in ("PATH", "HOME") if name in os.environ},
        )
        self._await_servos()
        for _ in range(round(BOOT_S / self.step_s)):
            self.step(truth, specific_force)

    def step(self, truth: TrueState, specific_force: Vec3) -> FourRotors:
        """Send one state, and return the outputs that it answers with."""
        self._count += 1
        self._wire.sendto(
            write_state(self.step_s * self._count, truth, specific_force), self._simulator
        )
        return self._await_servos().motors

    def _await_servos(self) -> Servos:
        while True:
            try:
                packet, self._simulator = self._wire.recvfrom(256)
            except TimeoutError:
                raise EOFError(
                    notice("firmware.silent", name="ArduCopter", log=self.folder / "firmware.log")
                ) from None
            if (servos := read_servos(packet)) is not None:
                return servos

    def close(self) -> None:
        """Switch it off."""
        self._wire.close()
        super().close()


def make_ardupilot(folder: Path) -> Make:
    """Makes copies of the ArduCopter that was built in ``folder``."""
    program = find_program(folder)

    def make(place: Path, noise: Normals) -> Firmware:
        del noise  # its sensors have their own
        return ArduCopter(program, place)

    return make
