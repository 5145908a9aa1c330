"""``groundstation request --mqtt``: one sealed request by a broker, and its answer."""

import argparse
import asyncio
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from groundstation.config import CLIENT_LETTERS, VEHICLE_LETTERS, ConfigError, a_name, is_name
from groundstation.interfaces.mqtt.broker import Broker, from_url, heed_cancellation, in_words
from groundstation.interfaces.mqtt.messages import (
    ANSWER,
    OFFLINE,
    REQUEST,
    SESSION,
    STATE,
    AnswerMessage,
    SessionMessage,
    properties,
)
from groundstation.interfaces.mqtt.request_codec import Place, open_answer, sealed_request
from groundstation.runtime import wall_ms
from groundstation.settings import RemoteAsk
from links.io import read_key

if TYPE_CHECKING:
    import aiomqtt

EXIT_DONE, EXIT_REFUSED, EXIT_NOBODY = 0, 1, 2
LIFE_MS = 4000
"""How long the request is good for [ms]."""
PATIENCE_S = 5.0
"""How long we wait, for everything [s]."""


class Unanswered(Exception):
    """Nothing came of it; the text says why."""


def ask_command(args: argparse.Namespace) -> int:
    """Ask, print the answer, and return 0 where it is done, 1 where it is refused, 2 where nobody answers.

    Raises:
        ConfigError: something on the command line is missing or can't be used.
    """
    for name, value in (("--vehicle", args.vehicle), ("--client", args.client), ("--key", args.key)):
        if not value:
            raise ConfigError(name, "missing; --mqtt needs --vehicle, --client and --key")
    if args.ask == "arm":
        raise ConfigError("arm", "nobody arms from afar: only who stands by the vehicle may")
    for name, value, letters in (
        ("--vehicle", args.vehicle, VEHICLE_LETTERS),
        ("--client", args.client, CLIENT_LETTERS),
    ):
        if not is_name(value, letters):
            raise ConfigError(name, f"expected {a_name(letters)}, got {value!r}")
    broker = from_url(args.mqtt, ca=args.ca, user=args.user, password_file=args.password_file)
    key = _key(args.key)
    try:
        answer = asyncio.run(asked(broker, args.vehicle, args.client, key, args.ask, args.why[:200]))
    except Unanswered as error:
        print(f"groundstation: request: {error}", file=sys.stderr)
        return EXIT_NOBODY
    print(answer.says)
    return EXIT_DONE if answer.done else EXIT_REFUSED


async def asked(broker: Broker, vehicle: str, client: str, key: bytes, ask: RemoteAsk, why: str = "") -> AnswerMessage:
    """What the station of ``vehicle`` answers.

    Raises:
        Unanswered: no broker, no station, or no answer.
    """
    import aiomqtt

    place = Place(broker.config.prefix, vehicle)
    asking = _Asking(place, client, key, ask, why)
    try:
        async with asyncio.timeout(PATIENCE_S), broker.client() as connection:
            return await asking.run(connection)
    except (aiomqtt.MqttError, msgspec.MsgspecError, ValueError, RecursionError) as error:
        raise Unanswered(f"the broker {broker}: {in_words(error)}") from None
    except TimeoutError:
        raise Unanswered(asking.why_not()) from None


class _Asking:
    """One request: sent once the session is known, and again where that was the one of a station that has ended."""

    def __init__(self, place: Place, client: str, key: bytes, ask: RemoteAsk, why: str) -> None:
        self._place, self._client, self._key, self._ask, self._why = place, client, key, ask, why
        self._ids: set[int] = set()
        self._state = ""

    async def run(self, connection: "aiomqtt.Client") -> AnswerMessage:
        root = f"{self._place.prefix}/{self._place.vehicle}/"
        await connection.subscribe([(root + topic.name, 1) for topic in (STATE, ANSWER, SESSION)])
        heed_cancellation()
        async for message in connection.messages:
            match str(message.topic).removeprefix(root):
                case STATE.name:
                    self._state = message.payload.decode(errors="replace")
                case SESSION.name if message.payload and len(self._ids) < 2:
                    await self._send(connection, root + REQUEST.name, message.payload)
                case ANSWER.name:
                    answer = open_answer(message.payload, self._key, self._place)
                    if answer is not None and answer.client == self._client and answer.id in self._ids:
                        return answer
        raise Unanswered("the broker has closed the connection")

    async def _send(self, connection: "aiomqtt.Client", topic: str, payload: bytes) -> None:
        session = msgspec.json.decode(payload, type=SessionMessage).session
        now_ms = wall_ms()
        self._ids.add(now_ms)
        request = sealed_request(
            self._key, self._place, session, self._client, now_ms, self._ask, now_ms + LIFE_MS, self._why
        )
        await connection.publish(
            topic, request, qos=REQUEST.quality, properties=properties(REQUEST, -(-LIFE_MS // 1000))
        )
        heed_cancellation()

    def why_not(self) -> str:
        vehicle = self._place.vehicle
        if self._state == OFFLINE:
            return f"no station flies {vehicle!r} now"
        if not self._ids:
            there = "takes no requests by MQTT" if self._state else "is not known to this broker, or hidden from us"
            return f"{vehicle!r} {there}"
        return (
            f"{vehicle!r} has not answered: it may not know {self._client!r} by this key, the broker may not let us "
            "publish, or the clocks of both computers differ; the station's log says which"
        )


def _key(file: Path) -> bytes:
    try:
        return read_key(file)
    except ValueError as error:
        raise ConfigError("--key", str(error)) from None
