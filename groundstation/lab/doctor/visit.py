"""One visit to an autopilot: read what the tables ask about, and set one parameter while it is disarmed."""

import asyncio
from collections.abc import Callable, Iterable
from typing import Any

import msgspec

from groundstation.config import ConfigError
from groundstation.lab.doctor import ardupilot, px4
from groundstation.lab.doctor.advice import Advice, Facts, Finding, judged
from groundstation.settings import Config
from links.core import LinkLost, LinkRejected, signal
from links.mavlink import MavlinkConnection, MavlinkLinkConfig
from links.mavlink.protocol import ARDUPILOT, ARMED, PX4, AutopilotParameter, Handshake, ReadAll, Write, is_same

BEAT_S = 3.0
"""How long the heartbeat that tells whether it is armed may take [s]."""
TABLES: dict[int, Callable[[Facts], list[Advice]]] = {PX4: px4.table, ARDUPILOT: ardupilot.table}
"""HEARTBEAT.autopilot → its advice."""


class Visit:
    """``open`` it, ``examine``, perhaps ``set``, and ``close`` it. Changes nothing by itself."""

    def __init__(self, config: Config) -> None:
        """Nothing is opened yet.

        Raises:
            ConfigError: the link does not lead to an autopilot.
        """
        link = config.link
        if not isinstance(link, MavlinkLinkConfig):
            raise ConfigError("link.kind", "expected mavlink: only an autopilot has parameters to look at")
        share = config.vehicle.mass_kg * config.controller.gravity / config.full_thrust_n
        self.facts = Facts(
            own_system=link.system_id,
            target_system=link.target_system,
            hover=signal(share, config.thrust_curve),
            own_curve=config.thrust_curve > 0.0,
        )
        self.parameters: dict[str, AutopilotParameter] = {}
        """As they were read last."""
        self._connection = MavlinkConnection(msgspec.structs.replace(link, quiet=False))

    async def open(self) -> None:
        """Connect.

        Raises:
            LinkError: nobody is there, or it is neither PX4 nor ArduPilot.
        """
        await self._connection.open()
        kind = self._connection.autopilot().kind
        if kind not in TABLES:
            raise LinkRejected(f"this is no PX4 and no ArduPilot (MAV_AUTOPILOT {kind}): nothing is known about it")

    def close(self) -> None:
        """Disconnect."""
        self._connection.close()

    @property
    def autopilot(self) -> str:
        """PX4 or ArduPilot."""
        return self._connection.autopilot().name

    @property
    def advice(self) -> list[Advice]:
        """What is known about this kind of autopilot."""
        return TABLES[self._connection.autopilot().kind](self.facts)

    async def examine(self) -> list[Finding]:
        """Read everything that the table asks about, and judge it.

        Raises:
            LinkError: the autopilot went away.
        """
        table = self.advice
        self.parameters |= await self.read(name for advice in table for name in advice.names)
        if not self.parameters:
            raise LinkLost("the autopilot is heard but tells none of its parameters: check that it hears us")
        return [judged(advice, self.parameters) for advice in table]

    async def read(self, names: Iterable[str]) -> dict[str, AutopilotParameter]:
        """Those of the parameters ``names`` that it has; raises LinkError."""
        reads = ReadAll(self._connection.autopilot(), names)
        await self._connection.see_through(Handshake([reads]))
        return reads.found

    async def set(self, parameter: AutopilotParameter) -> AutopilotParameter:
        """Set one parameter, read it back, and return it.

        Raises:
            LinkRejected: the vehicle is armed, or the autopilot keeps another value.
            LinkLost: it does not answer.
            ValueError: such a parameter can't have this value.
        """
        autopilot = self._connection.autopilot()
        write = Write(autopilot, parameter)
        if await self._is_armed():
            raise LinkRejected("the vehicle is armed: parameters are changed only while its motors are off")
        await self._connection.see_through(Handshake([write]))
        found = await self.read([parameter.name])
        if parameter.name not in found:
            raise LinkLost(f"{parameter.name} was set but can't be read back: read it again before you fly")
        now = found[parameter.name]
        if not is_same(now.value, parameter.value):
            raise LinkRejected(f"{parameter.name} was set to {parameter.value:g} but reads back as {now.value:g}")
        self.parameters[now.name] = now
        return now

    async def _is_armed(self) -> bool:
        """What the next heartbeat says; the one before may be old."""
        beat: asyncio.Future[bool] = asyncio.get_running_loop().create_future()

        def hear(message: Any, _: float) -> None:
            if message.get_type() == "HEARTBEAT" and not beat.done():
                beat.set_result(bool(message.base_mode & ARMED))

        leave = self._connection.subscribe(hear)
        try:
            async with asyncio.timeout(BEAT_S):
                return await beat
        except TimeoutError:
            raise LinkLost(f"no HEARTBEAT within {BEAT_S:g} s, so nobody knows whether it is armed") from None
        finally:
            leave()
