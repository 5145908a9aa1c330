"""A slow radio: commands are heard late, in order, and what is told of it costs little."""

import asyncio

import pytest

from sim.autopilots import AutopilotPeer, Px4Autopilot
from sim.time import VirtualTimeLoop
from tests.airframe_double import Brick


class Ear(Px4Autopilot):
    """Writes down what it hears, and when."""

    heard: list[tuple[float, bytes]]

    def receive(self, datagram: bytes, now_s: float) -> list[bytes]:
        self.heard.append((now_s, datagram))
        return []


@pytest.mark.parametrize("delay_s", [0.0, 0.05])
def test_every_command_is_heard_late_by_the_delay_and_in_order(delay_s: float) -> None:
    ear = Ear(Brick())
    ear.heard = []
    sent: list[tuple[float, bytes]] = []

    async def talk() -> None:
        loop = asyncio.get_running_loop()
        spoken: asyncio.Future[tuple[str, int]] = loop.create_future()

        class Station(asyncio.DatagramProtocol):
            def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
                if not spoken.done():
                    spoken.set_result(addr)

        transport, _ = await loop.create_datagram_endpoint(Station, local_addr=("127.0.0.1", 14540))
        peer = asyncio.create_task(AutopilotPeer(ear, ("127.0.0.1", 14540), hearing_s=delay_s).run())
        where = await spoken
        for number in range(8):
            for part in b"ab":  # two at the same instant
                sent.append((loop.time(), bytes([number, part])))
                transport.sendto(sent[-1][1], where)
            await asyncio.sleep(0.02)
        await asyncio.sleep(0.2)
        peer.cancel()
        transport.close()

    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        runner.run(talk())
    assert [data for _, data in ear.heard] == [data for _, data in sent]
    lateness = [heard - left for (heard, _), (left, _) in zip(ear.heard, sent, strict=True)]
    assert lateness == pytest.approx([delay_s] * 16, abs=1e-6)
