"""Viewer, ``groundstation view LOG``: a recorded flight as Foxglove draws it in space, also while
it is being flown.

The trails in the room are made of the recording's own messages (:class:`FoxgloveScene`), in a
process of its own, so that a flight does nothing for whoever looks on. The server is
foxglove-sdk's.
"""

import asyncio
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec

from groundstation.config import ConfigError, refuse_value
from groundstation.core.messages import notice
from groundstation.machine import is_being_written
from groundstation.recording import (
    CHANNELS,
    ChannelForm,
    Entry,
    Recording,
    channel_form,
    channels as ch,
    describe_channels,
    refuse_recordings,
)
from groundstation.runtime import Exit, require_package
from links.io import parse_address

TRAIL_S = 20.0
"""Length of a trail in time [s]."""
SAMPLE_S = 0.2
"""Interval between points of a trail, which is drawn at each, and of polling for records [s]."""
TRAILS = ("estimate", "reference", "truth")
"""Channels whose positions leave a trail."""


class PosesInFrame(msgspec.Struct, frozen=True, gc=False):
    """foxglove.PosesInFrame."""

    timestamp: ch.Time
    frame_id: str
    poses: tuple[ch.FoxglovePose, ...]


class FoxgloveScene:
    """A recording's messages as they are, beside trails of their positions.

    The vehicle is its own frame, ``/tf``.
    """

    topics = tuple(f"/scene/{name}" for name in TRAILS)
    """Topics that are drawn beside the recording's own."""

    def __init__(self) -> None:
        self._trails: dict[str, deque[tuple[float, ch.FoxglovePose]]] = {
            f"/{name}": deque() for name in TRAILS
        }

    def channels(self) -> Iterator[ChannelForm]:
        """Those of the scene, and those of a recording but for its bytes."""
        yield from (
            channel_form(topic, "foxglove.PosesInFrame", PosesInFrame) for topic in self.topics
        )
        yield from describe_channels(topic for topic in CHANNELS if not topic.startswith("/raw"))

    def messages(self, entry: Entry) -> Iterator[tuple[str, bytes]]:
        """Topic and bytes of what one message of the recording becomes; it stays as it is."""
        yield entry.topic, entry.data
        time_s, trail = 1e-9 * entry.stamp_ns, self._trails.get(entry.topic)
        if trail is None or (trail and time_s - trail[-1][0] < SAMPLE_S):
            return
        trail.append((time_s, ch.FoxglovePose(entry.message().position_ned)))
        while time_s - trail[0][0] > TRAIL_S:
            trail.popleft()
        stamp = ch.Time.of(entry.stamp_ns)
        drawn = PosesInFrame(stamp, ch.WORLD, tuple(pose for _, pose in trail))
        yield f"/scene{entry.topic}", msgspec.json.encode(drawn)
        yield (
            "/tf",
            msgspec.json.encode(ch.turn_world_over(stamp)),
        )  # again, for whoever begins to look in between


LISTEN = "127.0.0.1:8765"
"""Where Foxglove's server listens by default: on this machine alone."""


def view_command(path: Path, listen: str | None) -> Exit:
    """Show a recording in Foxglove, served at ``listen`` (HOST:PORT; without it at :data:`LISTEN`).

    Returns 0.

    One that is still being written is followed to its end.

    Raises:
        ConfigError: it is no recording, foxglove-sdk is missing, or there is no listening at
            ``listen``.
    """
    with refuse_value("--listen"):
        host, port = parse_address(listen or LISTEN)
    require_package("foxglove", "view", "view")
    with refuse_recordings():
        asyncio.run(_serve(Recording(path), host, port))
    return Exit.DONE


async def _serve(recording: Recording, host: str, port: int) -> None:
    """To whoever connects by Foxglove: a flight as it goes on, a finished one at its own pace once
    somebody looks.
    """
    import foxglove
    from foxglove.websocket import ServerListener

    context, watched = foxglove.Context(), asyncio.Event()
    scene = FoxgloveScene()
    channels = _advertise(scene, context)
    loop = asyncio.get_running_loop()

    class Subscriptions(ServerListener):
        def on_subscribe(self, client: object, channel: object) -> None:
            del client, channel
            loop.call_soon_threadsafe(watched.set)

    try:
        server = foxglove.start_server(
            name=recording.path.stem,
            host=host,
            port=port,
            context=context,
            server_listener=Subscriptions(),
        )
    except (RuntimeError, OSError) as error:
        raise ConfigError(
            "--listen", notice("value.refused", value=f"{host}:{port}", why=error)
        ) from None
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


def _advertise(scene: FoxgloveScene, context: Any) -> dict[str, Any]:
    """Announce the channels of ``scene`` in Foxglove's ``context``; returns them by topic."""
    import foxglove

    channels = {}
    for topic, name, text, form, encoding in scene.channels():
        about = foxglove.Schema(name=name, encoding=form, data=text)
        channels[topic] = foxglove.Channel(
            topic, schema=about, message_encoding=encoding, context=context
        )
    return channels
