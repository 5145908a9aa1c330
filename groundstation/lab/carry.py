"""``groundstation carry``: the vehicle is carried by hand along shown moves, and its tracker's axes are written."""

import asyncio
import json
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import tomli_w

from groundstation.config import ConfigError, load
from groundstation.core.geometry import Alignment
from groundstation.core.messages import Pose, PoseEvent, SourceError
from groundstation.lab.pose_monitor import open_ears
from groundstation.lab.pose_stream import MOVES, AxisCalibration, Carry, CarryContradiction, Sample, solve_axes
from groundstation.runtime import INTERRUPTED
from groundstation.settings import Config
from links.core import LinkError
from links.mavlink import MavlinkConnection
from links.mavlink.protocol import Message

_HEADER = re.compile(r"\s*\[\s*([^\[\]]+?)\s*\]\s*(#.*)?$")

Value = str | float | Sequence[float]


def set_keys(text: str, table: str, keys: Mapping[str, Value]) -> str:
    """``text`` (TOML) with ``keys`` set in ``table``, each on a line of its own; new tables go to the end.

    Sees tables that have a header, and keys that are written on one line.
    """
    lines = text.splitlines()
    begin = next((n for n, line in enumerate(lines) if (m := _HEADER.match(line)) and m[1] == table), None)
    if begin is None:
        return "\n".join([*lines, *([""] if lines else []), f"[{table}]", *map(_line, keys.items())]) + "\n"
    end = next((n for n in range(begin + 1, len(lines)) if lines[n].lstrip().startswith("[")), len(lines))
    body = lines[begin + 1 : end]
    for key, value in keys.items():
        mine = re.compile(rf"\s*{re.escape(key)}\s*=")
        at = next((n for n, line in enumerate(body) if mine.match(line)), None)
        if at is None:
            after = max((n for n, line in enumerate(body) if line.strip()), default=-1)
            body.insert(after + 1, _line((key, value)))
        else:
            body[at] = _line((key, value))
    return "\n".join([*lines[: begin + 1], *body, *lines[end:]]) + "\n"


def write_keys(path: Path, tables: Mapping[str, Mapping[str, Value]], expected: Config) -> Path:
    """Set the keys of ``tables`` in the file ``path``; returns where the file as it was is kept.

    Raises:
        ConfigError: it can't be written, or what would be read from it then is not ``expected``; it is left as it was.
    """
    by_hand = "; ".join(f"[{table}] {' '.join(map(_line, keys.items()))}" for table, keys in tables.items() if keys)
    try:
        before = path.read_text("utf-8")
        text = before
        for table, keys in tables.items():
            text = set_keys(text, table, keys) if keys else text
        new, kept = path.with_name(f"{path.name}.new"), path.with_name(f"{path.name}.before-carry")
        new.write_text(text, "utf-8")
        try:
            understood = load(new, Config) == expected
        except ConfigError:
            understood = False
        if not understood:
            new.unlink()
            raise ConfigError(
                "", f"is written in a way that can't be changed here; put this into it: {by_hand}", str(path)
            )
        kept.write_text(before, "utf-8")
        new.replace(path)
    except OSError as error:
        raise ConfigError("", f"can't be written ({error.strerror}); put this into it: {by_hand}", str(path)) from None
    return kept


def _line(item: tuple[str, Value]) -> str:
    key, value = item
    plain = list(value) if isinstance(value, tuple | list) else value
    return f"{key} = " + re.sub(r"\s+", " ", tomli_w.dumps({"v": plain}).removeprefix("v = ")).strip().replace(
        ",]", "]"
    )


EXIT_FOUND, EXIT_CONTRADICTION, EXIT_NO_SOURCE = 0, 1, 3
ATTITUDE_HZ = 100.0
"""The autopilot is asked for its attitude so often [1/s]."""
PATIENCE_S = 120.0
"""How long one move may take [s]."""
NOT_SEEN = "This link does not tell whether the vehicle is armed: see that it is not."
LOOK_S = 0.1
LATE_S = 0.002
"""A smaller error of the configured latency is none [s]."""


class CarryRecord(NamedTuple):
    """What was seen of the moves."""

    carry: Carry
    autopilot: list[Sample]
    synchronised: bool
    """Whether the autopilot has told its time."""


class CarryRefused(Exception):
    """The carry can't go on; the text says why, and what to do."""


def carry_command(config: Config, path: Path, overrides: list[str], *, as_json: bool, keep: bool) -> int:
    """Show the moves, and write what they tell into the file ``path`` unless ``keep``.

    Returns 0 where all fits, 1 where a move contradicts or was not made, 3 where poses or autopilot can't be heard,
    130 after Ctrl-C.

    Raises:
        ConfigError: these poses have no axes to find, or the file can't be written.
    """
    _check(config)
    if overrides and not keep:
        raise ConfigError(
            "--set", "with overrides nothing can be written into the file: add --dry-run, or leave them out"
        )

    def say(line: str) -> None:
        print(line, file=sys.stderr if as_json else sys.stdout, flush=True)

    facts: dict[str, Any] = {"ok": False, "move": None, "why": None, "found": None, "written": None}

    def not_found(why: str) -> None:
        if as_json:
            print(json.dumps(facts | {"why": why}))

    try:
        seen = asyncio.run(record_moves(config, say))
        found = solve_axes(seen.carry.rests, seen.carry.samples, seen.autopilot)
    except (SourceError, LinkError) as error:
        print(f"groundstation: carry: {error}", file=sys.stderr)
        not_found(str(error))
        return EXIT_NO_SOURCE
    except KeyboardInterrupt:
        print("groundstation: carry: interrupted, nothing is written", file=sys.stderr)
        not_found("interrupted")
        return INTERRUPTED
    except (CarryContradiction, CarryRefused) as error:
        facts["move"] = getattr(error, "move", "") or None
        say(f"NOT FOUND: {error}")
        not_found(str(error))
        return EXIT_CONTRADICTION
    tables, changed = calibrated_config(config, found)
    facts |= {"ok": True, "found": msgspec.to_builtins(found), "set": tables, "synchronised": seen.synchronised}
    for line in describe_calibration(found, tables, synchronised=seen.synchronised):
        say(line)
    if not keep:
        kept = write_keys(path, tables, changed)
        facts["written"] = str(path)
        say(f"written into {path}; as it was before: {kept}")
    if as_json:
        print(json.dumps(facts))
    return EXIT_FOUND


async def record_moves(config: Config, say: Callable[[str], None]) -> CarryRecord:
    """Have all the moves made; ``say`` tells the operator what to do.

    Raises:
        Refused: the vehicle is armed, or a move was not made for two minutes.
        SourceError: the source can't be started.
        LinkError: the autopilot does not answer.
    """
    loop = asyncio.get_running_loop()
    has_autopilot = config.link.has_autopilot
    carry, felt = Carry(), list[tuple[float, Sample]]()
    begun, ended = asyncio.Event(), asyncio.Event()

    def pose(pose: Pose) -> None:
        # A move that the autopilot has not seen, or the operator not been told of, does not count.
        if (
            begun.is_set()
            and (felt or not has_autopilot)
            and carry.pose(Sample(pose.time_s, pose.attitude, pose.position_ned))
        ):
            ended.set()

    def hear(message: Message, arrival_s: float) -> None:
        if message.get_type() == "ATTITUDE_QUATERNION":
            attitude = (message.q1, message.q2, message.q3, message.q4)
            felt.append((arrival_s, Sample(message.time_boot_ms * 1e-3, attitude)))

    def ask(connection: MavlinkConnection) -> None:
        connection.request(lambda _kind: {"ATTITUDE_QUATERNION": ATTITUDE_HZ})
        connection.subscribe(hear)

    def ignore(_: Pose | PoseEvent) -> None:
        """The gate knows nothing of a tracker whose axes are not known."""

    async with open_ears(
        in_tracker_axes(config), ignore, raw=pose, tell=ignore, autopilot=ask if has_autopilot else None
    ) as ears:
        connection = ears.connection
        say("Propellers off. Nothing is commanded." if has_autopilot else f"Propellers off. {NOT_SEEN}")
        while (move := carry.move) is not None:
            say(f"{len(carry.rests) + 1} of {len(MOVES)}: {move.say}")
            begun.set()
            ended.clear()
            give_up_s = loop.time() + PATIENCE_S
            while not ended.is_set():
                await asyncio.sleep(LOOK_S)
                if connection is not None and connection.state != "connected":
                    raise CarryRefused(_state(connection))
                if loop.time() > give_up_s:
                    dropped = ears.source.status.dropped
                    seen = f"; poses are dropped: {dropped}" if dropped else ""
                    if has_autopilot and not felt:
                        seen = "; the autopilot does not send its attitude"
                    raise CarryRefused(f"'{move.name}' was not made within {PATIENCE_S:.0f} s{seen}. See check --watch")
        clock = connection.clock if connection is not None else None
    return CarryRecord(
        carry, [_on_our_clock(arrival_s, sample, clock) for arrival_s, sample in felt], clock is not None
    )


def _on_our_clock(arrival_s: float, sample: Sample, clock: Any) -> Sample:
    time_s = arrival_s if clock is None else sample.time_s - clock.offset_s
    return msgspec.structs.replace(sample, time_s=time_s)


def _state(connection: MavlinkConnection) -> str:
    if connection.state == "armed":
        return "the vehicle is ARMED: disarm it, take its propellers off, and begin anew"
    return f"the autopilot is {connection.state}, so nobody knows whether it is armed: {connection.text}"


def in_tracker_axes(config: Config) -> Config:
    """``config`` with poses that stay in the tracker's own axes."""
    pose: Any = config.pose
    plain = msgspec.structs.replace(pose, world="ned", body="frd", alignment=Alignment())
    return msgspec.structs.replace(config, pose=plain)


def calibrated_config(config: Config, found: AxisCalibration) -> tuple[dict[str, dict[str, Value]], Config]:
    """The keys to write, by table, and the configuration that they make."""
    pose: Any = config.pose
    top: dict[str, Value] = {"world": found.world, "body": found.body}
    latency = "network_s" if hasattr(pose, "network_s") else "latency_s"
    if found.late_s is not None and abs(found.late_s) > LATE_S and hasattr(pose, latency):
        top[latency] = round(min(max(getattr(pose, latency) + found.late_s, 0.0), 1.0), 4)
    turned: dict[str, Value] = {}
    for key in ("lab_rotation_deg", "body_rotation_deg"):
        value = getattr(found, key)
        if value != getattr(pose.alignment, key):
            turned[key] = value
    alignment = msgspec.structs.replace(pose.alignment, **turned)
    changed = msgspec.structs.replace(pose, alignment=alignment, **top)
    return {"pose": top, "pose.alignment": turned}, msgspec.structs.replace(config, pose=changed)


def describe_calibration(
    found: AxisCalibration, tables: Mapping[str, Mapping[str, Value]], *, synchronised: bool
) -> list[str]:
    """What was found, for people."""
    lines = [f"the lab's axes are '{found.world}', the body's are '{found.body}'"]
    if any(found.lab_rotation_deg):
        lines.append(f"the lab's north lies {found.lab_rotation_deg[2]:+.1f}° to the right of where the nose was")
    if any(found.body_rotation_deg):
        roll, pitch, yaw = found.body_rotation_deg
        lines.append(
            f"the tracked body lies askew on the vehicle: roll {roll:+.1f}, pitch {pitch:+.1f}, yaw {yaw:+.1f}°"
        )
    if found.autopilot_north_deg is not None:
        lines.append(f"the autopilot's north lies {found.autopilot_north_deg:+.0f}° to the right of ours")
    if found.late_s is not None:
        clock = "" if synchronised else ", not counting the way of its messages to here, as it does not tell its time"
        way = "older" if found.late_s >= 0.0 else "younger"
        lines.append(f"by the autopilot poses are {1e3 * abs(found.late_s):.0f} ms {way} than they are stamped{clock}")
    elif found.match:
        lines.append(f"tracker and autopilot turn too differently to tell the latency (match {found.match:.2f})")
    for table, keys in tables.items():
        lines += [f"  {table}.{key} = {value!r}" for key, value in keys.items()]
    return lines


def _check(config: Config) -> None:
    if config.pose.by_autopilot or config.pose.recorded:
        raise ConfigError("pose.kind", "expected a tracking system that runs: other poses have no axes to find")
