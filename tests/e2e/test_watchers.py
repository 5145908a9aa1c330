"""A whole flight with everybody watching: the dashboard in a terminal and a broker, both of which die in flight."""

import asyncio
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import msgspec

from groundstation.core.messages import Snapshot
from groundstation.interfaces.tui.drawing import big
from tests.e2e.stations import served
from tests.e2e.test_mqtt import Broker, Listener, broker
from tests.e2e.test_tui import Terminal, terminal

__all__ = ["broker", "terminal"]


async def on_broker(server: Broker, true: Callable[[Snapshot], bool]) -> Snapshot:
    """The first snapshot on the broker that satisfies ``true``."""
    found: list[Snapshot] = []

    def enough(listener: Listener) -> bool:
        texts = listener.got["lab/mqx/snapshot"]
        found[:] = [s for text in texts if true(s := msgspec.json.decode(text, type=Snapshot))]
        return bool(found)

    async with asyncio.timeout(60.0), Listener(server.port) as listener:
        await listener.until(enough)
    return found[0]


def test_dashboard_and_broker_show_a_flight_and_their_deaths_do_not_touch_it(
    broker: Callable[[], Broker], terminal: Terminal, tmp_path: Path
) -> None:
    server = broker()
    asyncio.run(server.start())
    with served() as room:
        mqtt = ["mqtt.enabled=true", f"mqtt.port={server.port}", "mqtt.prefix=lab"]
        daemon = subprocess.Popen(
            room.station("daemon", "--arm", "mqx", *(part for key in mqtt for part in ("--set", key))),
            stderr=subprocess.PIPE,
            text=True,
            stdin=subprocess.DEVNULL,
        )
        try:
            terminal.start(sys.executable, "-m", "groundstation", "tui", "--socket", room.status_socket)
            terminal.wait_for(*big("tracking"), "following the trajectory")
            shown = asyncio.run(on_broker(server, lambda s: s.state == "tracking" and s.error_m < 0.1))
            assert shown.vehicle == "mqx"
            server.kill()
            terminal.close()
            asyncio.run(asyncio.sleep(1.0))
            assert daemon.poll() is None
            daemon.send_signal(signal.SIGTERM)
            _, log = daemon.communicate(timeout=60)
        finally:
            daemon.kill()
            daemon.wait()
    assert daemon.returncode == 0, log
    assert "landed and disarmed" in log
