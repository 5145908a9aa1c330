"""Viewer as a program: Foxglove's server beside a flight."""

import asyncio
import json
import struct
import subprocess
import sys
from collections import Counter
from contextlib import closing
from pathlib import Path

import pytest
from tornado.websocket import websocket_connect

from groundstation.analysis.viewers import LISTEN, FoxgloveScene
from groundstation.machine import list_flights
from groundstation.recording import CHANNELS
from tests.e2e.stations import served
from tests.loops import until


async def subscribe(port: int) -> Counter[str]:
    """Count the messages of each topic that a client of Foxglove's server gets until it ends."""
    names: dict[int, str] = {}
    got: Counter[str] = Counter()
    with closing(
        await websocket_connect(f"ws://127.0.0.1:{port}", subprotocols=["foxglove.sdk.v1"])
    ) as server:
        while (message := await server.read_message()) is not None:
            if isinstance(message, bytes):
                if message[0] == 1:
                    got[names[struct.unpack_from("<I", message, 1)[0]]] += 1
            elif (told := json.loads(message))["op"] == "advertise":
                names |= {channel["id"]: channel["topic"] for channel in told["channels"]}
                wanted = [{"id": number, "channelId": number} for number in names]
                await server.write_message(json.dumps({"op": "subscribe", "subscriptions": wanted}))
    return got


def listening(port: int) -> set[str]:
    """The addresses at which something listens at ``port``, in hexadecimal (proc(5), net/tcp)."""
    rows = [
        line.split()
        for name in ("tcp", "tcp6")
        for line in Path(f"/proc/net/{name}").read_text("utf-8").splitlines()
    ]
    places = [row[1].split(":") for row in rows[1:] if row[3] == "0A"]
    return {address for address, number in places if int(number, 16) == port}


def test_a_flight_is_shown_as_it_is_flown() -> None:
    port = int(LISTEN.rpartition(":")[2])
    if listening(port):
        pytest.skip(f"NOT TRIED: something else listens at port {port}, where view serves Foxglove")

    async def look() -> Counter[str]:
        await until(lambda: listening(port))
        assert listening(port) == {"0100007F"}, "on this machine alone"
        return await subscribe(port)

    with served() as room:
        words = room.station("fly", "--arm", "mqx", "--set", "flight.duration_s=2.0")
        with subprocess.Popen(
            words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        ) as station:
            while not (found := list_flights(room.recordings)) or not found[0].stat().st_size:
                assert station.poll() is None
            words = [sys.executable, "-m", "groundstation", "view", str(found[0])]
            with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as viewer:
                got = asyncio.run(look())
                shown, _ = viewer.communicate(timeout=60)
            said, _ = station.communicate(timeout=60)
    assert station.returncode == 0, said
    assert f"in Foxglove, Open connection, ws://127.0.0.1:{port}" in shown
    assert got["/tf"] > 100
    assert got["/scene/estimate"] > 5
    assert not any(topic.startswith("/raw") for topic in got)
    assert set(got) <= {*CHANNELS, *FoxgloveScene.topics}
