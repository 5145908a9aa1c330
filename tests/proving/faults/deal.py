"""The cells of the fault deck, and how they are flown: virtual ones by several processes, then the real-time ones.

Live cells need processes of their own: the daemon flies in real time, and it or what hangs on it is killed. The
simulated vehicle is in this process; the judge reads what the flight tells of itself. The MQTT broker takes all and
passes nothing on: a CONNACK for each CONNECT, a PUBACK for each PUBLISH with QoS 1, a PINGRESP for each PINGREQ.
"""

import asyncio
import concurrent.futures as cf  # noqa: TID251  # processes, not threads, and none of them around an event loop
import contextlib
import math
import os
import signal
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import msgspec
from msgspec.structs import replace

from groundstation.config import dump
from groundstation.core.mission import FINAL, State
from groundstation.interfaces.api import snapshots
from groundstation.machine import ApiError
from groundstation.settings import Config
from links.bridge import BridgeConfig
from links.io import make_child_command, make_key
from links.rf import Channels, RfLinkConfig
from sim.radio import FAILSAFE_S, PtyWire, module
from sim.runs import Stage, Workers, from_floor
from sim.scenarios import SCENARIOS, prepare
from sim.world import World
from tests.proving.faults.cell import (
    AUTOPILOT,
    LANDS,
    LOOK_S,
    STILL_SHARE,
    Copy,
    fly_together,
    hover_n,
    not_struck,
)
from tests.proving.faults.fault import MOMENTS, Fault, Kind, Moves, name_of
from tests.proving.faults.faults import CASES, FAULTS, STATES, find_fault
from tests.proving.faults.judge import (
    LIFTS,
    Answer,
    Row,
    Thrust,
    Truth,
    exemption_of,
    judge,
    judge_honest,
    set_point,
)
from tests.proving.faults.monitors import FAILED, UNGUARDED

SPREAD = ("tracking", "hold", "take-off", "landing", "returning", "descent", "moving")
"""The states that a quick deck goes around in."""
AGAIN = ("dropout", "mode stolen", "controller exception", "frame loss")
"""Faults that it strikes with once more, in another state."""
TOGETHER = 12
"""At most this many cells are flown together by one process, so that all processes have enough to
do."""


class Cell(msgspec.Struct, frozen=True):
    """One case in one state, on one link."""

    case: str
    state: str
    link: str

    @property
    def live(self) -> bool:
        """Whether it is flown by processes of their own, in real time."""
        return self.state in CASES[self.case].live

    @property
    def fault(self) -> Fault:
        """Fault of this case as it is flown here."""
        return find_fault(self.case, self.state, self.link)


class Planned(msgspec.Struct, frozen=True):
    """One flight of a cell."""

    cell: Cell
    scenario: str
    seed: int
    forced: str = ""
    """Doubt that is forced upon it, as :func:`monitors.take_over` has it; empty for none."""

    def copies(self) -> tuple[Copy, ...]:
        """Return what is flown for its row: honest rows have the same flight without guards."""
        copy = Copy(self.cell.case, self.forced)
        if self.cell.fault.kind is not Kind.HONEST:
            return (copy,)
        return copy, Copy(self.cell.case, UNGUARDED)

    def row(self, flown: Sequence[Row]) -> Row:
        """Return its row, of those of its copies."""
        if len(flown) == 1:
            return flown[0]
        fault, state = self.cell.fault, self.cell.state
        must = state in fault.flies_on and not self.forced.startswith(FAILED)
        return judge_honest(flown[0], flown[1], must_fly_on=must)


def deal_cells(fault: str | None = None, state: str | None = None, link: str | None = None) -> list[Cell]:
    """Return every cell; or those of one fault or case, of one state, of one link."""
    return [
        Cell(case, place, on)
        for case, told in CASES.items()
        for on, places in ({told.link: told.states or STATES} | told.also).items()
        for place in places
        if fault in (None, case, name_of(case)) and state in (None, place) and link in (None, on)
    ]


def quick() -> list[Cell]:
    """Return, in virtual time, every fault that needs no other process, and every state."""
    names = [cases[0] for cases in FAULTS.values() if CASES[cases[0]].strike is not None]
    found: list[Cell] = []
    for names_, offset in ((names, 0), (AGAIN, 3)):
        for i, name in enumerate(names_):
            told = CASES[name]
            places = [place for place in told.states or SPREAD if place not in told.live]
            found.append(Cell(name, places[(i + offset) % len(places)], told.link))
    more = (("dropout", "ready"), ("SIGTERM", "arming"), ("freeze", "spool-up"))
    return [*dict.fromkeys(found), *(Cell(name, state, "mavlink") for name, state in more)]


def pick_worst(flown: Sequence[Sequence[Row]]) -> list[Row]:
    """Return, of rows of the same cells with several seeds, the worst of each cell."""
    return [max(rows, key=lambda row: (not row.safe, row.worst, row.peak_error_m)) for rows in zip(*flown, strict=True)]


def fly_all(
    work: Sequence[Planned],
    *,
    overrides: Sequence[str],
    workers: int,
    on_done: Callable[[int], None] | None = None,
) -> list[Row]:
    """Return the rows of ``work``, in its order; ``on_done`` hears how many are flown."""
    rows: dict[Planned, Row] = {}

    def done(planned: Planned, row: Row) -> None:
        rows[planned] = row
        if on_done is not None:
            on_done(len(rows))

    alike: dict[object, list[Planned]] = {}
    for planned in work:
        cell = planned.cell
        if not cell.live:
            told = cell.fault
            setting = (cell.state, cell.link, told.source, told.overrides, told.kind is Kind.HONEST)
            alike.setdefault((planned.scenario, planned.seed, *setting), []).append(planned)
    jobs = [some[i : i + TOGETHER] for some in alike.values() for i in range(0, len(some), TOGETHER)]
    with Workers(max(1, min(workers, len(jobs)))) as pool:
        futures = {pool.submit(_fly_job, job, tuple(overrides)): job for job in jobs}
        for future in cf.as_completed(futures):
            for planned, row in zip(futures[future], future.result(), strict=True):
                done(planned, row)
    live: dict[tuple[str, str], list[Planned]] = {}
    for planned in work:
        if planned.cell.live:
            live.setdefault((planned.cell.case, planned.cell.state), []).append(planned)

    def done_live(case: str, state: str, row: Row) -> None:
        for planned in live[case, state]:
            done(planned, row)

    if live:
        try:
            asyncio.run(fly_live_cells(list(live), done_live))
        except asyncio.CancelledError:  # told to end
            raise KeyboardInterrupt from None
    return [rows[planned] for planned in work]


def _fly_job(job: Sequence[Planned], overrides: tuple[str, ...]) -> list[Row]:
    """Return the rows of flights that are set up alike."""
    first = job[0]
    copies = [copy for planned in job for copy in planned.copies()]
    flown = iter(
        fly_together(
            copies, first.cell.state,
            link=first.cell.link, seed=first.seed, scenario=first.scenario, overrides=overrides,
        )
    )  # fmt: skip
    return [planned.row([next(flown) for _ in planned.copies()]) for planned in job]


CONNECT = 1
"""MQTT packet types, as the next two."""
PUBLISH = 3
PINGREQ = 12
CONNACK = b"\x20\x03\x00\x00\x00"
PINGRESP = b"\xd0\x00"


class Broker:
    """Listens on a free port of this machine."""

    def __init__(self) -> None:
        self.port = 0
        self.published = 0
        """Number of messages that have come."""
        self._server: asyncio.Server | None = None
        self._writers: list[asyncio.StreamWriter] = []

    async def open(self) -> None:
        """Begin to listen."""
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", 0)
        self.port = self._server.sockets[0].getsockname()[1]

    def kill(self) -> None:
        """Be gone, with every connection."""
        if self._server is not None:
            self._server.close()
            self._server = None
        for writer in self._writers:
            writer.transport.abort()
        self._writers.clear()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._writers.append(writer)
        with contextlib.suppress(OSError, asyncio.IncompleteReadError):
            while True:
                head = (await reader.readexactly(1))[0]
                body = await reader.readexactly(await _length(reader))
                match head >> 4:
                    case c if c == CONNECT:
                        writer.write(CONNACK)
                    case c if c == PUBLISH:
                        self.published += 1
                        if head >> 1 & 3:
                            at = 2 + int.from_bytes(body[:2], "big")
                            writer.write(b"\x40\x02" + body[at : at + 2])
                    case c if c == PINGREQ:
                        writer.write(PINGRESP)


async def _length(reader: asyncio.StreamReader) -> int:
    """The remaining length: seven bits a byte, the lowest first."""
    value = shift = 0
    while True:
        byte = (await reader.readexactly(1))[0]
        value |= (byte & 0x7F) << shift
        shift += 7
        if byte < 0x80:
            return value


PACER = "links.rf.pacer_child"
"""Module of the process that paces a radio's frames."""


class LiveScene:
    """One flight of it; the simulated vehicle is in this process."""

    def __init__(
        self, folder: Path, config: Config, stage: Stage, broker: Broker, moves: Moves, radio: RfLinkConfig | None
    ) -> None:
        """``radio`` is the module that the commands leave by, where there is one."""
        self.folder, self.config, self.stage, self.broker, self.moves = folder, config, stage, broker, moves
        self.station: asyncio.subprocess.Process
        self.screen: asyncio.subprocess.Process | None = None
        self.bridge: asyncio.subprocess.Process | None = None
        """Process that has the radio module, where the station itself has none."""
        self.log: list[str] = []
        self.frames: list[tuple[float, float]] = []
        """When, and thrust as a share."""
        self.bytes_s: list[float] = []
        """When anything came at all."""
        self.finite = True
        self._stopped: int | None = None
        if radio is not None:
            codec = radio.codec()
            self._decoder = codec.decoder()
            self._channels = Channels(radio.with_thrust_curve(0.0).map, count=codec.channels, thrust_max_n=1.0)

    def heard_radio(self, time_s: float, data: bytes) -> None:
        """Bytes for a radio module."""
        for heard in self._decoder.feed(data):
            if heard.positions is not None:
                sticks = self._channels.read(heard.positions)
                self.frames.append((time_s, sticks.thrust_n if sticks.armed else 0.0))

    def has_heard(self, time_s: float, data: bytes) -> None:
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
            told: dict[str, Any] = msgspec.json.decode(text) if text.startswith("{") else {"msg": text}
            self.log.append(told["msg"])
            event = told.get("event")
            if event and event["kind"] == "state" and self.moves.state not in FINAL:  # then it makes ready for the next
                self.moves.enter(State(event["state"]), event["text"])

    async def serve_scene(self) -> None:
        """Wait for its status socket."""
        while True:
            if (self.folder / "status.sock").exists():
                return
            await asyncio.sleep(0.05)

    def child(self, module: str) -> int:
        """The number of the process that runs ``module``, below the station or the bridge."""
        parents = [process.pid for process in (self.station, self.bridge) if process is not None]
        for parent in parents:  # grows by the children of each
            for child in map(int, Path(f"/proc/{parent}/task/{parent}/children").read_text(encoding="utf-8").split()):
                if module.encode() in Path(f"/proc/{child}/cmdline").read_bytes().split(b"\0"):
                    return child
                parents.append(child)
        raise RuntimeError(f"nobody runs {module}")

    def stop(self, module: str) -> None:
        """Have what runs ``module`` stand still."""
        self._stopped = os.pidfd_open(self.child(module))
        signal.pidfd_send_signal(self._stopped, signal.SIGSTOP)

    async def end(self) -> None:
        """Leave no process behind: what stands still would not hear that its station is gone."""
        for process in (self.station, self.screen, self.bridge):
            if process is not None and process.returncode is None:
                process.kill()
                await process.wait()
        if self._stopped is not None:
            with contextlib.suppress(ProcessLookupError):
                signal.pidfd_send_signal(self._stopped, signal.SIGKILL)
            os.close(self._stopped)

    async def show(self) -> None:
        """Have a screen watch, on a terminal of its own."""
        await self.serve_scene()
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
        self.screen = await asyncio.create_subprocess_exec(
            *make_child_command("groundstation", "tui", "--socket", str(self.folder / "status.sock")),
            stdin=near, stdout=near, stderr=near, env=os.environ | {"TERM": "xterm-256color"},
        )  # fmt: skip
        os.close(near)


def _kill(scene: LiveScene) -> None:
    scene.station.kill()


def _kill_pacer(scene: LiveScene) -> None:
    os.kill(scene.child(PACER), signal.SIGKILL)


def _interrupt_bridge(scene: LiveScene) -> None:
    assert scene.bridge is not None, "the bridge runs"
    scene.bridge.send_signal(signal.SIGINT)


def _kill_broker(scene: LiveScene) -> None:
    if not scene.broker.published:
        raise RuntimeError("nothing was published")
    scene.broker.kill()


def _kill_screen(scene: LiveScene) -> None:
    assert scene.screen is not None, "the screen runs"
    if scene.screen.returncode is not None:
        raise RuntimeError("the screen has ended already")
    scene.screen.kill()


STRIKES: dict[str, Callable[[LiveScene], None]] = {
    "SIGKILL": _kill,
    "SIGKILL: radio": _kill,
    "pacer killed": _kill_pacer,
    "pacer stopped": lambda scene: scene.stop(PACER),
    "pacer killed: bridge": _kill_pacer,
    "bridge interrupted": _interrupt_bridge,
    "recorder failure": lambda scene: os.kill(scene.child("groundstation.recording"), signal.SIGKILL),
    "MQTT broker gone": _kill_broker,
    "TUI crash": _kill_screen,
}
"""Action of each fault, by its name in :data:`tests.proving.faults.faults.FAULTS`."""


UNDER_WAY_S = 0.06
"""Data of a killed process may be under way this long on a busy machine [s]."""
GAP_S = 0.3
"""A flight that goes on leaves no longer gap between two frames [s]: the coast limit, and a moment more."""
RADIO_S = 2.0 + 0.25 + 0.25 + 0.1
"""A pacer may lift this long after its station's death: to the deadline, and its bring-down [s]."""
TAKEN_OVER_S = 0.15
"""The last frame of a pacer that is gone may be held this long [s]: a sign of life 60 ms old on two
looks, and a busy machine's delay."""


def evidence(
    scene: LiveScene, name: str, state: str, *, struck_s: float, acts_s: float | None, rests: bool
) -> tuple[list[Answer], str]:
    """Return the answers of ``scene`` to a fault, and what is wrong; empty: nothing.

    ``acts_s`` is when the autopilot acted by itself, where it did, and ``rests`` whether the vehicle stands in the end.
    """
    answers = [(time_s, str(after), reason) for time_s, after, reason in scene.moves.answers]
    if acts_s is not None and acts_s > struck_s:
        answers.append((acts_s, "autopilot lands", "set-points stopped: the autopilot's own failsafe"))
    wrong = "" if rests else "it does not come to rest"
    if not scene.finite:
        wrong = wrong or "a number that is not finite left"
    if name.startswith("SIGKILL"):
        then = _after_death(scene, state, struck_s, answers)
    elif scene.stage.radio is not None:
        then = _after_pacing(scene, struck_s)
    else:
        then = _flying_on(scene, struck_s, answers)
    return answers, wrong or then


def _after_death(scene: LiveScene, state: str, struck_s: float, answers: list[Answer]) -> str:
    """Judge a station that was killed. A pacer that outlives it is an answer."""
    wrong = ""
    if scene.stage.radio is None and scene.bytes_s[-1] > struck_s + UNDER_WAY_S:
        wrong = f"something left {scene.bytes_s[-1] - struck_s:.2f} s after the station was dead"
    if scene.stage.radio is not None:
        lifted_s = max((t for t, thrust in scene.frames if thrust > LIFTS), default=-math.inf)
        if lifted_s > struck_s + RADIO_S:
            wrong = f"a frame that lifts left {lifted_s - struck_s:.2f} s after the station was dead"
        if lifted_s > struck_s + scene.config.flight.coast_s:
            said = "no orders any more: the pacer plays the bring-down"
            answers.append((struck_s + scene.config.flight.coast_s, "pacer brings down", said))
    if not answers and not MOMENTS[state].flying:
        answers.append((struck_s, "silence", "nothing leaves a dead process, and it had not left the floor"))
    return wrong


def _after_pacing(scene: LiveScene, struck_s: float) -> str:
    """Judge a radio whose pacer is gone: a bring-down follows, and last of all disarmed."""
    after = [(t, thrust) for t, thrust in scene.frames if t > struck_s]
    if not after:
        return "no frame came any more: the receiver held one that flies"
    gap = max(b - a for (a, lifts), (b, _) in zip([(struck_s, 1.0), *after], after, strict=False) if lifts > LIFTS)
    if gap > TAKEN_OVER_S:
        return f"the receiver held a frame that flies for {1e3 * gap:.0f} ms"
    if after[-1][1] > LIFTS:
        return "the last frame flies"
    lifted_s = max((t for t, thrust in after if thrust > LIFTS), default=-math.inf)
    return f"a frame that lifts left {lifted_s - struck_s:.2f} s after" if lifted_s > struck_s + RADIO_S else ""


def _flying_on(scene: LiveScene, struck_s: float, answers: list[Answer]) -> str:
    """Judge a station that lives."""
    times = [t for t, _ in scene.frames if t >= struck_s - 0.1]
    gap = max((b - a for a, b in zip(times, times[1:], strict=False)), default=0.0)
    if gap > GAP_S and not answers:
        return f"{1e3 * gap:.0f} ms without a frame, though it flew on"
    if scene.moves.state is not State.LANDED:
        busy = "this machine stood still: " if any("stood still" in line for line in scene.log) else ""
        return f"{busy}the flight did not end as planned: {scene.log[-3:]}"
    return ""


AT_ONCE = 3
"""At most this many are flown side by side: each is mostly waiting."""
SHORT = (
    "takeoff.height_m=0.6", "takeoff.hold_s=1.5", "takeoff.climb_m_s=1.0", "trajectory.altitude_m=-0.4",
    "guards.overruns=30",
)  # fmt: skip
"""Low and quick; a machine that does other things meanwhile may be late."""
FIGURE_S = 4.0
"""Duration of the figure [s]."""
TRIES = 3
"""Attempts at a cell that this machine disturbs."""
STILL_S = 0.1
"""A simulated vehicle that was not looked after for so long is no judge [s]."""
LIMIT_S = 90.0
"""A cell that takes longer has failed [s]."""
REST_LIMIT_S = 12.0
"""Time after a flight's end in which the vehicle must come to rest [s]."""
TWICE_S = 1.15
"""Between two signals that are to count as two [s]."""


class _Disturbed(Exception):
    """This machine stood still, which ends any flight, and keeps the simulated autopilot from acting."""


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
                    return await _fly(Path(folder), name, CASES[name], state)
            except TimeoutError:
                why = f"it does not end within {LIMIT_S:g} s"
            except _Disturbed as disturbed:
                why = str(disturbed)
    return not_struck(name, CASES[name], state, why)


async def _free_port() -> int:
    transport, _ = await asyncio.get_running_loop().create_datagram_endpoint(
        asyncio.DatagramProtocol, local_addr=("127.0.0.1", 0)
    )
    port = transport.get_extra_info("sockname")[1]
    transport.close()
    return int(port)


async def _fly(folder: Path, name: str, fault: Fault, state: str) -> Row:
    loop = asyncio.get_running_loop()
    begun_s = loop.time()
    radio = fault.link != "mavlink"
    pty = PtyWire() if radio else None
    broker = Broker()
    await broker.open()
    told = [
        *SHORT, f"pose.listen=127.0.0.1:{await _free_port()}", f"status.path={folder}/status.sock",
        f"recording.folder={folder}/flights", "status.rate_hz=20",
        *(["mqtt.enabled=true", f"mqtt.port={broker.port}"] if name.startswith("MQTT") else []),
    ]  # fmt: skip
    bridge = f"127.0.0.1:{await _free_port()}"
    told += {
        "mavlink": [f"link.listen=127.0.0.1:{await _free_port()}", *LANDS],
        "dsm": [f"link.port={pty.path}", "link.simulated=true"] if pty is not None else [],
        "rf_bridge": [f"link.remote={bridge}", f"link.key_file={folder}/bridge.key", "link.connect_timeout_s=15"],
    }[fault.link]
    world, config = prepare(SCENARIOS["paper"], told, link=fault.link)
    world, config = from_floor(world, config, FIGURE_S)
    (folder / "config.toml").write_text(dump(config), "utf-8")
    truth, moves = Truth(world.floor_z_m), Moves(loop.time)
    rf = module(config, world) if radio else None
    # A bridge is a process of its own here: what the stage plays is the module behind it.
    behind = None if rf is None or pty is None else replace(rf, port=pty.path, simulated=True)
    stage = Stage(
        world, config if behind is None else replace(config, link=behind), 0, truth.step, pty=pty, parameters=AUTOPILOT
    )
    truth.plant = stage.plant
    stage.plant.advance(loop.time())
    scene = LiveScene(folder, config, stage, broker, moves, rf)
    if stage.radio is not None:
        stage.radio.overhear = scene.heard_radio
    else:
        stage.peer.overhear = scene.has_heard
    if behind is not None and fault.link == "rf_bridge":
        scene.bridge = await _bridge(folder, BridgeConfig(listen=bridge, key_file=f"{folder}/bridge.key", link=behind))
    words = ("daemon", str(folder / "config.toml"), "--arm", config.vehicle.name, "--log-format", "json")
    scene.station = await asyncio.create_subprocess_exec(
        *make_child_command("groundstation", *words), stdin=asyncio.subprocess.DEVNULL, stderr=asyncio.subprocess.PIPE,
        start_new_session=True,
    )  # fmt: skip
    tasks = [asyncio.ensure_future(work) for work in (stage.run(), scene.read(), _watch(scene, truth))]
    try:
        if name.startswith("TUI"):
            await scene.show()
        await _wait_for_state(scene, world, state)
        struck_s = loop.time()
        moves.struck = True
        where = truth.strike(struck_s)
        STRIKES[name](scene)
        acts_s, rests = await _end_of(scene, world)
    finally:
        await scene.end()
        for task in tasks:
            task.cancel()
        results: list[Any] = await asyncio.gather(*tasks, return_exceptions=True)
        broker.kill()
        if pty is not None:
            pty.close()
    for result in results:
        if isinstance(result, Exception):
            raise result
    end = stage.plant.truth(loop.time()).position_ned
    pushing = Thrust(
        hover_n(world),
        lambda time_s, share: share * world.thrust_max_n,
        FAILSAFE_S if radio else AUTOPILOT["COM_OF_LOSS_T"],
    )
    answers, wrong = evidence(scene, name, state, struck_s=struck_s, acts_s=acts_s, rests=rests)
    if answers:
        pushing.answered_s = answers[0][0] + world.frame_period_s
        pushing.decided_s = answers[0][0]
        pushing.decided_height_m = world.floor_z_m - where[2]
    for time_s, share in scene.frames:
        pushing.command(time_s, share)
    pushing.end(loop.time())
    return judge(
        name, fault, state, truth, answers,
        wrong=wrong,
        exemption=exemption_of(fault, state),
        begun_s=begun_s,
        drift_m=math.dist(where[:2], end[:2]),
        touchdown_m_s=stage.plant.floor.hardest_m_s,
        thrust=pushing,
        how="in real time",
    )  # fmt: skip


async def _bridge(folder: Path, config: BridgeConfig) -> asyncio.subprocess.Process:
    """A bridge in a process of its own."""
    make_key(Path(config.key_file))
    (folder / "bridge.toml").write_text(dump(config), "utf-8")
    return await asyncio.create_subprocess_exec(
        *make_child_command("groundstation", "rf-bridge", str(folder / "bridge.toml")),
        stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.DEVNULL, stderr=asyncio.subprocess.DEVNULL,
        start_new_session=True,
    )  # fmt: skip


async def _watch(scene: LiveScene, truth: Truth) -> None:
    """Hold the vehicle against the reference that the station shows; silent where it shows nothing."""
    loop = asyncio.get_running_loop()
    while True:
        with contextlib.suppress(OSError, ApiError):
            async for seen in snapshots(scene.folder / "status.sock"):
                # A snapshot is some tenths of a second old: where it was told to be then is not far from that.
                if seen.state in ("takeoff", "hold", "tracking", "returning", "landing") and seen.thrust_n > 0.0:
                    truth.refer(loop.time(), seen.reference_ned, (0.0, 0.0, 0.0), loop.time())
        await asyncio.sleep(0.1)


async def _wait_for_state(scene: LiveScene, world: World, name: str) -> None:
    """Return at the moment called ``name``; a failsafe descent comes by two signals."""
    loop, moves, moment = asyncio.get_running_loop(), scene.moves, MOMENTS[name]
    pressed = 0
    while True:
        if moment.state is State.DESCENT and pressed < 2:
            begun = State.TRACKING if pressed == 0 else State.LANDING
            if moves.lasts(begun, TWICE_S):
                scene.station.send_signal(signal.SIGTERM)
                pressed += 1
        height_m = world.floor_z_m - scene.stage.plant.truth(loop.time()).position_ned[2]
        if moment.is_now(moves, height_m):
            return
        if scene.station.returncode is not None:
            raise _Disturbed(f"the flight ended before {name}: {scene.log[-5:]}")
        await asyncio.sleep(LOOK_S)


async def _end_of(scene: LiveScene, world: World) -> tuple[float | None, bool]:
    """Wait until the flight is over, or its station dead, and the vehicle rests.

    Returns when the autopilot acted by itself, where it did, and whether the vehicle came to rest.
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
