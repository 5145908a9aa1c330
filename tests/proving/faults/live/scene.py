"""A station in processes of its own with what hangs on it, and what kills each of them."""

import asyncio
import contextlib
import math
import os
import signal
from collections.abc import Awaitable, Callable
from pathlib import Path

from groundstation.core.mission import FINAL, State
from groundstation.settings import Config
from links.core import make_child_command
from links.rf import Channels, RfLinkConfig
from sim.runs import Stage
from tests.proving.faults.deck import Moves
from tests.proving.faults.judge import set_point
from tests.proving.faults.live.broker import Broker

PACER = "links.rf.pacer_child"
"""What paces the frames of a radio, in a process of its own."""


class LiveScene:
    """One flight of it; the simulated vehicle is in this process."""

    def __init__(
        self, folder: Path, config: Config, stage: Stage, broker: Broker, moves: Moves, radio: RfLinkConfig | None
    ) -> None:
        """``radio`` is the module that the commands leave by, where there is one."""
        self.folder, self.config, self.stage, self.broker, self.moves = folder, config, stage, broker, moves
        self.station: asyncio.subprocess.Process
        self.screen: asyncio.subprocess.Process | None = None
        self.bridge: asyncio.subprocess.Process | None = None
        """It has the radio module, where the station itself has none."""
        self.log: list[str] = []
        self.frames: list[tuple[float, float]] = []
        """When, and thrust as a share."""
        self.bytes_s: list[float] = []
        """When anything came at all."""
        self.finite = True
        self._stopped: int | None = None
        if radio is not None:
            codec = radio.codec()
            self._decoder = codec.decoder()
            self._channels = Channels(radio.with_thrust_curve(0.0).map, count=codec.channels, thrust_max_n=1.0)

    def heard_radio(self, time_s: float, data: bytes) -> None:
        """Bytes for a radio module."""
        for heard in self._decoder.feed(data):
            if heard.positions is not None:
                sticks = self._channels.read(heard.positions)
                self.frames.append((time_s, sticks.thrust_n if sticks.armed else 0.0))

    def has_heard(self, time_s: float, data: bytes) -> None:
        """Bytes that have come from the station."""
        self.bytes_s.append(time_s)
        told = set_point(data)
        if told is not None:
            self.frames.append((time_s, told[0]))
            self.finite = self.finite and math.isfinite(sum(told))

    async def read(self) -> None:
        """Follow what the station says."""
        assert self.station.stderr is not None, "it is a pipe"
        async for line in self.station.stderr:
            text = line.decode(errors="replace").rstrip()
            self.log.append(text)
            # INFO 12.345 state: why
            state, colon, reason = text.partition(" ")[2].partition(" ")[2].partition(": ")
            if colon and state in tuple(State) and self.moves.state not in FINAL:  # then it makes ready for the next
                self.moves.entered(State(state), reason)

    async def serve_scene(self) -> None:
        """Wait for its status socket."""
        while True:
            if (self.folder / "status.sock").exists():
                return
            await asyncio.sleep(0.05)

    def child(self, module: str) -> int:
        """The number of the process that runs ``module``, below the station or the bridge."""
        parents = [process.pid for process in (self.station, self.bridge) if process is not None]
        for parent in parents:  # grows by the children of each
            for child in map(int, Path(f"/proc/{parent}/task/{parent}/children").read_text().split()):
                if module.encode() in Path(f"/proc/{child}/cmdline").read_bytes().split(b"\0"):
                    return child
                parents.append(child)
        raise RuntimeError(f"nobody runs {module}")

    def stop(self, module: str) -> None:
        """Have what runs ``module`` stand still."""
        self._stopped = os.pidfd_open(self.child(module))
        signal.pidfd_send_signal(self._stopped, signal.SIGSTOP)

    async def end(self) -> None:
        """Leave no process behind: what stands still would not hear that its station is gone."""
        for process in (self.station, self.screen, self.bridge):
            if process is not None and process.returncode is None:
                process.kill()
                await process.wait()
        if self._stopped is not None:
            with contextlib.suppress(ProcessLookupError):
                signal.pidfd_send_signal(self._stopped, signal.SIGKILL)
            os.close(self._stopped)

    async def show(self) -> None:
        """Have a screen watch, on a terminal of its own."""
        await self.serve_scene()
        far, near = os.openpty()
        loop = asyncio.get_running_loop()
        os.set_blocking(far, False)

        def drain() -> None:
            try:
                os.read(far, 65536)
            except OSError:  # the screen is gone
                loop.remove_reader(far)
                os.close(far)

        loop.add_reader(far, drain)
        self.screen = await asyncio.create_subprocess_exec(
            *make_child_command("groundstation", "tui", "--socket", str(self.folder / "status.sock")),
            stdin=near, stdout=near, stderr=near, env=os.environ | {"TERM": "xterm-256color"},
        )  # fmt: skip
        os.close(near)


async def _kill(scene: LiveScene) -> None:
    scene.station.kill()


async def _kill_recorder(scene: LiveScene) -> None:
    os.kill(scene.child("groundstation.recording"), signal.SIGKILL)


async def _kill_pacer(scene: LiveScene) -> None:
    os.kill(scene.child(PACER), signal.SIGKILL)


async def _stop_pacer(scene: LiveScene) -> None:
    scene.stop(PACER)


async def _interrupt_bridge(scene: LiveScene) -> None:
    assert scene.bridge is not None, "the bridge runs"
    scene.bridge.send_signal(signal.SIGINT)


async def _kill_broker(scene: LiveScene) -> None:
    if not scene.broker.published:
        raise RuntimeError("nothing was published")
    scene.broker.kill()


async def _kill_screen(scene: LiveScene) -> None:
    assert scene.screen is not None, "the screen runs"
    if scene.screen.returncode is not None:
        raise RuntimeError("the screen has ended already")
    scene.screen.kill()


STRIKES: dict[str, Callable[[LiveScene], Awaitable[None]]] = {
    "SIGKILL": _kill,
    "SIGKILL, radio": _kill,
    "pacer killed": _kill_pacer,
    "pacer stopped": _stop_pacer,
    "pacer killed, bridge": _kill_pacer,
    "bridge interrupted": _interrupt_bridge,
    "recorder failure": _kill_recorder,
    "MQTT broker gone": _kill_broker,
    "TUI crash": _kill_screen,
}
"""What strikes each fault; its name as in :data:`tests.proving.faults.deck.faults.FAULTS`."""
