"""``groundstation request --mqtt``."""

import argparse
import asyncio
import sys
from typing import TYPE_CHECKING

import msgspec

from groundstation.config import NAME_FORM, ConfigError, is_name, refuse_value
from groundstation.core.messages import RemoteAsk, Waypoint, notice
from groundstation.interfaces.mqtt.broker import (
    MqttBroker,
    describe_error,
    from_url,
    heed_cancellation,
)
from groundstation.interfaces.mqtt.messages import (
    ANSWER,
    OFFLINE,
    REQUEST,
    SESSION,
    STATE,
    SealedAnswer,
    SessionMessage,
    properties,
)
from groundstation.interfaces.mqtt.requests import Place, open_answer, seal_request
from groundstation.machine import wall_ms
from groundstation.runtime import Exit
from links.io import read_key

if TYPE_CHECKING:
    import aiomqtt


LIFE_MS = 4000
"""Validity of a request, and the longest wait for its answer [ms]."""
SESSIONS_TRIED = 2
"""Sessions that one request is sealed for [-]: the retained one may be of an ended station."""
AGAIN_S = 0.3
"""A kill that is not answered is published again so often, the same, and obeyed once [s]."""


class Unanswered(Exception):
    """Nothing came of it; the text says why."""


def ask_command(args: argparse.Namespace, points: tuple[Waypoint, ...] = ()) -> Exit:
    """Ask, print the answer, and return 0 where it is done, 1 where refused, 2 without an answer.

    Raises:
        ConfigError: something on the command line is missing or can't be used.
    """
    for name, value in (
        ("--vehicle", args.vehicle),
        ("--client", args.client),
        ("--key", args.key),
    ):
        if not value:
            raise ConfigError(name, notice("mqtt.missing_option"))
    if args.ask == "arm":
        raise ConfigError("arm", notice("order.arm_from_afar"))
    for name, value in (("--vehicle", args.vehicle), ("--client", args.client)):
        if not is_name(value):
            raise ConfigError(name, notice("value.form", form=NAME_FORM, found=value))
    broker = from_url(args.mqtt, ca=args.ca, user=args.user, password_file=args.password_file)
    with refuse_value("--key"):
        key = read_key(args.key)
    try:
        asking = request_by_mqtt(
            broker, args.vehicle, args.client, key, args.ask, args.why[:200], points
        )
        answer = asyncio.run(asking)
    except Unanswered as error:
        print(f"groundstation: request: {error}", file=sys.stderr)
        return Exit.NOBODY
    print(answer.says)
    return Exit.DONE if answer.done else Exit.FAILED


async def request_by_mqtt(
    broker: MqttBroker,
    vehicle: str,
    client: str,
    key: bytes,
    ask: RemoteAsk,
    why: str = "",
    points: tuple[Waypoint, ...] = (),
) -> SealedAnswer:
    """Send a request to the station of ``vehicle`` and return its answer.

    Raises:
        Unanswered: no broker, no station, or no answer.
    """
    import aiomqtt

    place = Place(broker.config.prefix, vehicle)
    asking = _Asking(place, client, key, ask, why, points)
    try:
        async with asyncio.timeout(1e-3 * LIFE_MS), broker.client() as connection:
            return await asking.run(connection)
    except (aiomqtt.MqttError, msgspec.MsgspecError, ValueError, RecursionError) as error:
        raise Unanswered(
            notice("mqtt.broker_failed", broker=broker, why=describe_error(error))
        ) from None
    except TimeoutError:
        raise Unanswered(asking.why_not()) from None


class _Asking:
    """One request: sent once a session is known, and again for another, as the first may be of a
    station that ended.
    """

    def __init__(
        self,
        place: Place,
        client: str,
        key: bytes,
        ask: RemoteAsk,
        why: str,
        points: tuple[Waypoint, ...],
    ) -> None:
        self._place, self._client, self._key, self._ask, self._why = place, client, key, ask, why
        self._points = points
        self._ids: set[int] = set()
        self._sessions: set[bytes] = set()
        """Sessions that the request was sealed for: a station publishes its own again and again."""
        self._state = ""
        self._repeating: asyncio.Task[None] | None = None

    async def run(self, connection: "aiomqtt.Client") -> SealedAnswer:
        root = f"{self._place.prefix}/{self._place.vehicle}/"
        await connection.subscribe([(root + topic.name, 1) for topic in (STATE, ANSWER, SESSION)])
        heed_cancellation()
        try:
            async for message in connection.messages:
                match str(message.topic).removeprefix(root):
                    case STATE.name:
                        self._state = message.payload.decode(errors="replace")
                    case SESSION.name if (
                        message.payload
                        and message.payload not in self._sessions
                        and len(self._sessions) < SESSIONS_TRIED
                    ):
                        self._sessions.add(message.payload)
                        await self._send(connection, root + REQUEST.name, message.payload)
                    case ANSWER.name:
                        answer = open_answer(message.payload, self._key, self._place)
                        if (
                            answer is not None
                            and answer.client == self._client
                            and answer.id in self._ids
                        ):
                            return answer
        finally:
            if self._repeating is not None:
                self._repeating.cancel()
                await asyncio.gather(self._repeating, return_exceptions=True)
        raise Unanswered(notice("mqtt.closed"))

    async def _send(self, connection: "aiomqtt.Client", topic: str, payload: bytes) -> None:
        session = msgspec.json.decode(payload, type=SessionMessage).session
        now_ms = wall_ms()
        self._ids.add(now_ms)
        request = seal_request(
            self._key,
            self._place,
            session,
            self._client,
            now_ms,
            self._ask,
            now_ms + LIFE_MS,
            self._why,
            self._points,
        )
        await self._publish(connection, topic, request)
        if self._ask == "kill":
            if self._repeating is not None:
                self._repeating.cancel()
            self._repeating = asyncio.create_task(self._repeat(connection, topic, request))

    async def _repeat(self, connection: "aiomqtt.Client", topic: str, request: bytes) -> None:
        """Others may have flooded the station, which then does not listen for a moment."""
        for _ in range(int(1e-3 * LIFE_MS / AGAIN_S)):
            await asyncio.sleep(AGAIN_S)
            await self._publish(connection, topic, request)

    async def _publish(self, connection: "aiomqtt.Client", topic: str, request: bytes) -> None:
        await connection.publish(
            topic, request, qos=REQUEST.quality, properties=properties(REQUEST, -(-LIFE_MS // 1000))
        )
        heed_cancellation()

    def why_not(self) -> str:
        vehicle = self._place.vehicle
        if self._state == OFFLINE:
            return f"no station flies {vehicle!r} now"
        if not self._ids:
            there = (
                "takes no requests by MQTT"
                if self._state
                else "is not known to this broker, or hidden from us"
            )
            return f"{vehicle!r} {there}"
        return (
            f"{vehicle!r} has not answered: it may not know {self._client!r} by this key, the "
            "broker may not let us publish, or the clocks of both computers differ; the station's "
            "log says which"
        )
