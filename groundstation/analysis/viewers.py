"""Viewers: a recorded flight as Foxglove and Rerun draw it in space, as a file or while it is being flown.

What stands in the room is made of the recording's own messages (:class:`RoomScene`), in a process of its own, so that a
flight does nothing for whoever looks on. Foxglove's schemas and server come from foxglove-sdk, Rerun's from rerun-sdk.
"""

import asyncio
import itertools
import math
import os
import subprocess
import sys
from collections import deque
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

from groundstation.config import ConfigError
from groundstation.core.geometry import Quat, Vec3
from groundstation.core.messages import notice
from groundstation.machine import is_being_written
from groundstation.recording import (
    CHANNELS,
    ChannelForm,
    Entry,
    Recording,
    describe_channels,
    flatten,
    refuse_recordings,
)
from groundstation.runtime import Exit, require_package
from links.io import parse_address

TRAIL_S = 20.0
"""Length of a trail in time [s]."""
SAMPLE_S = 0.1
"""Interval between points of a trail [s]."""
DRAW_S = 0.5
"""Interval between drawings of a trail [s]."""
WIND_M = 0.5
"""Length of the arrow per disturbance [m per m/s²]."""
ARM_M = 0.12
"""Drawn arm of every vehicle [m]."""
ROTOR_M = 0.07
"""Drawn radius of a rotor [m]."""
ROTORS = tuple((x * ARM_M, y * ARM_M, 0.0) for x in (1.0, -1.0) for y in (1.0, -1.0))
"""Where they are, body FRD [m]."""
COLOURS = {"estimate": (0.0, 0.45, 0.7), "reference": (0.5, 0.5, 0.5), "truth": (0.84, 0.37, 0.0)}
"""Red, green, blue; told apart by everybody."""
DISPLAY = "world"
"""Frame in which the viewers draw."""
WORLD = "world_ned"
"""Frame of the recorded values."""


class Placement(NamedTuple):
    """Something is there now: ``estimate``, ``reference``, ``truth`` or ``measured``."""

    name: str
    position_ned: Vec3
    attitude: Quat


class Trail(NamedTuple):
    """Where something was within the last :data:`TRAIL_S`."""

    name: str
    points_ned: list[Vec3]


class WindArrow(NamedTuple):
    """The wind at the vehicle [m/s², NED], as it is or as the law believes."""

    name: str
    position_ned: Vec3
    wind_m_s2: Vec3


class RoomScene:
    """Objects in the room, from a recording's messages in their order. Sans-IO."""

    def __init__(self) -> None:
        self._trails: dict[str, deque[tuple[float, Vec3]]] = {}
        self._drawn_s: dict[str, float] = {}
        self._here: Vec3 | None = None

    def shapes(self, entry: Entry) -> Iterator[Placement | Trail | WindArrow]:
        """Yield the changes of one message."""
        name = entry.topic.strip("/")
        if name == "adaptation" and self._here is not None:
            yield WindArrow("estimate", self._here, _vector(entry.value()["b_hat_m_s2"]))
        if name not in ("estimate", "reference", "truth", "measured"):
            return
        told = entry.value()
        at = _vector(told["position_ned"])
        yaw = 0.5 * told.get("yaw_rad", 0.0)
        q = told.get("attitude")
        yield Placement(name, at, (q["w"], q["x"], q["y"], q["z"]) if q else (math.cos(yaw), 0.0, 0.0, math.sin(yaw)))
        if name == "truth":
            yield WindArrow(name, at, _vector(told["wind_m_s2"]))
        if name == "estimate":
            self._here = at
        if name != "measured":
            yield from self._lengthen(name, 1e-9 * entry.stamp_ns, at)

    def _lengthen(self, name: str, time_s: float, at: Vec3) -> Iterator[Trail]:
        trail = self._trails.setdefault(name, deque())
        if not trail or time_s - trail[-1][0] >= SAMPLE_S:
            trail.append((time_s, at))
            while time_s - trail[0][0] > TRAIL_S:
                trail.popleft()
        if time_s - self._drawn_s.get(name, -math.inf) >= DRAW_S:
            self._drawn_s[name] = time_s
            yield Trail(name, [point for _, point in trail])


class FoxgloveScene:
    """A recording's messages as they are, beside the trails of its scene; the vehicle is its own frame, ``/tf``."""

    kinds: ClassVar = {
        "/tf_static": "FrameTransform",
        **{f"/scene/{name}": "PosesInFrame" for name in COLOURS},
    }
    """Topic → message of what is drawn beside the recording's own messages."""

    def __init__(self, option: str) -> None:
        """For ``option`` of the command line.

        Raises:
            ConfigError: foxglove-sdk is not installed.
        """
        require_package("foxglove", option, "view")
        from foxglove import messages

        self._messages: Any = messages
        self._scene = RoomScene()
        self._drawn_s = -math.inf

    def channels(self, wanted: Collection[str]) -> Iterator[ChannelForm]:
        """Those of the scene, and those of ``wanted`` that stay as they are."""
        for topic, kind in self.kinds.items():
            told = getattr(self._messages, kind).get_schema()
            yield topic, told.name, told.data, told.encoding, "protobuf"
        yield from describe_channels(wanted)

    def messages(self, entry: Entry) -> Iterator[tuple[str, bytes]]:
        """Topic and bytes of what one message of the recording becomes; most stay as they are."""
        m, stamp_ns = self._messages, entry.stamp_ns
        yield entry.topic, entry.data
        if 1e-9 * stamp_ns - self._drawn_s >= DRAW_S:  # again and again, for whoever begins to look in between
            self._drawn_s = 1e-9 * stamp_ns
            yield "/tf_static", self._transform(stamp_ns).encode()
        for shape in self._scene.shapes(entry):
            if isinstance(shape, Trail):
                poses = [self._pose(point) for point in shape.points_ned]
                made = m.PosesInFrame(timestamp=self._stamp(stamp_ns), frame_id=WORLD, poses=poses)
                yield f"/scene/{shape.name}", made.encode()

    def _transform(self, stamp_ns: int) -> Any:
        """Turn the world, whose z is down, over in a world with z up."""
        m = self._messages
        return m.FrameTransform(
            timestamp=self._stamp(stamp_ns),
            parent_frame_id=DISPLAY,
            child_frame_id=WORLD,
            translation=m.Vector3(x=0.0, y=0.0, z=0.0),
            rotation=m.Quaternion(w=0.0, x=1.0, y=0.0, z=0.0),
        )

    def _pose(self, at: Vec3) -> Any:
        m = self._messages
        position, orientation = m.Vector3(x=at[0], y=at[1], z=at[2]), m.Quaternion(w=1.0, x=0.0, y=0.0, z=0.0)
        return m.Pose(position=position, orientation=orientation)

    def _stamp(self, stamp_ns: int) -> Any:
        sec, nsec = divmod(stamp_ns, 1_000_000_000)
        return self._messages.Timestamp(sec=sec, nsec=nsec)


CURVES = {
    "Distance from the reference [m]": ("errors/error_m", "truth/error_m"),
    "Position and reference, NED [m]": ("estimate/position_ned", "reference/position_ned"),
    "Thrust [N]": ("command/thrust_n", "estimate/thrust_n"),
    "Body rates [rad/s]": ("command/rates_rad_s",),
    "Wind, estimated and true [m/s²]": ("adaptation/b_hat_m_s2", "truth/wind_m_s2"),
}
"""Curves of Rerun's layout: channels and their fields."""
SHOWN: dict[str, list[tuple[str, str]]] = {}
for _path in itertools.chain.from_iterable(CURVES.values()):
    SHOWN.setdefault(_path.partition("/")[0], []).append((_path, _path.partition("/")[2]))
"""Topic → path and field of each of its curves."""


class RerunScene:
    """A recording's messages into a stream of Rerun's, gathered until :meth:`flush`: the scene, and :data:`CURVES`."""

    def __init__(self, stream: Any) -> None:
        """``stream`` is a rerun.RecordingStream; its layout and what never changes are sent now."""
        import rerun as rr

        self._rr, self._stream, self._scene = rr, stream, RoomScene()
        self._began_ns: int | None = None
        self._rows: dict[str, list[tuple[float, dict[str, float]]]] = {}
        self._drawn: dict[str, tuple[Any, list[float], dict[str, list[Any]]]] = {}
        stream.send_blueprint(_lay_out())
        stream.log("world", rr.ViewCoordinates.FRD, static=True)  # north, east, down stand as forward, right, down
        for name, colour in COLOURS.items():
            look: dict[str, Any] = {"colors": tuple(round(255.0 * part) for part in colour), "radii": 0.005}
            stream.log(f"world/trail/{name}", rr.LineStrips3D.from_fields(**look), static=True)
            if name == "reference":
                stream.log(f"world/{name}", rr.Points3D.from_fields(**look | {"radii": 0.02}), static=True)
                continue
            stream.log(f"world/wind/{name}", rr.Arrows3D.from_fields(**look), static=True)
            arms = rr.LineStrips3D([[(0.0, 0.0, 0.0), at] for at in ROTORS], **look)
            stream.log(f"world/{name}/arms", arms, static=True)
            sizes = [(ROTOR_M, ROTOR_M, 0.005)] * len(ROTORS)
            rotors = rr.Ellipsoids3D(centers=ROTORS, half_sizes=sizes, colors=look["colors"])
            stream.log(f"world/{name}/rotors", rotors, static=True)

    def add(self, entry: Entry) -> None:
        """Take one message."""
        if self._began_ns is None:
            self._began_ns = entry.stamp_ns
        rr, time_s = self._rr, 1e-9 * (entry.stamp_ns - self._began_ns)
        for shape in self._scene.shapes(entry):
            match shape:
                case Placement(name, at, (w, x, y, z)) if name in ("estimate", "truth"):
                    self._draw(f"world/{name}", time_s, rr.Transform3D, translation=at, quaternion=(x, y, z, w))
                case Placement(name, at):
                    self._draw(f"world/{name}", time_s, rr.Points3D, positions=at)
                case Trail(name, points):
                    self._draw(f"world/trail/{name}", time_s, rr.LineStrips3D, strips=points)
                case WindArrow(name, at, wind):
                    long = [WIND_M * part for part in wind]
                    self._draw(f"world/wind/{name}", time_s, rr.Arrows3D, origins=at, vectors=long)
        if entry.topic == "/log":
            told = entry.value()
            self._draw("log", time_s, rr.TextLog, text=told["message"], level="WARN" if told["level"] > 2 else "INFO")
        for name, field in SHOWN.get(entry.topic.strip("/"), ()):
            leaves = flatten(entry.value().get(field), name)
            row = {key: float(value) for key, value in leaves.items() if value is not None}
            self._rows.setdefault(name, []).append((time_s, row))

    def _draw(self, path: str, time_s: float, kind: Any, **parts: Any) -> None:
        _, times, columns = self._drawn.setdefault(path, (kind, [], {name: [] for name in parts}))
        times.append(time_s)
        for name, part in parts.items():
            columns[name].append(part)

    def flush(self) -> None:
        """Send what was gathered."""
        import numpy as np

        rr, rows, drawn = self._rr, self._rows, self._drawn
        self._rows, self._drawn = {}, {}
        for path, (kind, times, columns) in drawn.items():
            self._stream.send_columns(path, [rr.TimeColumn("time", duration=times)], kind.columns(**columns))
        for given in rows.values():
            index = [rr.TimeColumn("time", duration=[time_s for time_s, _ in given])]
            for name in dict.fromkeys(itertools.chain.from_iterable(row for _, row in given)):
                column = np.array([row.get(name, np.nan) for _, row in given])
                self._stream.send_columns(name.replace(".", "/"), index, rr.Scalars.columns(scalars=column))


def _lay_out() -> Any:
    """Rerun's layout: the room on the left, errors, thrust, rates and words on the right."""
    import rerun.blueprint as rrb

    shown = [rrb.TimeSeriesView(contents=[f"/{one}/**" for one in paths], name=name) for name, paths in CURVES.items()]
    eye = rrb.EyeControls3D(position=(-3.0, 2.0, -3.0), look_target=(0.0, 0.0, -0.9), eye_up=(0.0, 0.0, -1.0))
    room = rrb.Spatial3DView(origin="world", name="Room", eye_controls=eye)
    words = rrb.TextLogView(origin="log", name="Log")
    parts = rrb.Horizontal(rrb.Vertical(room, words, row_shares=[3, 1]), rrb.Vertical(*shown), column_shares=[3, 2])
    now = rrb.TimePanel(timeline="time", play_state="following", state="collapsed")
    return rrb.Blueprint(parts, now, collapse_panels=True)


def _vector(told: dict[str, float]) -> Vec3:
    return told["x"], told["y"], told["z"]


PORTS = {"rerun": 9876, "foxglove": 8765}
"""The viewers, and the port where each is usually found."""
POLL_S = 0.1
"""Interval of polling for new records [s]."""


def view_command(path: Path, viewer: str, listen: str | None) -> Exit:
    """Show a recording in ``viewer``, at ``listen`` (HOST:PORT; without it on this machine alone); returns 0.

    One that is still being written is followed to its end.

    Raises:
        ConfigError: it is no recording, the viewer's package is missing, or there is no listening at ``listen``.
    """
    require_package(viewer, "--in", "view")
    try:
        host, port = parse_address(listen or f"127.0.0.1:{PORTS[viewer]}")
    except ValueError as error:
        raise ConfigError("--listen", str(error)) from None
    with refuse_recordings():
        asyncio.run((_show_in_rerun if viewer == "rerun" else _serve_foxglove)(Recording(path), host, port))
    return Exit.DONE


async def _show_in_rerun(recording: Recording, host: str, port: int) -> None:
    """In Rerun's window, which stays; in one that is open already where it listens at ``port``."""
    import rerun as rr

    if not await _answers(host, port):
        await _open_rerun(host, port)
    print(f"{recording.path}: in Rerun, which listens at {host}:{port}", flush=True)
    stream = rr.RecordingStream("groundstation", recording_id=recording.path.stem)
    stream.connect_grpc(f"rerun+http://{host}:{port}/proxy")
    scene = RerunScene(stream)
    loop, due_s = asyncio.get_running_loop(), 0.0
    for entry in recording.follow():
        if entry is not None:
            scene.add(entry)
            continue
        if loop.time() >= due_s:
            due_s = loop.time() + DRAW_S
            scene.flush()
        await asyncio.sleep(POLL_S)
    scene.flush()
    try:
        stream.flush()
    except RuntimeError:
        raise ConfigError("--listen", notice("view.no_rerun", address=f"{host}:{port}")) from None
    stream.disconnect()


async def _open_rerun(host: str, port: int) -> None:
    """Open a window, which outlives us, and wait until it listens."""
    if sys.platform == "linux" and not any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"))):
        raise ConfigError("--in", notice("view.no_screen"))
    words = [sys.executable, "-m", "rerun", "--bind", host, "--port", str(port), "--expect-data-soon"]
    quiet = os.environ | {"RUST_LOG": "error"}
    window = subprocess.Popen(words, stdin=subprocess.DEVNULL, start_new_session=True, env=quiet)  # noqa: ASYNC220, S603  # rerun-sdk's own program
    while not await _answers(host, port):
        if window.poll() is not None:
            raise ConfigError("--in", notice("view.no_window"))
        await asyncio.sleep(POLL_S)


async def _answers(host: str, port: int) -> bool:
    """Whether something listens there."""
    try:
        _, writer = await asyncio.open_connection(host, port)
    except OSError:
        return False
    writer.close()
    return True


async def _serve_foxglove(recording: Recording, host: str, port: int) -> None:
    """To whoever connects by Foxglove: a flight as it goes on, a finished one at its own pace once somebody looks."""
    import foxglove
    from foxglove.websocket import ServerListener

    context, scene, watched = foxglove.Context(), FoxgloveScene("--in"), asyncio.Event()
    channels = {}
    for topic, name, text, form, encoding in scene.channels([one for one in CHANNELS if not one.startswith("/raw")]):
        about = foxglove.Schema(name=name, encoding=form, data=text)
        channels[topic] = foxglove.Channel(topic, schema=about, message_encoding=encoding, context=context)
    loop = asyncio.get_running_loop()

    class Subscriptions(ServerListener):
        def on_subscribe(self, client: object, channel: object) -> None:
            del client, channel
            loop.call_soon_threadsafe(watched.set)

    try:
        server = foxglove.start_server(
            name=recording.path.stem, host=host, port=port, context=context, server_listener=Subscriptions()
        )
    except (RuntimeError, OSError) as error:
        raise ConfigError("--listen", notice("value.refused", value=f"{host}:{port}", why=error)) from None
    print(f"{recording.path}: in Foxglove, Open connection, ws://{host}:{server.port}", flush=True)
    live = is_being_written(recording.path)
    if not live:
        await watched.wait()
    began_s, first_ns = loop.time(), None
    for entry in recording.follow():
        if entry is None:
            await asyncio.sleep(POLL_S)
            continue
        first_ns = entry.stamp_ns if first_ns is None else first_ns
        ahead_s = 1e-9 * (entry.stamp_ns - first_ns) - (loop.time() - began_s)
        if not live and ahead_s > 0.01:
            await asyncio.sleep(ahead_s)
        for topic, data in scene.messages(entry):
            if topic in channels:
                channels[topic].log(data, log_time=entry.stamp_ns)
    await asyncio.sleep(1.0)  # the last words reach whoever looks
    server.stop()
