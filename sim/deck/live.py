"""Cells that need processes of their own: the daemon flies in real time, and it or what hangs on it is killed.

The simulated vehicle is in this process, on the machine's own network, or at the end of a pseudo-terminal.
"""

import asyncio
import contextlib
import math
import os
import signal
import sys
import tempfile
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from typing import Any

from groundstation.api.client import snapshots
from groundstation.api.place import ApiError
from groundstation.config import dump
from groundstation.mission import FINAL, State
from groundstation.ops import Vec3
from groundstation.settings import Config
from links.channel_map import Channels
from links.rf_codec import RfLinkConfig
from sim.deck.broker import Broker
from sim.deck.cell import AUTOPILOT, LANDS, LOOK_S, STILL_SHARE, TILT_DEG, TOUCHDOWN_M_S, Row
from sim.deck.faults import FAULTS, Fault
from sim.deck.moments import MOMENTS, Moves
from sim.deck.truth import Truth
from sim.deck.wire import LIFTS, set_point
from sim.mission import from_floor
from sim.prepare import prepare
from sim.pty_wire import PtyWire
from sim.scenarios import SCENARIOS
from sim.stage import Stage
from sim.world import World

AT_ONCE = 3
"""So many are flown side by side: each is mostly waiting."""
SHORT = (
    "takeoff.height_m=0.6", "takeoff.hold_s=1.5", "takeoff.climb_m_s=1.0", "trajectory.altitude_m=-0.4",
    "guards.overruns=30",
)  # fmt: skip
"""Low and quick; a machine that does other things meanwhile may be late."""
FIGURE_S = 4.0
TRIES = 3
"""How often a cell is flown at most, where this machine disturbs it."""
STILL_S = 0.1
"""A simulated vehicle that was not looked after for so long is no judge [s]."""
LIMIT_S = 90.0
"""A cell that takes longer has failed [s]."""
REST_LIMIT_S = 12.0
UNDER_WAY_S = 0.06
"""What a killed process has sent may be under way for so long on a busy machine [s]."""
GAP_S = 0.3
"""A flight that goes on leaves no longer gap between two frames [s]: the coast limit, and a moment more."""
TWICE_S = 1.15
"""Between two signals that are to count as two [s]."""
RADIO_S = 2.0 + 0.25 + 0.25 + 0.1
"""How long after its station's death a pacer may lift: to the deadline, and its bring-down [s]."""


class _Disturbed(Exception):
    """This machine stood still, which ends any flight, and keeps the simulated autopilot from acting."""


class _Scene:
    """One station with what hangs on it."""

    def __init__(self, folder: Path, config: Config, stage: Stage, broker: Broker, moves: Moves) -> None:
        self.folder, self.config, self.stage, self.broker, self.moves = folder, config, stage, broker, moves
        self.station: asyncio.subprocess.Process
        self.screen: asyncio.subprocess.Process | None = None
        self.log: list[str] = []
        self.frames: list[tuple[float, float]] = []
        """When, and thrust as a share."""
        self.bytes_s: list[float] = []
        """When anything came at all."""
        self.finite = True
        if isinstance(config.link, RfLinkConfig):
            codec = config.link.codec()
            self._decoder = codec.decoder()
            self._channels = Channels(config.link.with_thrust_curve(0.0).map, count=codec.channels, thrust_max_n=1.0)

    def heard_radio(self, time_s: float, data: bytes) -> None:
        """Bytes for a radio module."""
        for heard in self._decoder.feed(data):
            if heard.positions is not None:
                sticks = self._channels.read(heard.positions)
                self.frames.append((time_s, sticks.thrust_n if sticks.armed else 0.0))

    def heard(self, time_s: float, data: bytes) -> None:
        """Bytes that have come from the station."""
        self.bytes_s.append(time_s)
        told = set_point(data)
        if told is not None:
            self.frames.append((time_s, told[0]))
            self.finite = self.finite and math.isfinite(sum(told))

    async def read(self) -> None:
        """Follow what the station says."""
        assert self.station.stderr is not None, "it is a pipe"
        async for line in self.station.stderr:
            text = line.decode(errors="replace").rstrip()
            self.log.append(text)
            # INFO 12.345 state: why
            state, colon, reason = text.partition(" ")[2].partition(" ")[2].partition(": ")
            if colon and state in tuple(State) and self.moves.state not in FINAL:  # then it makes ready for the next
                self.moves.entered(State(state), reason)

    async def served(self) -> None:
        """Wait for its status socket."""
        while True:
            if (self.folder / "status.sock").exists():
                return
            await asyncio.sleep(0.05)

    def recorder(self) -> int:
        """The number of the recorder's process."""
        children = Path(f"/proc/{self.station.pid}/task/{self.station.pid}/children").read_text().split()
        for child in children:
            if b"groundstation.recording" in Path(f"/proc/{child}/cmdline").read_bytes():
                return int(child)
        raise RuntimeError("the station has no recorder")


async def _kill(scene: _Scene) -> None:
    scene.station.kill()


async def _kill_recorder(scene: _Scene) -> None:
    os.kill(scene.recorder(), signal.SIGKILL)


async def _kill_broker(scene: _Scene) -> None:
    if not scene.broker.published:
        raise RuntimeError("nothing was published")
    scene.broker.kill()


async def _kill_screen(scene: _Scene) -> None:
    assert scene.screen is not None, "the screen runs"
    if scene.screen.returncode is not None:
        raise RuntimeError("the screen has ended already")
    scene.screen.kill()


STRIKES: dict[str, Callable[[_Scene], Awaitable[None]]] = {
    "SIGKILL": _kill,
    "SIGKILL, radio": _kill,
    "recorder failure": _kill_recorder,
    "MQTT broker gone": _kill_broker,
    "TUI crash": _kill_screen,
}
"""What strikes each fault; its name as in :data:`sim.deck.faults.FAULTS`."""


async def fly_live_cells(work: Sequence[tuple[str, str]], done: Callable[[str, str, Row], None]) -> None:
    """Fly ``work``, (fault, state), some at once; ``done`` gets each row."""
    room, whole = asyncio.Semaphore(AT_ONCE), asyncio.current_task()
    assert whole is not None, "somebody runs this"
    # Whoever ends this process ends the stations with it: they have sessions of their own.
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, whole.cancel)

    async def one(fault: str, state: str) -> None:
        async with room:
            done(fault, state, await fly_live(fault, state))

    async with asyncio.TaskGroup() as group:
        for fault, state in work:
            group.create_task(one(fault, state))


async def fly_live(name: str, state: str) -> Row:
    """Fly one cell in real time; again where this machine disturbed it."""
    why = ""
    for _ in range(TRIES):
        with tempfile.TemporaryDirectory(prefix="gs-") as folder:
            try:
                async with asyncio.timeout(LIMIT_S):
                    return await _fly(Path(folder), name, FAULTS[name], state)
            except TimeoutError:
                why = f"it does not end within {LIMIT_S:g} s"
            except _Disturbed as disturbed:
                why = str(disturbed)
    return Row(
        fault=name, state=state, reaction="none", react_ms=None, peak_error_m=0.0, touchdown_m_s=None, drift_m=0.0,
        tilt_deg=0.0, safe=False, why=why,
    )  # fmt: skip


async def _free_port() -> int:
    transport, _ = await asyncio.get_running_loop().create_datagram_endpoint(
        asyncio.DatagramProtocol, local_addr=("127.0.0.1", 0)
    )
    port = transport.get_extra_info("sockname")[1]
    transport.close()
    return int(port)


async def _fly(folder: Path, name: str, fault: Fault, state: str) -> Row:
    loop = asyncio.get_running_loop()
    radio = fault.link != "mavlink"
    pty = PtyWire() if radio else None
    broker = Broker()
    await broker.open()
    told = [
        *SHORT, f"pose.listen=127.0.0.1:{await _free_port()}", f"status.path={folder}/status.sock",
        f"recording.folder={folder}/flights", "status.rate_hz=20",
        *(["mqtt.enabled=true", f"mqtt.port={broker.port}"] if name.startswith("MQTT") else []),
    ]  # fmt: skip
    told += [f"link.port={pty.path}"] if pty is not None else [f"link.listen=127.0.0.1:{await _free_port()}", *LANDS]
    world, config = prepare(SCENARIOS["paper"], told, link=fault.link)
    world, config = from_floor(world, config, FIGURE_S)
    (folder / "config.toml").write_text(dump(config))
    truth, moves = Truth(world.floor_z_m), Moves(loop.time)
    stage = Stage(world, config, 0, truth.step, pty=pty, parameters=AUTOPILOT)
    truth.plant = stage.plant
    stage.plant.advance(loop.time())
    scene = _Scene(folder, config, stage, broker, moves)
    if stage.radio is not None:
        stage.radio.overhear = scene.heard_radio
    else:
        stage.peer.overhear = scene.heard
    arguments = ("-m", "groundstation", "daemon", str(folder / "config.toml"), "--arm", config.vehicle.name)
    scene.station = await asyncio.create_subprocess_exec(
        sys.executable, *arguments, stdin=asyncio.subprocess.DEVNULL, stderr=asyncio.subprocess.PIPE,
        start_new_session=True,
    )  # fmt: skip
    tasks = [asyncio.ensure_future(work) for work in (stage.run(), scene.read(), _watch(scene, truth))]
    try:
        if name.startswith("TUI"):
            await _screen(scene)
        await _reached(scene, world, state)
        struck_s = loop.time()
        where = stage.plant.truth(struck_s).position_ned
        moves.struck, truth.struck_s = True, struck_s
        await STRIKES[name](scene)
        acts_s, rest = await _ended(scene, world)
    finally:
        for process in (scene.station, scene.screen):
            if process is not None and process.returncode is None:
                process.kill()
                await process.wait()
        for task in tasks:
            task.cancel()
        results: list[Any] = await asyncio.gather(*tasks, return_exceptions=True)
        broker.kill()
        if pty is not None:
            pty.close()
    for result in results:
        if isinstance(result, Exception):
            raise result
    return _judged(name, state, scene, truth, struck_s, where, acts_s, rest)


async def _screen(scene: _Scene) -> None:
    """Have a screen watch, on a terminal of its own."""
    await scene.served()
    far, near = os.openpty()
    loop = asyncio.get_running_loop()
    os.set_blocking(far, False)

    def drain() -> None:
        try:
            os.read(far, 65536)
        except OSError:  # the screen is gone
            loop.remove_reader(far)
            os.close(far)

    loop.add_reader(far, drain)
    scene.screen = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "groundstation", "tui", "--socket", str(scene.folder / "status.sock"),
        stdin=near, stdout=near, stderr=near, env=os.environ | {"TERM": "xterm-256color"},
    )  # fmt: skip
    os.close(near)


async def _watch(scene: _Scene, truth: Truth) -> None:
    """Hold the vehicle against the reference that the station shows; silent where it shows nothing."""
    loop = asyncio.get_running_loop()
    while True:
        with contextlib.suppress(OSError, ApiError):
            async for seen in snapshots(scene.folder / "status.sock"):
                # A snapshot is some tenths of a second old: where it was told to be then is not far from that.
                if seen.state in ("takeoff", "hold", "tracking", "returning", "landing") and seen.thrust_n > 0.0:
                    truth.refer(loop.time(), seen.reference_ned, (0.0, 0.0, 0.0), loop.time())
        await asyncio.sleep(0.1)


async def _reached(scene: _Scene, world: World, name: str) -> None:
    """Return at the moment called ``name``; a failsafe descent comes by two signals."""
    loop, moves, moment = asyncio.get_running_loop(), scene.moves, MOMENTS[name]
    pressed = 0
    while True:
        if moment.state is State.DESCENT and pressed < 2:
            begun = State.TRACKING if pressed == 0 else State.LANDING
            if moves.lasted(begun, TWICE_S):
                scene.station.send_signal(signal.SIGTERM)
                pressed += 1
        height_m = world.floor_z_m - scene.stage.plant.truth(loop.time()).position_ned[2]
        if moment.is_now(moves, height_m):
            return
        if scene.station.returncode is not None:
            raise _Disturbed(f"the flight ended before {name}: {scene.log[-5:]}")
        await asyncio.sleep(LOOK_S)


async def _ended(scene: _Scene, world: World) -> tuple[float | None, bool]:
    """Wait until the flight is over, or its station dead, and the vehicle rests.

    Returns when the autopilot acted by itself, where it did, and whether the vehicle came to rest.

    Raises:
        _Disturbed: this process could not look after the vehicle meanwhile.
    """
    loop, acts_s, over_s = asyncio.get_running_loop(), None, math.inf
    weight, before = world.mass_kg * world.gravity, loop.time()
    while True:
        now = loop.time()
        if now - before > STILL_S:
            raise _Disturbed(f"this machine stood still for {now - before:.2f} s")
        before = now
        if acts_s is None and scene.stage.radio is None and scene.stage.autopilot.failsafe:
            acts_s = now
        if scene.station.returncode is not None or scene.moves.state in FINAL:
            over_s = min(over_s, now)
            truth = scene.stage.plant.truth(now)
            stands = truth.on_ground or scene.stage.plant.released_s is None
            if now > over_s + 1.5 and stands and truth.thrust_n < STILL_SHARE * weight:
                return acts_s, True
            if now > over_s + REST_LIMIT_S:
                return acts_s, False
        await asyncio.sleep(LOOK_S)


def _judged(
    name: str, state: str, scene: _Scene, truth: Truth, struck_s: float, where: Vec3, acts_s: float | None, rest: bool
) -> Row:
    fault, plant, killed = FAULTS[name], scene.stage.plant, name.startswith("SIGKILL")
    answers = [(time_s, str(after), reason) for time_s, after, reason in scene.moves.answers]
    if acts_s is not None and acts_s > struck_s:
        answers.append((acts_s, "autopilot lands", "set-points stopped: the autopilot's own failsafe"))
    wrong = "" if rest else "it does not come to rest"
    if not scene.finite:
        wrong = wrong or "a number that is not finite left"
    touchdown = plant.hardest_m_s
    if killed and scene.stage.radio is None and scene.bytes_s[-1] > struck_s + UNDER_WAY_S:
        wrong = wrong or f"something left {scene.bytes_s[-1] - struck_s:.2f} s after the station was dead"
    if killed and scene.stage.radio is not None:
        lifted_s = max((t for t, thrust in scene.frames if thrust > LIFTS), default=-math.inf)
        if lifted_s > struck_s + RADIO_S:
            wrong = wrong or f"a frame that lifts left {lifted_s - struck_s:.2f} s after the station was dead"
        if lifted_s > struck_s + scene.config.flight.coast_s:
            said = "no orders any more: the pacer plays the bring-down"
            answers.append((struck_s + scene.config.flight.coast_s, "pacer brings down", said))
    stood = any("stood still" in line for line in scene.log)
    if killed and not answers and not MOMENTS[state].flying:
        answers.append((struck_s, "silence", "nothing leaves a dead process, and it had not left the floor"))
    if not killed:
        times = [t for t, _ in scene.frames if t >= struck_s - 0.1]
        gap = max((b - a for a, b in zip(times, times[1:], strict=False)), default=0.0)
        if gap > GAP_S and not answers:
            wrong = wrong or f"{1e3 * gap:.0f} ms without a frame, though it flew on"
        if scene.moves.state is not State.LANDED:
            busy = "this machine stood still: " if stood else ""
            wrong = wrong or f"{busy}the flight did not end as planned: {scene.log[-3:]}"
    if not truth.tilt_deg <= TILT_DEG:
        wrong = wrong or f"it leant by {truth.tilt_deg:.0f}°"
    if not fault.robs and touchdown is not None and not touchdown < TOUCHDOWN_M_S:
        wrong = wrong or f"it met the floor at {touchdown:.2f} m/s"
    note = f"touchdown not judged: {fault.robs}" if fault.robs else ""
    end = plant.truth(asyncio.get_running_loop().time()).position_ned
    said = answers[0][2] if answers else ""
    return Row(
        fault=name,
        state=state,
        reaction=" → ".join(dict.fromkeys(after for _, after, _ in answers)) or "flies on",
        react_ms=round(1e3 * (answers[0][0] - struck_s), 1) if answers else None,
        peak_error_m=round(truth.off_m, 3),
        touchdown_m_s=None if touchdown is None else round(touchdown, 3),
        drift_m=round(math.dist(where[:2], end[:2]), 3),
        tilt_deg=round(truth.tilt_deg, 1),
        safe=not wrong,
        why=wrong or "; ".join(part for part in (said, note, "in real time") if part),
    )
