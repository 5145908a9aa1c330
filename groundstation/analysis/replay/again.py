"""Replay: a recorded flight flown again, its bytes through source and estimator, its instants through the controller.

What went in is taken from the recording: every byte with its arrival, the instant of every command, the reference. What
came out, every pose and every command, is made anew and held against what was recorded, to the last bit.
"""

import math
from collections import deque
from typing import Any, NamedTuple

import msgspec

from groundstation.analysis.replay.tape import TapeLoop, tape_loop
from groundstation.core import Pilot
from groundstation.core.geometry import Quat, Vec3
from groundstation.core.messages import Pose
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import Drive
from groundstation.flight import make_ends
from groundstation.pose import Gate
from groundstation.pose.sources import MavlinkPoseConfig
from groundstation.recording import GAIN, Entry, Quaternion, Recording, Vector3
from groundstation.recording import channels as ch
from groundstation.settings import Config
from links.core import Command, Segment
from links.mavlink import MavlinkLinkConfig


def read_pose(seen: ch.MeasuredMessage) -> Pose:
    """The pose as the pilot got it."""
    velocity = None if seen.velocity_ned is msgspec.UNSET else _tuple(seen.velocity_ned)
    at, attitude = _tuple(seen.position_ned), _quat(seen.attitude)
    return Pose(seen.id, seen.time_s, seen.arrival_s, at, attitude, velocity, seen.reset_count)


def read_reference(r: ch.ReferenceMessage) -> Reference:
    """Where the vehicle should have been."""
    return Reference(
        _tuple(r.position_ned),
        _tuple(r.velocity_ned),
        _tuple(r.acceleration_ned),
        _tuple(r.jerk_ned),
        r.yaw_rad,
        r.yaw_rate_rad_s,
    )


def read_command(c: ch.CommandMessage | ch.IdleMessage) -> Command:
    """The command as it was handed to the link."""
    parts = tuple(Segment(part.duration_s, part.thrust_n, _tuple(part.rates_rad_s)) for part in c.bring_down)
    return Command(c.thrust_n, _tuple(c.rates_rad_s), c.pose_id, c.pose_time_s, c.deadline_s, parts)


def _tuple(v: Vector3) -> Vec3:
    return (v.x, v.y, v.z)


def _quat(q: Quaternion) -> Quat:
    return (q.w, q.x, q.y, q.z)


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


class Comparison:
    """Counts what is the same and what is not."""

    def __init__(self) -> None:
        """Nothing compared."""
        self.count = {"pose": 0, "idle": 0, "command": 0}
        """How many of each were recorded."""
        self.differing = {"pose": 0, "idle": 0, "command": 0}
        """How many of them are not the same."""
        self.first: Difference | None = None

    def compare(self, what: str, time_s: float, was: msgspec.Struct, now: msgspec.Struct) -> None:
        """The next ``what`` as recorded, and as made anew."""
        number = self._next(what)
        for field in was.__struct_fields__:
            a, b = getattr(was, field), getattr(now, field)
            if a != b or _signs(a) != _signs(b):
                self._differ(Difference(what, number, time_s, field, a, b))
                return

    def missing(self, what: str, time_s: float, was: Any) -> None:
        """The next ``what``, as recorded, was not made anew."""
        self._differ(Difference(what, self._next(what), time_s, "all of it", was, None))

    def _next(self, what: str) -> int:
        number = self.count[what]
        self.count[what] = number + 1
        return number

    def _differ(self, difference: Difference) -> None:
        self.differing[difference.what] += 1
        self.first = self.first or difference


def _signs(value: Any) -> Any:
    """The sign of a zero counts too."""
    if isinstance(value, tuple):
        return tuple(map(_signs, value))
    if isinstance(value, msgspec.Struct):
        return tuple(map(_signs, msgspec.structs.astuple(value)))
    return math.copysign(1.0, value) if isinstance(value, float) else None


TOPICS = ("/raw/opened", "/raw/received", "/measured", "/follow", "/switch", "/idle", "/command", "/reference", "/lost")


class Pair(NamedTuple):
    """One command as recorded and as made anew: thrust [N] and body rates [rad/s]."""

    recorded: tuple[float, float, float, float]
    replayed: tuple[float, float, float, float]
    saturated: bool


class Reflown(msgspec.Struct, frozen=True):
    """What came of it."""

    commands: list[Pair]
    poses: int
    idle: int
    differing: dict[str, int]
    """How many poses, idle commands and commands are not the same to the last bit."""
    first: Difference | None
    lost: int
    """Records that the recorder had to leave out: then nothing can be the same."""
    deaf: list[str]
    """Wires whose bytes nobody took."""


class _Pilot(Pilot):
    """A pilot whose vehicle may have been told something else."""

    def obeyed(self, time_s: float, command: Command) -> None:
        """What left at ``time_s`` [s] was ``command``, whatever was made anew: the vehicle moved by that one."""
        drive = Drive(command.thrust_n, command.rates_rad_s)
        self._estimator.sent(time_s + self._vehicle.command_delay_s, drive)


class _Told:
    """The recorded reference, whatever time is asked for."""

    duration_s = None
    joints_s = ()

    def __init__(self) -> None:
        self.reference = Reference((0.0, 0.0, 0.0))

    def at(self, _time_s: float) -> Reference:
        return self.reference

    def position_at(self, _time_s: float) -> Vec3:
        return self.reference.position_ned


def fly_again(recording: Recording, config: Config) -> Reflown:
    """Fly ``recording`` again with ``config``, its own or a changed one.

    Raises:
        ConfigError: a controller of the user's own can't be loaded.
    """
    entries = list(recording.entries(TOPICS))
    with tape_loop() as loop:
        flight = _Again(config, loop)
        for index, entry in enumerate(entries):
            flight.take(entry, entries, index)
    return flight.result()


class _Again:
    def __init__(self, config: Config, loop: TapeLoop) -> None:
        self._loop = loop
        self._link, self._source = make_ends(config)
        self._hears_link = isinstance(config.pose, MavlinkPoseConfig) and isinstance(config.link, MavlinkLinkConfig)
        self._pilot = _Pilot(config.vehicle, config.controller, config.flight.coast_s, config.flight.floor_z_m)
        self._told = _Told()
        self._gate = Gate(config.gate)
        self._delivered: deque[Pose] = deque()
        self._wires: dict[int, Any] = {}
        self._deaf: list[str] = []
        self._begun = False
        self._turn = -1
        self._command: ch.CommandMessage | None = None
        self._surrender_s: float | None = None
        self._pairs: list[Pair] = []
        self._comparison = Comparison()
        self._lost = 0

    def take(self, entry: Entry, entries: list[Entry], index: int) -> None:
        """What happened next; ``entries`` and ``index`` for a look at what it led to."""
        match entry.topic:
            case "/raw/received":
                self._received(msgspec.json.decode(entry.data, type=ch.RawReceived), entries, index)
            case "/reference":
                self._tick(msgspec.json.decode(entry.data, type=ch.ReferenceMessage))
            case "/command":
                self._command = msgspec.json.decode(entry.data, type=ch.CommandMessage)
            case "/measured":
                self._measured(msgspec.json.decode(entry.data, type=ch.MeasuredMessage))
            case "/idle":
                self._idle(msgspec.json.decode(entry.data, type=ch.IdleMessage))
            case "/follow":
                self._pilot.follow(self._told, msgspec.json.decode(entry.data, type=ch.FollowMessage).time_s)
            case "/switch":
                self._switch(msgspec.json.decode(entry.data, type=ch.SwitchMessage))
            case "/raw/opened":
                self._opened(msgspec.json.decode(entry.data, type=ch.WireOpened))
            case "/lost":
                self._lost += msgspec.json.decode(entry.data, type=ch.LostMessage).count

    def result(self) -> Reflown:
        c = self._comparison
        return Reflown(self._pairs, c.count["pose"], c.count["idle"], c.differing, c.first, self._lost, self._deaf)

    async def _connect(self) -> None:
        """As a flight does; but the link only where poses come by it, and never one with a pacer.

        What is opened past the event loop would be a real wire, with a real vehicle at its other end.
        """
        await self._source.start(self._deliver)
        if self._hears_link:
            await self._link.connect()

    def _deliver(self, pose: Pose) -> None:
        passed, _ = self._gate.take(pose)
        if passed is not None:
            self._delivered.append(passed)

    def _opened(self, opened: ch.WireOpened) -> None:
        self._loop.now = opened.time_s
        if not self._begun:
            self._begun = True
            self._connecting = self._loop.create_task(self._connect())
            self._connecting.add_done_callback(lambda task: task.cancelled() or task.exception())
        self._loop.settle()
        protocol = self._loop.protocol((opened.kind, opened.local, opened.remote))
        self._wires[opened.wire] = protocol
        if protocol is None:
            self._deaf.append(f"{opened.kind} {opened.local or opened.remote}")

    def _received(self, received: ch.RawReceived, entries: list[Entry], index: int) -> None:
        if received.turn != self._turn:  # in the same turn no task has run
            self._turn = received.turn
            self._loop.settle()
        protocol = self._wires.get(received.wire)
        if protocol is None:
            return
        # The source looks at the clock a moment after the tap did. What it saw stands in the pose that it made.
        self._loop.now = _arrival_s(entries, index) or received.time_s
        if received.peer:
            host, _, port = received.peer.rpartition(":")
            protocol.datagram_received(received.data, (host, int(port)))
        else:
            protocol.data_received(received.data)

    def _measured(self, seen: ch.MeasuredMessage) -> None:
        while self._delivered and self._delivered[0].id < seen.id:
            self._delivered.popleft()  # the flight did not take it either
        if not (self._delivered and self._delivered[0].id == seen.id):
            self._loop.settle()
        recorded = read_pose(seen)
        pose = self._delivered.popleft() if self._delivered and self._delivered[0].id == seen.id else None
        if pose is None:
            self._comparison.missing("pose", seen.arrival_s, seen.id)
            pose = recorded
        else:
            self._comparison.compare("pose", seen.arrival_s, recorded, pose)
        self._pilot.pose(pose)

    def _idle(self, idle: ch.IdleMessage) -> None:
        pilot, hold_s = self._pilot, self._surrender_s
        command = pilot.idle(idle.time_s, idle.thrust_n) if hold_s is None else pilot.surrender(idle.time_s, hold_s)
        self._surrender_s = None
        self._comparison.compare("idle", idle.time_s, read_command(idle), command)

    def _switch(self, switch: ch.SwitchMessage) -> None:
        pilot, values = self._pilot, switch.values
        match switch.what, len(values):
            case "stand", 0:
                pilot.stand()
            case "lift", 3:
                pilot.lift(*values)
            case "descend", 3:
                pilot.descend(values[0], blind=bool(values[1]), rest_s=values[2])
            case "surrender", 1:
                self._surrender_s = values[0]
            case what, 1 if what.startswith(GAIN):
                pilot.gain(what.removeprefix(GAIN), values[0])

    def _tick(self, reference: ch.ReferenceMessage) -> None:
        recorded = self._command
        if recorded is None:
            return
        self._command = None
        self._told.reference = read_reference(reference)
        tick = self._pilot.tick(recorded.time_s)
        was, command = read_command(recorded), tick.command
        if was != command:
            self._pilot.obeyed(recorded.time_s, was)
        self._comparison.compare("command", recorded.time_s, was, command)
        self._pairs.append(
            Pair(
                (was.thrust_n, *was.rates_rad_s),
                (command.thrust_n, *command.rates_rad_s),
                bool(tick.decision.saturated),
            )
        )


def _arrival_s(entries: list[Entry], index: int) -> float | None:
    """When the pose arrived that the bytes at ``index`` brought [s]; None where they brought none."""
    for following in range(index + 1, len(entries)):
        entry = entries[following]
        if entry.topic == "/measured":
            return msgspec.json.decode(entry.data, type=ch.MeasuredMessage).arrival_s
        if entry.topic == "/raw/received":
            break
    return None
