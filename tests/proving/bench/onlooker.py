"""Somebody who looks at all that Foxglove's server shows: ``-m tests.proving.bench.onlooker PORT``."""

import asyncio
import struct
import sys
from collections import Counter

import aiohttp


async def subscribe(port: int) -> Counter[str]:
    """Count the messages of each topic that a client of Foxglove's server gets until it ends."""
    names: dict[int, str] = {}
    got: Counter[str] = Counter()
    async with (
        aiohttp.ClientSession() as session,
        session.ws_connect(f"ws://127.0.0.1:{port}", protocols=["foxglove.sdk.v1"]) as server,
    ):
        async for message in server:
            if message.type == aiohttp.WSMsgType.TEXT and message.json()["op"] == "advertise":
                names |= {channel["id"]: channel["topic"] for channel in message.json()["channels"]}
                wanted = [{"id": number, "channelId": number} for number in names]
                await server.send_json({"op": "subscribe", "subscriptions": wanted})
            elif message.type == aiohttp.WSMsgType.BINARY and message.data[0] == 1:
                got[names[struct.unpack_from("<I", message.data, 1)[0]]] += 1
    return got


if __name__ == "__main__":
    asyncio.run(subscribe(int(sys.argv[1])))
