"""Pose monitor, ``groundstation check --watch``: any pose source live, without flying, and carried
along shown moves.

For the monitor no command link is opened, so nothing that moves a vehicle can leave. For
``groundstation carry`` the vehicle is carried by hand, and its tracker's axes are written.
"""

import asyncio
import contextlib
import json
import math
import re
import signal
import sys
from collections.abc import AsyncIterator, Callable, Iterator, Mapping, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import msgspec

from groundstation.config import ConfigError, load, write_value
from groundstation.core.geometry import Alignment, Vec3
from groundstation.core.messages import (
    OverheardSource,
    Pose,
    PoseKind,
    PoseSource,
    PoseStatus,
    SourceError,
    Verdict,
    notice,
)
from groundstation.flight.preflight import FEW_HZ, explain_drops
from groundstation.lab.pose_stream import (
    MOVES,
    WINDOW_S,
    AxisCalibration,
    Carry,
    CarryFailure,
    PoseStreamMonitor,
    PoseStreamSummary,
    Sample,
    solve_axes,
)
from groundstation.machine import wait_at_most, write_whole
from groundstation.pose import check_stamp_rate, make_source
from groundstation.pose.sources import GatedSource, describe_drop, describe_unsteady_clock
from groundstation.runtime import Exit, raw_stream
from groundstation.settings import Config
from links import make_link
from links.core import Attitude, LinkError
from links.mavlink import MavlinkConnection, MavlinkLink, MavlinkLinkConfig
from links.mavlink.protocol import ATTITUDE_HZ, Message, attitude_of
from links.text import Sentence, printable

if TYPE_CHECKING:
    from rich.table import Table


class Ears(msgspec.Struct, frozen=True):
    """Open sources."""

    source: PoseSource
    """Behind the gate."""
    connection: MavlinkConnection | None
    """To the autopilot, where that was wanted; only what it is asked for, and our heartbeat, leave
    on it."""
    names: Callable[[], tuple[str, ...]]
    """The bodies that the source has, where it has told."""


@asynccontextmanager
async def open_ears(
    config: Config,
    deliver: Callable[[Pose], None],
    *,
    raw: Callable[[Pose], None] | None = None,
    tell: Callable[[Sentence], None],
    autopilot: Callable[[MavlinkConnection], None] | None = None,
) -> AsyncIterator[Ears]:
    """Listen to the poses of ``config`` for as long as the block lasts.

    ``deliver`` gets those that pass the gate, ``raw`` every one, ``tell`` what happens to them. The
    autopilot is connected to where poses come by it, or where ``autopilot`` is given: it may ask
    for messages before.

    Raises:
        ConfigError: the poses need another link.
        SourceError: the source can't be started.
        LinkError: the autopilot does not answer.
    """
    settings = config.link
    if isinstance(settings, MavlinkLinkConfig):  # what it sends to others is none of our business
        settings = msgspec.structs.replace(settings, quiet=False)
    link = make_link(settings, thrust_max_n=config.full_thrust_n, thrust_curve=config.thrust_curve)
    inner = make_source(config.pose, link)
    heard = inner if raw is None else OverheardSource(inner, raw)
    source = GatedSource(heard, config.gate, lost_s=config.flight.coast_s, say=tell)
    connection = None
    if isinstance(link, MavlinkLink) and (autopilot is not None or config.pose.by_autopilot):
        connection = link.connection
        if autopilot is not None:
            autopilot(connection)
    try:
        await source.start(deliver)
        if connection is not None:
            await connection.open()
        yield Ears(source, connection, lambda: getattr(inner, "other_objects", ()))
    finally:
        await source.close()
        if connection is not None:
            connection.close()
        await asyncio.sleep(0)  # sockets are released in the loop's next turn


REFRESH_S = 0.25
"""Period at which a summary is shown, and a move's progress looked at [s]."""


def watch_poses(config: Config, *, seconds: float | None, as_json: bool) -> Exit:
    """Watch until ``seconds`` [s] have passed, or Ctrl-C.

    Returns 0 where poses come, 1 where none or too few do, 3 without a source.

    Raises:
        ConfigError: the poses need another link.
    """
    kind = config.pose.kind
    try:
        if as_json:
            seen = asyncio.run(listen(config, seconds or WINDOW_S))
            print(json.dumps({"source": kind, "ok": seen.ok, **msgspec.to_builtins(seen)}))
        else:
            seen = asyncio.run(
                _listen_on_screen(
                    config,
                    seconds,
                    notice("watch.title", kind=kind, vehicle=config.vehicle.name).text,
                )
            )
    except (SourceError, LinkError) as error:
        print(f"groundstation: check: {error}", file=sys.stderr)
        if as_json:
            print(json.dumps({"source": kind, "ok": False, "error": str(error)}))
        return Exit.UNHEARD
    return Exit.DONE if seen.ok else Exit.FAILED


async def listen(
    config: Config, seconds: float | None, show: Callable[[PoseStreamSummary], None] | None = None
) -> PoseStreamSummary:
    """Observe the source of ``config`` for ``seconds`` [s].

    ``show`` is called a few times a second.

    Raises:
        ConfigError: the poses need another link.
        SourceError: the source can't be started.
        LinkError: the autopilot, by which the poses would come, does not answer.
    """
    loop = asyncio.get_running_loop()
    watcher = PoseStreamMonitor(loop.time(), floor_z_m=config.flight.floor_z_m)

    def tell(event: Sentence) -> None:
        watcher.event(event, loop.time())

    def look(ears: Ears) -> PoseStreamSummary:
        status = ears.source.status
        if ears.connection is not None and (conflict := ears.connection.conflict):
            status = msgspec.structs.replace(status, advice=conflict)
        fault = _find_stamp_fault(status, config.pose)
        seen = watcher.summarize(loop.time(), status, ears.names(), stamp_fault=fault)
        if seen.advice or not 0.0 < seen.rate_hz < FEW_HZ:
            return seen
        low = notice("check.pose_rate_low", rate_hz=seen.rate_hz, nominal="", limit_hz=FEW_HZ)
        return msgspec.structs.replace(seen, advice=low.text)

    with _interrupt(loop) as stopped:
        async with open_ears(config, watcher.pose, tell=tell) as ears:
            left_s = math.inf if seconds is None else seconds
            while left_s > 0.0 and not stopped.is_set():
                await wait_at_most(stopped.wait(), min(REFRESH_S, left_s))
                left_s -= REFRESH_S
                if show is not None:
                    show(look(ears))
            return look(ears)


def _find_stamp_fault(status: PoseStatus, kind: PoseKind) -> str:
    """Describe the fault of the stamps, unit or clock; empty where there is none."""
    rate = check_stamp_rate(status, kind)
    if rate is not None and rate.verdict is Verdict.FAIL:
        return rate.says
    return describe_unsteady_clock().text if status.unsteady_clock else ""


async def _listen_on_screen(config: Config, seconds: float | None, title: str) -> PoseStreamSummary:
    from rich.console import Console
    from rich.live import Live

    console = Console(file=raw_stream(sys.stdout))
    if not console.is_terminal:  # a pipe gets the end of it only
        seen = await listen(config, seconds)
        console.print(summary_table(title, seen))
        return seen
    with Live(console=console, auto_refresh=False) as live:
        return await listen(
            config, seconds, lambda seen: live.update(summary_table(title, seen), refresh=True)
        )


@contextlib.contextmanager
def _interrupt(loop: asyncio.AbstractEventLoop) -> Iterator[asyncio.Event]:
    """An event that Ctrl-C sets, where the loop has signals at all."""
    stopped = asyncio.Event()
    with contextlib.suppress(NotImplementedError, ValueError):
        loop.add_signal_handler(signal.SIGINT, stopped.set)
    try:
        yield stopped
    finally:
        with contextlib.suppress(NotImplementedError, ValueError):
            loop.remove_signal_handler(signal.SIGINT)


def summary_rows(seen: PoseStreamSummary) -> list[tuple[str, str]]:
    """Describe the stream in words."""
    lines = [
        _row(
            "watch.poses",
            count=seen.poses,
            rate_hz=seen.rate_hz,
            source_rate_hz=seen.source_rate_hz,
        ),
        ("age", _age(seen)),
        _row("watch.latency", latency_ms=1e3 * seen.latency_s, most_ms=1e3 * seen.latency_max_s),
        _row("watch.jitter", jitter_ms=1e3 * seen.jitter_s, longest_ms=1e3 * seen.longest_s),
        ("gaps", _gaps(seen)),
    ]
    if seen.stamp_fault:
        lines.append(("stamps", seen.stamp_fault))
    if seen.position_ned is not None and seen.roll_pitch_yaw_deg is not None:
        north, east, down = seen.position_ned
        lines.append(
            _row("watch.place", north_m=north, east_m=east, height_m=seen.floor_z_m - down)
        )
        roll, pitch, yaw = seen.roll_pitch_yaw_deg
        lines.append(_row("watch.attitude", roll_deg=roll, pitch_deg=pitch, yaw_deg=yaw))
        lines.append(("noise at rest", _noise(seen.noise_m, seen.noise_deg)))
    lines += [
        ("dropped", f"{count} {describe_drop(reason, seen.excesses)}")
        for reason, count in seen.dropped.items()
    ]
    if seen.advice:
        lines.append(("advice", seen.advice))
    if not seen.poses and not seen.dropped:
        lines.append(("", notice("watch.nothing").text))
    if seen.bodies:
        lines.append(("bodies there", ", ".join(map(printable, seen.bodies))))
    lines += [("", printable(event)) for event in seen.events]
    return lines


def summary_table(title: str, seen: PoseStreamSummary) -> "Table":
    """Draw the stream as a table of rich."""
    from rich.table import Table
    from rich.text import Text

    drawn = Table(title=title, show_header=False, title_justify="left", min_width=72)
    drawn.add_column(style="dim", no_wrap=True)
    drawn.add_column()
    for name, text in summary_rows(seen):
        bad = name in ("dropped", "stamps", "advice") or (name == "age" and not seen.ok)
        drawn.add_row(name, Text(text, style="bold yellow" if bad else ""))
    return drawn


def _age(seen: PoseStreamSummary) -> str:
    return (
        notice("watch.no_pose")
        if seen.age_s is None
        else notice("watch.age", age_ms=1e3 * seen.age_s)
    ).text


def _row(id: str, **numbers: float) -> tuple[str, str]:
    """Return a row of the table: what the sentence is about, and the sentence."""
    return id.removeprefix("watch."), notice(id, **numbers).text


def _gaps(seen: PoseStreamSummary) -> str:
    if seen.drift is None:
        return notice("watch.gaps", gaps=seen.gaps, steps=seen.clock_steps).text
    return notice(
        "watch.gaps_drift", gaps=seen.gaps, steps=seen.clock_steps, drift_ppm=1e6 * seen.drift
    ).text


def _noise(place_m: Vec3 | None, turn_deg: Vec3 | None) -> str:
    if place_m is None or turn_deg is None:
        return notice("watch.moving").text
    north, east, down = (1e3 * value for value in place_m)
    roll, pitch, yaw = turn_deg
    return notice(
        "watch.noise",
        north_mm=north,
        east_mm=east,
        down_mm=down,
        roll_deg=roll,
        pitch_deg=pitch,
        yaw_deg=yaw,
    ).text


_HEADER = re.compile(r"\s*\[\s*([^\[\]]+?)\s*\]\s*(#.*)?$")

Value = str | float | Sequence[float]


def set_keys(text: str, table: str, keys: Mapping[str, Value]) -> str:
    """``text`` (TOML) with ``keys`` set in ``table``, each on a line of its own.

    New tables go to the end.

    Sees tables that have a header, and keys that are written on one line.
    """
    lines = text.splitlines()
    begin = next(
        (n for n, line in enumerate(lines) if (m := _HEADER.match(line)) and m[1] == table), None
    )
    if begin is None:
        return (
            "\n".join([*lines, *([""] if lines else []), f"[{table}]", *map(_line, keys.items())])
            + "\n"
        )
    end = next(
        (n for n in range(begin + 1, len(lines)) if lines[n].lstrip().startswith("[")), len(lines)
    )
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
        ConfigError: it can't be written, or what would be read from it then is not ``expected``; it
            is left as it was.
    """
    by_hand = "; ".join(
        f"[{table}] {' '.join(map(_line, keys.items()))}" for table, keys in tables.items() if keys
    )
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
            raise ConfigError("", notice("carry.by_hand", keys=by_hand), str(path))
        write_whole(kept, before)
        new.replace(path)
    except OSError as error:
        raise ConfigError(
            "", notice("carry.unwritable", why=error.strerror, keys=by_hand), str(path)
        ) from None
    return kept


def _line(item: tuple[str, Value]) -> str:
    return f"{item[0]} = {write_value(item[1])}"


PATIENCE_S = 120.0
"""Timeout of what the operator is to do: a move, or a step without propellers [s]."""


class CarryRecord(NamedTuple):
    """Record of the moves."""

    carry: Carry
    autopilot: list[Attitude]
    synchronised: bool
    """Whether the autopilot has told its time."""


def carry_command(
    config: Config, path: Path, overrides: list[str], *, as_json: bool, keep: bool
) -> Exit:
    """Show the moves, and write what they tell into the file ``path`` unless ``keep``.

    Returns 0 where all fits, 1 where a move contradicts or was not made, 3 where poses or autopilot
    can't be heard, 130 after Ctrl-C.

    Raises:
        ConfigError: these poses have no axes to find, or the file can't be written.
    """
    if config.pose.by_autopilot:
        raise ConfigError("pose.kind", notice("carry.source"))
    if overrides and not keep:
        raise ConfigError("--set", notice("carry.overrides"))

    def say(line: str) -> None:
        print(line, file=sys.stderr if as_json else sys.stdout, flush=True)

    facts: dict[str, Any] = {"ok": False, "move": None, "why": None, "found": None, "written": None}
    try:
        seen = asyncio.run(record_moves(config, say))
        found = solve_axes(seen.carry.rests, seen.carry.samples, seen.autopilot)
    except (SourceError, LinkError, KeyboardInterrupt, CarryFailure) as error:
        why, code = _tell_not_found(error, say)
        if as_json:
            says = {"why": why.text, "why_id": why.id, "why_numbers": why.numbers}
            print(json.dumps(facts | {"move": getattr(error, "move", "") or None} | says))
        return code
    tables, changed = calibrated_config(config, found)
    facts |= {
        "ok": True,
        "found": msgspec.to_builtins(found),
        "set": tables,
        "synchronised": seen.synchronised,
    }
    for line in describe_calibration(found, tables, synchronised=seen.synchronised):
        say(line)
    if not keep:
        kept = write_keys(path, tables, changed)
        facts["written"] = str(path)
        say(notice("carry.written", path=path, kept=kept).text)
    if as_json:
        print(json.dumps(facts))
    return Exit.DONE


def _tell_not_found(error: BaseException, say: Callable[[str], None]) -> tuple[Sentence, Exit]:
    """Tell the operator why nothing was found; returns that, and the exit code."""
    if isinstance(error, CarryFailure):
        say(notice("carry.not_found", why=error.says).text)
        return error.says, Exit.FAILED
    if isinstance(error, KeyboardInterrupt):
        why, code = notice("carry.interrupted"), Exit.INTERRUPTED
    else:
        why, code = notice("carry.not_recorded", why=getattr(error, "says", error)), Exit.UNHEARD
    print(f"groundstation: carry: {why}", file=sys.stderr)
    return why, code


def _ignore(_: Pose | Sentence) -> None:
    """The gate knows nothing of a tracker whose axes are not known."""


def _require_disarmed(connection: MavlinkConnection | None) -> None:
    """Refuse to go on with an autopilot that is armed, or not heard, or another's."""
    if connection is not None and connection.state != "connected":
        raise CarryFailure("", _state(connection))
    if connection is not None and connection.conflict:
        raise CarryFailure("", notice("carry.not_recorded", why=connection.conflict))


def _say_not_made(move: str, source: PoseSource, *, deaf: bool) -> Sentence:
    """Why nothing was seen of a ``move``, and what to do.

    ``deaf``: the autopilot has sent nothing.
    """
    dropped = explain_drops(source.status)
    seen = f"; {dropped}" if dropped else ""
    if deaf:
        seen = "; the autopilot does not send its attitude"
    return notice("carry.not_made", move=move, limit_s=PATIENCE_S, seen=seen)


async def record_moves(config: Config, say: Callable[[str], None]) -> CarryRecord:
    """Have all the moves made; ``say`` tells the operator what to do.

    Raises:
        CarryFailure: the vehicle is armed, or a move was not made for two minutes.
        SourceError: the source can't be started.
        LinkError: the autopilot does not answer.
    """
    has_autopilot = config.link.has_autopilot
    carry, felt = Carry(), list[Attitude]()
    begun, ended = asyncio.Event(), asyncio.Event()

    def pose(pose: Pose) -> None:
        # A move that the autopilot has not seen, or the operator not been told of, does not count.
        if (
            begun.is_set()
            and (felt or not has_autopilot)
            and carry.pose(Sample(pose.time_s, pose.attitude, pose.position_ned))
        ):
            ended.set()

    def ask(connection: MavlinkConnection) -> None:
        def hear(message: Message, arrival_s: float) -> None:
            if (attitude := attitude_of(message, arrival_s, connection.clock)) is not None:
                felt.append(attitude)

        connection.request(lambda _kind: {"ATTITUDE_QUATERNION": ATTITUDE_HZ})
        connection.subscribe(hear)

    async with open_ears(
        in_tracker_axes(config),
        _ignore,
        raw=pose,
        tell=_ignore,
        autopilot=ask if has_autopilot else None,
    ) as ears:
        connection = ears.connection
        say(notice("carry.begin" if has_autopilot else "carry.begin_unseen").text)
        while (move := carry.move) is not None:
            number = len(carry.rests) + 1
            say(notice("carry.move", number=number, count=len(MOVES), move=move.say).text)
            begun.set()
            ended.clear()
            if not await _await_move(ended, connection):
                deaf = has_autopilot and not felt
                raise CarryFailure("", _say_not_made(move.name, ears.source, deaf=deaf))
        synchronised = connection is not None and connection.clock is not None
    return CarryRecord(carry, felt, synchronised)


async def _await_move(ended: asyncio.Event, connection: MavlinkConnection | None) -> bool:
    """Wait until a move has ``ended``; False where it was not made within :data:`PATIENCE_S`.

    Raises:
        CarryFailure: the vehicle is armed, or its autopilot is not heard.
    """
    give_up_s = asyncio.get_running_loop().time() + PATIENCE_S
    while not ended.is_set():
        await asyncio.sleep(REFRESH_S)
        _require_disarmed(connection)
        if asyncio.get_running_loop().time() > give_up_s:
            return False
    return True


def _state(connection: MavlinkConnection) -> Sentence:
    if connection.state == "armed":
        return notice("carry.armed")
    return notice("carry.unheard", state=connection.state, why=connection.text)


def in_tracker_axes(config: Config) -> Config:
    """``config`` with poses that stay in the tracker's own axes."""
    pose: Any = config.pose
    plain = msgspec.structs.replace(pose, world="ned", body="frd", alignment=Alignment())
    return msgspec.structs.replace(config, pose=plain)


def calibrated_config(
    config: Config, found: AxisCalibration
) -> tuple[dict[str, dict[str, Value]], Config]:
    """The keys to write, by table, and the configuration that they make."""
    pose: Any = config.pose
    top: dict[str, Value] = {"world": found.world, "body": found.body}
    latency = pose.latency_key
    if found.late_s is not None:
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
    """Describe the calibration for people."""
    says = [notice("carry.axes", world=found.world, body=found.body)]
    if any(found.lab_rotation_deg):
        says.append(notice("carry.north", yaw_deg=found.lab_rotation_deg[2]))
    if any(found.body_rotation_deg):
        roll, pitch, yaw = found.body_rotation_deg
        says.append(notice("carry.body_turned", roll_deg=roll, pitch_deg=pitch, yaw_deg=yaw))
    if found.autopilot_north_deg is not None:
        side = "right" if found.autopilot_north_deg > 0.0 else "left"
        says.append(
            notice("carry.autopilot_north", north_deg=abs(found.autopilot_north_deg), side=side)
        )
    if found.late_s is not None:
        row = "carry.latency" if synchronised else "carry.latency_unsynchronised"
        way = "older" if found.late_s >= 0.0 else "younger"
        says.append(notice(row, late_ms=1e3 * abs(found.late_s), way=way))
    keys = [
        f"  {table}.{key} = {value!r}"
        for table, set_ in tables.items()
        for key, value in set_.items()
    ]
    return [*(one.text for one in says), *keys]
