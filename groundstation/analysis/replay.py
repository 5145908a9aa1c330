"""Replay, ``groundstation replay LOG.mcap``: a recorded flight flown again, from the wire up.

What went in is taken from the recording: every byte with its arrival, the instant of every command,
the reference. What came out, every pose and every command, is made anew and held against what was
recorded, to the last bit. Sources and links run unchanged on a tape loop: they hear what they heard
in flight; what they send goes nowhere.
"""

import asyncio
import json
import selectors
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from groundstation.config import ConfigError
from groundstation.core.control import HOLDING, TRACKING, TRANSIT, Custom
from groundstation.core.geometry import Vec3
from groundstation.core.messages import GAIN, Pose, notice
from groundstation.core.pilot import Pilot
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import ActuatorCommand
from groundstation.flight import make_ends
from groundstation.pose.sources import Gate
from groundstation.recording import (
    About,
    Entry,
    Recording,
    about_texts,
    channels as ch,
    read_command,
    read_pose,
    read_reference,
    refuse_recordings,
)
from groundstation.runtime import Exit
from groundstation.settings import Config, read_flown_config
from links.core import Command
from links.io import NETWORK, Network

NAMES = ("thrust_n", "roll_rate_rad_s", "pitch_rate_rad_s", "yaw_rate_rad_s")
FLOWN_AGAIN = ("vehicle", "controller", "pose", "gate", "link", "flight")
"""Tables of the configuration that a replay reads; reference and mission are as recorded."""
END = "this is all that is in it"


def replay_command(
    path: Path, overrides: Sequence[str], *, as_json: bool, trust_modules: bool = False
) -> Exit:
    """Fly ``path`` again, with ``overrides`` where given; print what came of it.

    Returns 0, or 1 where the recording is damaged, or nothing was changed and the commands are not
    the same to the last bit.

    Raises:
        ConfigError: the file is no recording of a flight of ours, an override is bad, or it was
            flown by a controller of somebody's own, whose module nobody has said to be trusted.
    """
    facts = replay_facts(path, overrides, trust_modules=trust_modules)
    print(json.dumps(facts) if as_json else text_of(facts))
    return (
        Exit.DONE
        if facts["damaged_at"] is None and (overrides or facts["identical"])
        else Exit.FAILED
    )


def replay_facts(
    path: Path, overrides: Sequence[str] = (), *, trust_modules: bool = False
) -> dict[str, Any]:
    """The object that ``--json`` prints.

    Raises:
        ConfigError: see :func:`replay_command`.
    """
    with refuse_recordings():
        recording = Recording(path)
        if "imported" in recording.about:
            raise ConfigError("LOG", notice("replay.imported", path=path))
        config, left_out = read_flown_config(recording.about, recording.path, overrides)
        if not trust_modules and not {"controller.kind", "controller.factory"} & set(
            map(_key, overrides)
        ):
            _ensure_own(config, path)
        result = fly_again(recording, config)
    own = about_texts(About(config="", vehicle="", controller="", trajectory="", period_s=0.0))
    nothing_differs = not any(result.differing.values())
    count = len(result.commands)
    return {
        "file": str(path),
        "identical": nothing_differs and not result.lost and count + result.count["idle"] > 0,
        "first_difference": None if result.first is None else msgspec.to_builtins(result.first),
        "commands": count,
        "idle_commands": result.count["idle"],
        "poses": result.count["pose"],
        "differing": result.differing,
        "lost": result.lost,
        "unheard_wires": result.deaf,
        "whole": recording.whole,
        "damaged_at": recording.damaged_at,
        "overrides": list(overrides),
        "settings_left_out": left_out,
        "without_effect": [
            override
            for override in overrides
            if _key(override).partition(".")[0] not in FLOWN_AGAIN
        ],
        "changes": {
            name: _change([(p.recorded[i], p.replayed[i]) for p in result.commands])
            for i, name in enumerate(NAMES)
        },
        "saturated_fraction": sum(pair.saturated for pair in result.commands) / count
        if count
        else None,
        "recorded_by": {key: recording.about.get(key, "") for key in ("version", "git", "python")},
        "replayed_by": {key: own[key] for key in ("version", "git", "python")},
    }


def _key(override: str) -> str:
    return override.partition("=")[0].strip()


def _ensure_own(config: Config, path: Path) -> None:
    """Let no recording choose what code runs here: whoever has made it may have meant any."""
    if isinstance(config.controller, Custom):
        says = notice("replay.foreign_code", factory=config.controller.factory)
        raise ConfigError("controller.kind", says, str(path))


def _change(pairs: list[tuple[float, float]]) -> dict[str, float] | None:
    """Summarize the differences of replayed from recorded numbers; None without any."""
    if not pairs:
        return None
    steps = [abs(b - a) for a, b in pairs]
    return {
        "rms": (sum(step * step for step in steps) / len(steps)) ** 0.5,
        "max": max(steps),
        "recorded_mean": sum(a for a, _ in pairs) / len(pairs),
        "replayed_mean": sum(b for _, b in pairs) / len(pairs),
    }


def text_of(facts: dict[str, Any]) -> str:
    """Describe the result for people."""
    lines = [*_describe_recording(facts), *_describe_difference(facts)]
    if facts["without_effect"]:
        lines.append(
            f"{', '.join(facts['without_effect'])}: changes nothing here. The reference is the "
            "recorded one, and only pose source, gate, estimator and controller run again; to fly "
            "it otherwise, use the simulator"
        )
    if facts["overrides"]:
        lines += [
            "",
            f"with {', '.join(facts['overrides'])}, on the poses that were seen (nothing flies "
            "differently):",
        ]
    if not facts["identical"] and facts["commands"]:
        lines += _tabulate_changes(facts)
    if facts["recorded_by"] != facts["replayed_by"]:
        lines.append(_describe_versions(facts))
    if facts["settings_left_out"]:
        lines.append(notice("replay.settings", settings=", ".join(facts["settings_left_out"])).text)
    return "\n".join(lines)


def _describe_recording(facts: dict[str, Any]) -> Iterator[str]:
    """Describe what the recording holds, and what is missing of it."""
    cut_off = not facts["whole"] and facts["damaged_at"] is None
    yield (
        f"{facts['file']}: {facts['commands']} commands, {facts['idle_commands']} idle ones, "
        f"{facts['poses']} poses{f'; the recording was cut off, {END}' if cut_off else ''}"
    )
    if facts["damaged_at"] is not None:
        yield f"DAMAGED at byte {facts['damaged_at']}: the rest is not read, {END}"
    if facts["lost"]:
        yield f"{facts['lost']} records are missing: the recorder could not keep up"
    if facts["differing"]["pose"]:
        for wire in facts["unheard_wires"]:
            yield f"nobody listens on {wire} this time: what was heard there is left out"


def _describe_difference(facts: dict[str, Any]) -> Iterator[str]:
    """Whether all is the same to the last bit, and the first difference where it is not."""
    first = facts["first_difference"]
    if facts["identical"]:
        there = "" if facts["damaged_at"] is None else " before the damage"
        yield f"identical: every pose and every command{there} is the same to the last bit"
    elif first is not None:
        yield (
            f"not identical: {facts['differing']['command']} commands differ, first "
            f"{first['what']} {first['number']} at {first['time_s']:.6f} s, {first['field']}: "
            f"{first['recorded']} recorded, {first['replayed']} now"
        )


def _tabulate_changes(facts: dict[str, Any]) -> Iterator[str]:
    """A line a number of the command: its means, and how much it changed."""
    yield f"{'':20}{'mean recorded':>15}{'mean now':>12}{'change RMS':>12}{'largest':>12}"
    for name in NAMES:
        c = facts["changes"][name]
        recorded, replayed = c["recorded_mean"], c["replayed_mean"]
        yield f"{name:20}{recorded:>15.4f}{replayed:>12.4f}{c['rms']:>12.4f}{c['max']:>12.4f}"
    yield f"{'at a limit':20}{'':>15}{100.0 * facts['saturated_fraction']:>10.1f} %"


def _describe_versions(facts: dict[str, Any]) -> str:
    largest = [
        0.0 if facts["changes"][name] is None else facts["changes"][name]["max"] for name in NAMES
    ]
    return notice(
        "replay.versions",
        recorded=_name_program(facts["recorded_by"]),
        replayed=_name_program(facts["replayed_by"]),
        thrust_n=largest[0],
        rate_rad_s=max(largest[1:]),
    ).text


def _name_program(program: dict[str, str]) -> str:
    return (
        f"version {program['version']} ({program['git'][:12] or 'no commit'}) on Python "
        f"{program['python']}"
    )


Wire = tuple[str, str, str]
"""Kind, and both addresses as they were asked for (records.WireRecord)."""


class _Stopper(selectors.DefaultSelector):
    """Instead of waiting for anything, stops the loop."""

    loop: "TapeLoop"

    def select(self, timeout: float | None = None) -> Any:
        if timeout is None or timeout > 0.0:
            self.loop.stop()
        return super().select(0)


class TapeLoop(asyncio.SelectorEventLoop):
    """Runs only while :meth:`settle` does."""

    def __init__(self) -> None:
        self.now = 0.0
        """Time shown to the replayed code [s]."""
        selector = _Stopper()
        selector.loop = self
        super().__init__(selector)
        self._protocols: dict[Wire, list[Any]] = defaultdict(list)

    def time(self) -> float:
        """The recording's time [s]."""
        return self.now

    def settle(self) -> None:
        """Run until every task waits for something that is not on the tape yet, or for later."""
        self.run_forever()

    def protocol(self, wire: Wire) -> Any:
        """The code at our end of a wire that the recording says was opened now.

        None where nobody opened it.
        """
        opened = self._protocols[wire]
        return opened.pop(0) if opened else None

    def open(self, wire: Wire, factory: Callable[[], Any], local: Any) -> tuple[Any, Any]:
        """Remember who is at our end of ``wire``, and open it."""
        protocol = factory()
        self._protocols[wire].append(protocol)
        peer = tuple(wire[2].rsplit(":", 1)) if wire[2] and wire[0] != "serial" else None
        transport = _Mute(
            {"sockname": local or ("127.0.0.1", 0), "peername": peer, "socket": _NoSocket()}
        )
        protocol.connection_made(transport)
        return transport, protocol


class TapeNetwork(Network):
    """Wires that only hear, and are none."""

    def __init__(self, loop: TapeLoop) -> None:
        """Feed wires from the tape that ``loop`` runs by."""
        self._loop = loop

    async def open_datagram(
        self,
        factory: Callable[[], Any],
        local: Any = None,
        remote: Any = None,
        *,
        reuse_port: bool | None = None,
    ) -> tuple[Any, Any]:
        """A datagram endpoint."""
        # The port from which a remote address is spoken to is not what tells wires apart.
        return self._loop.open(
            ("udp", "" if remote else _address(local), _address(remote)), factory, local
        )

    async def open_stream(
        self, factory: Callable[[], Any], host: str, port: int
    ) -> tuple[Any, Any]:
        """A connection."""
        return self._loop.open(("tcp", "", _address((host, port))), factory, None)

    async def open_serial(
        self, factory: Callable[[], Any], path: str, baud: int
    ) -> tuple[Any, Any]:
        """A serial port."""
        return self._loop.open(("serial", "", path), factory, None)


@contextmanager
def tape_loop() -> Iterator[TapeLoop]:
    """A loop that what runs on it opens its wires by, and the end of all that still runs."""
    loop = TapeLoop()
    before = NETWORK.set(TapeNetwork(loop))
    try:
        yield loop
    finally:
        NETWORK.reset(before)
        for task in asyncio.all_tasks(loop):
            task.cancel()
        loop.settle()
        loop.close()


def _address(address: Any) -> str:
    return "" if address is None else f"{address[0]}:{address[1]}"


class _Mute(asyncio.DatagramTransport, asyncio.Transport):
    """A transport into nowhere."""

    def sendto(self, data: Any, addr: Any = None) -> None:
        pass

    def write(self, data: Any) -> None:
        pass

    def send(self, data: bytes) -> int:
        return len(data)

    def waiting(self) -> int:
        return 0

    def get_write_buffer_size(self) -> int:
        return 0

    def is_closing(self) -> bool:
        return False

    def close(self) -> None:
        pass

    def abort(self) -> None:
        pass


class _NoSocket:
    """Socket behind a replayed wire: every call does nothing."""

    def __getattr__(self, name: str) -> Callable[..., None]:
        return lambda *_: None

    def dup(self) -> "_NoSocket":
        return self

    def fileno(self) -> int:
        return 1 << 24


class Difference(msgspec.Struct, frozen=True):
    """Where recording and replay first part."""

    what: str
    """``pose``, ``idle`` or ``command``."""
    number: int
    """Which of them, from 0."""
    time_s: float
    """On the flight's clock [s]."""
    field: str
    recorded: Any
    replayed: Any


TOPICS = (
    "/raw/opened",
    "/raw/received",
    "/measured",
    "/follow",
    "/switch",
    "/idle",
    "/command",
    "/reference",
    "/lost",
)


class CommandPair(NamedTuple):
    """One command as recorded and as made anew: thrust [N] and body rates [rad/s]."""

    recorded: tuple[float, float, float, float]
    replayed: tuple[float, float, float, float]
    saturated: bool


@dataclass
class ReplayResult:
    """Result of a replay: what is the same and what is not."""

    commands: list[CommandPair] = field(default_factory=list)
    count: Counter[str] = field(default_factory=Counter)
    """Number of recorded poses, idle commands and commands, by ``pose``, ``idle`` and
    ``command``."""
    differing: dict[str, int] = field(default_factory=lambda: {"pose": 0, "idle": 0, "command": 0})
    """Number of those that differ in any bit."""
    first: Difference | None = None
    lost: int = 0
    """Records that the recorder had to leave out: then nothing can be the same."""
    deaf: list[str] = field(default_factory=list)
    """Wires whose bytes nobody took."""

    def compare(self, what: str, time_s: float, was: msgspec.Struct, now: msgspec.Struct) -> None:
        """Compare the next ``what`` as recorded, and as made anew."""
        for field_name in was.__struct_fields__:
            a, b = getattr(was, field_name), getattr(now, field_name)
            # In bytes, as the sign of a zero counts too.
            if msgspec.msgpack.encode(a) != msgspec.msgpack.encode(b):
                self.differ(what, time_s, field_name, a, b)
                return
        self.count[what] += 1

    def differ(
        self, what: str, time_s: float, field_name: str, recorded: Any, replayed: Any
    ) -> None:
        """Note that the next ``what`` differs in a field."""
        self.first = self.first or Difference(
            what, self.count[what], time_s, field_name, recorded, replayed
        )
        self.differing[what] += 1
        self.count[what] += 1


class ObedientPilot(Pilot):
    """A pilot whose vehicle may have been told something else."""

    def obey(self, time_s: float, command: Command) -> None:
        """Take the recorded ``command`` of ``time_s`` [s] in place of the new one: the vehicle
        moved by it.
        """
        drive = ActuatorCommand(command.thrust_n, command.rates_rad_s)
        self.state.estimator.add_command(time_s + self._vehicle.command_delay_s, drive)


class _RecordedReference:
    """The recorded reference, whatever time is asked for."""

    duration_s = None
    joints_s = ()

    def __init__(self) -> None:
        self.reference = Reference((0.0, 0.0, 0.0))

    def at(self, _time_s: float) -> Reference:
        return self.reference

    def position_at(self, _time_s: float) -> Vec3:
        return self.reference.position_ned


def fly_again(recording: Recording, config: Config) -> ReplayResult:
    """Fly ``recording`` again with ``config``, its own or a changed one.

    Raises:
        ConfigError: a controller of the user's own can't be loaded.
    """
    entries = list(recording.entries(TOPICS))
    with tape_loop() as loop:
        flight = _Replay(config, loop)
        for index, entry in enumerate(entries):
            flight.take(entry, entries, index)
    return flight.result


class _Replay:
    def __init__(self, config: Config, loop: TapeLoop) -> None:
        self._loop = loop
        self._link, self._source = make_ends(config)
        self._hears_link = config.pose.by_autopilot and config.link.has_autopilot
        self._pilot = ObedientPilot(
            config.vehicle, config.controller, config.flight.coast_s, config.flight.floor_z_m,
            follows_poses=self._link.follows_poses,
        )  # fmt: skip
        self._told = _RecordedReference()
        self._gate = Gate(config.gate)
        self._delivered: deque[Pose] = deque()
        self._wires: dict[int, Any] = {}
        self._begun = False
        self._turn = -1
        self._command: ch.CommandMessage | None = None
        self._end: Callable[[float], Command] | None = None
        self.result = ReplayResult()

    def take(self, entry: Entry, entries: list[Entry], index: int) -> None:
        """Replay one entry; ``entries`` and ``index`` show what it led to."""
        match entry.message():
            case ch.RawReceived() as received:
                self._receive(received, entries, index)
            case ch.ReferenceMessage() as reference:
                self._tick(reference)
            case ch.CommandMessage() as command:
                self._command = command
            case ch.MeasuredMessage() as seen:
                self._measure_pose(seen)
            case ch.IdleMessage() as idle:
                self._idle(idle)
            case ch.FollowMessage(time_s):
                self._pilot.follow(self._told, time_s)
            case ch.SwitchMessage() as switch:
                self._switch(switch)
            case ch.WireOpened() as opened:
                self._open_wire(opened)
            case ch.LostMessage(_, count):
                self.result.lost += count

    async def _connect(self) -> None:
        """As a flight does; but the link only where poses come by it, and never one with a pacer.

        A wire opened past the event loop would be real, with a real vehicle at its other end.
        """
        await self._source.start(self._deliver)
        if self._hears_link:
            await self._link.connect()

    def _deliver(self, pose: Pose) -> None:
        passed, _ = self._gate.filter_pose(pose)
        if passed is not None:
            self._delivered.append(passed)

    def _open_wire(self, opened: ch.WireOpened) -> None:
        self._loop.now = opened.time_s
        if not self._begun:
            self._begun = True
            self._connecting = self._loop.create_task(self._connect())
            self._connecting.add_done_callback(lambda task: task.cancelled() or task.exception())
        self._loop.settle()
        protocol = self._loop.protocol(
            (opened.kind, "" if opened.remote else opened.local, opened.remote)
        )
        self._wires[opened.wire] = protocol
        if protocol is None:
            self.result.deaf.append(f"{opened.kind} {opened.local or opened.remote}")

    def _receive(self, received: ch.RawReceived, entries: list[Entry], index: int) -> None:
        if received.turn != self._turn:  # in the same turn no task has run
            self._turn = received.turn
            self._loop.settle()
        protocol = self._wires.get(received.wire)
        if protocol is None:
            return
        # The source looks at the clock a moment after the tap did. What it saw stands in the pose
        # that it made.
        self._loop.now = _arrival_s(entries, index) or received.time_s
        if received.peer:
            host, _, port = received.peer.rpartition(":")
            protocol.datagram_received(received.data, (host, int(port)))
        else:
            protocol.data_received(received.data)

    def _measure_pose(self, seen: ch.MeasuredMessage) -> None:
        while self._delivered and self._delivered[0].id < seen.id:
            self._delivered.popleft()  # the flight did not take it either
        if not (self._delivered and self._delivered[0].id == seen.id):
            self._loop.settle()
        recorded = read_pose(seen)
        pose = (
            self._delivered.popleft()
            if self._delivered and self._delivered[0].id == seen.id
            else None
        )
        if pose is None:
            self.result.differ("pose", seen.arrival_s, "all of it", seen.id, None)
            pose = recorded
        else:
            self.result.compare("pose", seen.arrival_s, recorded, pose)
        self._pilot.estimate_state(pose)

    def _idle(self, idle: ch.IdleMessage) -> None:
        end, self._end = self._end, None
        command = self._pilot.idle(idle.time_s, idle.thrust_n) if end is None else end(idle.time_s)
        self.result.compare("idle", idle.time_s, read_command(idle), command)
        self._pilot.state.check_response()

    def _switch(self, switch: ch.SwitchMessage) -> None:
        pilot, values = self._pilot, switch.values
        match switch.what, len(values):
            case "stand", 0:
                pilot.set_on_floor()
            case "pause", 1:
                pilot.pause_response(bool(values[0]))
            case "agreement", 1:
                pilot.set_autopilot_agreement(None if values[0] < 0.0 else bool(values[0]))
            case "autopilot_attitude", 5:
                pilot.take_autopilot_attitude(
                    values[0], (values[1], values[2], values[3], values[4])
                )
            case "touch", 1:
                pilot.set_ground_contact(bool(values[0]))
            case "listen", 1:
                pilot.set_uplink_lost(bool(values[0]))
            case "lift", 3:
                pilot.lift_off(*values)
            case "descend", 3:
                pilot.descend(values[0], blind=bool(values[1]), extra_coast_s=values[2])
            case (
                "ease",
                2 | 3 | 4,
            ):  # the second is the first; of 2 no transit had limits, of 4 one each
                pilot.use_profile(
                    TRANSIT if any(values[2:3]) else HOLDING if values[0] else TRACKING
                )
            case "surrender", 1:
                self._end = partial(pilot.plan_open_loop_descent, hold_s=values[0])
            case "let_go", 1:
                self._end = partial(pilot.last_command, hold_s=values[0])
            case what, 1 if what.startswith(GAIN):
                pilot.set_gain(what.removeprefix(GAIN), values[0])

    def _tick(self, reference: ch.ReferenceMessage) -> None:
        recorded = self._command
        if recorded is None:
            return
        self._command = None
        self._told.reference = read_reference(reference)
        tick = self._pilot.compute_command(recorded.time_s)
        was, command = read_command(recorded), tick.command
        if was != command:
            self._pilot.obey(recorded.time_s, was)
        self._pilot.state.check_response()
        self.result.compare("command", recorded.time_s, was, command)
        self.result.commands.append(
            CommandPair(
                (was.thrust_n, *was.rates_rad_s),
                (command.thrust_n, *command.rates_rad_s),
                bool(tick.decision.saturated),
            )
        )


def _arrival_s(entries: list[Entry], index: int) -> float | None:
    """When the pose arrived that the bytes at ``index`` brought [s].

    None where they brought none.
    """
    for following in range(index + 1, len(entries)):
        entry = entries[following]
        if entry.topic == "/measured":
            arrival_s: float = entry.message().arrival_s
            return arrival_s
        if entry.topic == "/raw/received":
            break
    return None
