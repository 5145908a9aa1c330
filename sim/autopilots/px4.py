"""PX4's simulator interface: its SITL, unmodified, in lockstep with the simulation, on four rotors.

PX4's module simulator_mavlink connects to TCP port 4560 + its number and speaks MAVLink there.
Each HIL_SENSOR sets its clock (time_usec) and moves it on. HIL_ACTUATOR_CONTROLS answers with the
motor outputs 0..1, and its time says for which of them. Where its outputs are not refreshed, as
while it is disarmed, no answer comes.

A thread of its own reads its MAVLink port, in the machine's time. So the plant waits until this
thread has taken what the ground station said: a TIMESYNC behind it has been answered.

Source: src/modules/simulation/simulator_mavlink/SimulatorMavlink.cpp of PX4 main, March 2026.
"""

import math
import os
import socket
import time
from collections.abc import Iterator
from enum import IntEnum, IntFlag
from pathlib import Path
from select import select
from typing import NamedTuple

from groundstation.core.geometry import Vec3, so3
from links.mavlink.protocol import ARMED, MavlinkCodec, MavlinkLinkConfig
from sim.autopilots.onboard import (
    ANSWER_S,
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

PROGRAM = "build/px4_sitl_default/bin/px4"
"""Program below the folder in which it was built."""
BOOT_S = 8.0
"""Its start script has ended, and its attitude is aligned, so long after the first HIL_SENSOR
[s]."""
BEGINS_US = 1_000_000
"""Time of the first HIL_SENSOR [µs]; PX4 takes 0 for no time."""
TAKEN_S = 0.1
"""Its MAVLink thread is waited for so long [s, of the wall clock]: in SET_MESSAGE_INTERVAL it
sleeps in the plant's time, and does not answer."""
BAROMETER_EVERY = 5
"""Steps between readings of the barometer [-]: 50 Hz."""
MAGNETOMETER_EVERY = 2
"""Steps between readings of the magnetometer [-]: 125 Hz."""

MAGNETOMETER = (0.02, 0.02, 0.03)
"""Noise of its magnetometer, 1σ [gauss]: SensorMagSim.cpp."""
BAROMETER_HPA = 0.01
"""Noise of its barometer, 1σ [hPa]: SensorBaroSim.cpp."""
FIELD_NED = (0.215, 0.012, 0.425)
"""Magnetic field of the place that PX4's simulators start at, Zürich [gauss]."""
SEA_LEVEL_HPA = 1013.25
"""Air pressure at sea level [hPa]."""
HPA_PER_M = 0.12
"""Fall of the pressure with height near the sea [hPa/m]."""
TEMPERATURE_DEG_C = 20.0
"""Temperature of the air [°C]."""

STATION = MavlinkLinkConfig()
"""Our station's MAVLink numbers, which the simulator speaks by: PX4 does not look at them."""


class Px4Port(IntEnum):
    """Ports that PX4 number 0 connects to; number n adds n."""

    SIMULATOR = 4560
    """TCP, for the simulator."""
    OFFBOARD = 14540
    """UDP, for MAVLink (px4-rc.mavlink)."""


class SensorFields(IntFlag):
    """HIL_SENSOR.fields_updated."""

    ACCELEROMETER = 0b111
    GYRO = 0b111 << 3
    MAGNETOMETER = 0b111 << 6
    BAROMETER = 0b1101 << 9
    """Pressure, height and temperature."""


class InertialNoise(NamedTuple):
    """Noise of its inertial sensors, 1σ: sih.cpp, reconstruct_sensors_signals."""

    accelerometer: Vec3
    """[m/s², FRD]"""
    gyro: Vec3
    """[rad/s, FRD]"""


FLYING = InertialNoise(accelerometer=(0.5, 1.7, 1.4), gyro=(0.14, 0.07, 0.03))
"""Noise with the rotors turning."""
RESTING = InertialNoise(accelerometer=(0.1, 0.1, 0.1), gyro=(0.01, 0.01, 0.01))
"""Noise with the rotors at rest."""


class Outputs(NamedTuple):
    """One HIL_ACTUATOR_CONTROLS."""

    time_us: int
    """Time on PX4's clock [µs]."""
    armed: bool
    motors: FourRotors
    """Front right, rear left, front left, rear right, 0..1: the order of the airframe and of
    plant.py."""


class SimulatorCodec:
    """Both messages on the wire. Sans-IO; no bytes make it raise."""

    def __init__(self) -> None:
        self._codec = MavlinkCodec(STATION.system_id, STATION.component_id)

    def pack_sensors(
        self,
        time_us: int,
        truth: TrueState,
        specific_force: Vec3,
        normals: tuple[float, ...],
        count: int,
    ) -> bytes:
        """HIL_SENSOR number ``count``, with ten standard ``normals`` for the noise of all
        sensors.
        """
        noise = FLYING if truth.thrust_n > 0.0 else RESTING
        x, y, z = _add_noise(specific_force, noise.accelerometer, normals[0:3])
        p, q, r = _add_noise(truth.rates_rad_s, noise.gyro, normals[3:6])
        north, east, down = _add_noise(
            so3.to_body(truth.attitude, FIELD_NED), MAGNETOMETER, normals[6:9]
        )
        height = -truth.position_ned[2]
        pressure = SEA_LEVEL_HPA - HPA_PER_M * height + BAROMETER_HPA * normals[9]
        fields = SensorFields.ACCELEROMETER | SensorFields.GYRO
        if count % MAGNETOMETER_EVERY == 0:
            fields |= SensorFields.MAGNETOMETER
        if count % BAROMETER_EVERY == 0:
            fields |= SensorFields.BAROMETER
        return self._codec.pack(
            self._codec.dialect.MAVLink_hil_sensor_message(
                time_us,
                x,
                y,
                z,
                p,
                q,
                r,
                north,
                east,
                down,
                pressure,
                0.0,
                height,
                TEMPERATURE_DEG_C,
                fields,
                0,
            )
        )

    def feed(self, data: bytes) -> Iterator[Outputs]:
        """The motor outputs in the next bytes of the stream."""
        for message in self._codec.feed(data):
            if message.get_type() == "HIL_ACTUATOR_CONTROLS":
                a, b, c, d = (_limit(one) for one in message.controls[:4])
                yield Outputs(message.time_usec, bool(message.mode & ARMED), (a, b, c, d))


def _add_noise(value: Vec3, sigma: Vec3, normals: tuple[float, ...]) -> Vec3:
    x, y, z = (
        one + noise * normal for one, noise, normal in zip(value, sigma, normals, strict=True)
    )
    return x, y, z


def _limit(output: float) -> float:
    """An output as a rotor takes it; one that is no number turns nothing."""
    return min(max(output, 0.0), 1.0) if math.isfinite(output) else 0.0


def find_program(folder: Path) -> Path:
    """PX4's program in ``folder``, where ``make px4_sitl`` has built it.

    Raises:
        ConfigError: there is none.
    """
    return find_built("--px4", folder, PROGRAM, "firmware.no_px4")


class Px4(Firmware):
    """One PX4."""

    step_s = 0.004
    """PX4's simulators give its IMU 250 times a second (IMU_INTEG_RATE of rcS)."""

    def __init__(self, program: Path, folder: Path, noise: Normals) -> None:
        """``program``: see :func:`find_program`."""
        super().__init__(folder)
        self._number = take_number(self.mavlink, Px4Port.OFFBOARD)
        self._program, self._noise = program, noise
        self._codec = SimulatorCodec()
        self._port = MavlinkCodec(STATION.system_id, STATION.component_id)
        self._wire: socket.socket | None = None
        self._count = 0
        self._outputs = Outputs(0, False, (0.0, 0.0, 0.0, 0.0))
        self._asked = self._answered = 0
        self._unread = list[bytes]()

    def boot(self, truth: TrueState, specific_force: Vec3) -> None:
        """Start it, take its connection, and let it run at rest until it has started up."""
        build = self._program.parents[1]
        told = {f"PX4_PARAM_{name}": value for name, value, _ in read_parameters("px4.params")}
        # Its start script counts it by the number of the process.
        told["PX4_PARAM_MAV_SYS_ID"] = "1"
        # Of its airframes the one that wants this interface, and nothing else of it is left as it
        # is.
        kept = {name: os.environ[name] for name in ("PATH", "HOME") if name in os.environ}
        words = [
            self._program,
            "-i",
            self._number,
            "-d",
            "-s",
            build / "etc" / "init.d-posix" / "rcS",
            "-w",
            ".",
        ]
        with socket.create_server((LOOPBACK, Px4Port.SIMULATOR + self._number)) as listener:
            listener.settimeout(PATIENCE_S)
            self.start(
                [*map(str, words), str(build / "etc")],
                {**kept, **told, "PX4_SIM_MODEL": "none_iris"},
            )
            try:
                self._wire, _ = listener.accept()
            except TimeoutError:
                raise EOFError(
                    notice("firmware.not_connected", name="PX4", log=self.folder / "firmware.log")
                ) from None
        self._wire.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for _ in range(round(BOOT_S / self.step_s)):
            began = time.monotonic()
            self.step(truth, specific_force)
            # Its start script is a program that runs in real time.
            time.sleep(max(0.0, 0.5 * self.step_s - (time.monotonic() - began)))

    def step(self, truth: TrueState, specific_force: Vec3) -> FourRotors:
        """One HIL_SENSOR, and the outputs that come of it."""
        assert self._wire is not None, "it has booted"
        now_us = BEGINS_US + round(1e6 * self.step_s * self._count)
        message = self._codec.pack_sensors(
            now_us, truth, specific_force, next(self._noise), self._count
        )
        self._count += 1
        try:
            self._wire.sendall(message)
            self._wait(now_us)
        except (BrokenPipeError, ConnectionResetError):
            raise EOFError(notice("firmware.ended", name="PX4")) from None
        return self._outputs.motors

    def _wait(self, now_us: int) -> None:
        """Take outputs until those of ``now_us`` have come; disarmed, there may be none."""
        assert self._wire is not None
        until = time.monotonic() + (PATIENCE_S if self._outputs.armed else ANSWER_S)
        while self._outputs.time_us < now_us:
            ready, _, _ = select([self._wire], [], [], max(0.0, until - time.monotonic()))
            if not ready:
                if self._outputs.armed:
                    raise EOFError(notice("firmware.stands", name="PX4"))
                return
            data = self._wire.recv(65536)
            if not data:
                raise ConnectionResetError
            for outputs in self._codec.feed(data):
                self._outputs = outputs

    def say_all(self, datagrams: list[bytes]) -> None:
        """Send them, and wait for the answer to a TIMESYNC behind them.

        Where none comes, its thread waits for the plant's time itself.
        """
        super().say_all(datagrams)
        if self._theirs is None:
            return
        self._asked += 1
        question_ns = -self._asked  # the ground station's own are not negative
        self.mavlink.sendto(self._port.timesync_question(question_ns), self._theirs)
        until = time.monotonic() + TAKEN_S
        while self._answered < self._asked:
            ready, _, _ = select([self.mavlink], [], [], max(0.0, until - time.monotonic()))
            if not ready:
                return
            self._take(self.mavlink.recv(4096))

    def hear(self) -> list[bytes]:
        """The datagrams that it has sent since the last time, but for answers to our own
        questions.
        """
        for data in super().hear():
            self._take(data)
        heard, self._unread = self._unread, []
        return heard

    def _take(self, data: bytes) -> None:
        answers = [
            -one.ts1
            for one in self._port.feed(data)
            if one.get_type() == "TIMESYNC" and one.ts1 < 0
        ]
        if answers:
            self._answered = max(answers)
        else:
            self._unread.append(data)

    def close(self) -> None:
        """Switch it off."""
        if self._wire is not None:
            self._wire.close()
        super().close()


def make_px4(folder: Path) -> Make:
    """Makes copies of the PX4 that was built in ``folder``."""
    program = find_program(folder)
    return lambda place, noise: Px4(program, place, noise)
