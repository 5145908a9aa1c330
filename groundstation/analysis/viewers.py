"""Viewers: a recorded flight as Foxglove draws it in space, as a file or while it is being flown.

The trails in the room are made of the recording's own messages (:class:`FoxgloveScene`), in a process of its own, so
that a flight does nothing for whoever looks on. Schemas and server come from foxglove-sdk.
"""

import asyncio
import math
from collections import deque
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, ClassVar

from groundstation.config import ConfigError
from groundstation.core.geometry import Vec3
from groundstation.core.messages import notice
from groundstation.machine import is_being_written
from groundstation.recording import CHANNELS, ChannelForm, Entry, Recording, describe_channels, refuse_recordings
from groundstation.runtime import Exit, require_package
from links.io import parse_address

TRAIL_S = 20.0
"""Length of a trail in time [s]."""
SAMPLE_S = 0.1
"""Interval between points of a trail, and of polling for new records [s]."""
DRAW_S = 0.5
"""Interval between drawings of a trail [s]."""
TRAILS = ("estimate", "reference", "truth")
"""Channels whose positions leave a trail."""
DISPLAY = "world"
"""Frame in which the viewer draws."""
WORLD = "world_ned"
"""Frame of the recorded values."""


class FoxgloveScene:
    """A recording's messages as they are, beside trails of their positions; the vehicle is its own frame, ``/tf``."""

    kinds: ClassVar = {"/tf_static": "FrameTransform", **{f"/scene/{name}": "PosesInFrame" for name in TRAILS}}
    """Topic → message of what is drawn beside the recording's own messages."""

    def __init__(self, option: str) -> None:
        """For ``option`` of the command line.

        Raises:
            ConfigError: foxglove-sdk is not installed.
        """
        require_package("foxglove", option, "view")
        from foxglove import messages

        self._messages: Any = messages
        self._trails: dict[str, deque[tuple[float, Vec3]]] = {name: deque() for name in TRAILS}
        self._drawn_s = dict.fromkeys((*TRAILS, "tf_static"), -math.inf)

    def channels(self, wanted: Collection[str]) -> Iterator[ChannelForm]:
        """Those of the scene, and those of ``wanted`` that stay as they are."""
        for topic, kind in self.kinds.items():
            told = getattr(self._messages, kind).get_schema()
            yield topic, told.name, told.data, told.encoding, "protobuf"
        yield from describe_channels(wanted)

    def messages(self, entry: Entry) -> Iterator[tuple[str, bytes]]:
        """Topic and bytes of what one message of the recording becomes; most stay as they are."""
        yield entry.topic, entry.data
        time_s, stamp = 1e-9 * entry.stamp_ns, self._stamp(entry.stamp_ns)
        if self._claim_drawing("tf_static", time_s):  # again and again, for whoever begins to look in between
            yield "/tf_static", self._transform(stamp).encode()
        name = entry.topic.strip("/")
        if name not in TRAILS:
            return
        trail = self._trails[name]
        if not trail or time_s - trail[-1][0] >= SAMPLE_S:
            told = entry.value()["position_ned"]
            trail.append((time_s, (told["x"], told["y"], told["z"])))
            while time_s - trail[0][0] > TRAIL_S:
                trail.popleft()
        if self._claim_drawing(name, time_s):
            poses = [self._pose(point) for _, point in trail]
            made = self._messages.PosesInFrame(timestamp=stamp, frame_id=WORLD, poses=poses)
            yield f"/scene/{name}", made.encode()

    def _claim_drawing(self, name: str, time_s: float) -> bool:
        """Whether ``name`` is to be drawn at ``time_s`` [s]; then it counts as drawn."""
        due = time_s - self._drawn_s[name] >= DRAW_S
        if due:
            self._drawn_s[name] = time_s
        return due

    def _transform(self, stamp: Any) -> Any:
        """Turn the world, whose z is down, over in a world with z up."""
        m = self._messages
        return m.FrameTransform(
            timestamp=stamp,
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


LISTEN = "127.0.0.1:8765"
"""Where Foxglove's server listens by default: on this machine alone."""


def view_command(path: Path, listen: str | None) -> Exit:
    """Show a recording in Foxglove, served at ``listen`` (HOST:PORT; without it at :data:`LISTEN`); returns 0.

    One that is still being written is followed to its end.

    Raises:
        ConfigError: it is no recording, foxglove-sdk is missing, or there is no listening at ``listen``.
    """
    try:
        host, port = parse_address(listen or LISTEN)
    except ValueError as error:
        raise ConfigError("--listen", str(error)) from None
    with refuse_recordings():
        asyncio.run(_serve(Recording(path), FoxgloveScene("view"), host, port))
    return Exit.DONE


async def _serve(recording: Recording, scene: FoxgloveScene, host: str, port: int) -> None:
    """To whoever connects by Foxglove: a flight as it goes on, a finished one at its own pace once somebody looks."""
    import foxglove
    from foxglove.websocket import ServerListener

    context, watched = foxglove.Context(), asyncio.Event()
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
            await asyncio.sleep(SAMPLE_S)
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
