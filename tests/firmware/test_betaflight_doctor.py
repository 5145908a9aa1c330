"""The doctor on Betaflight's own firmware: a board on its command line, which restarts."""

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from groundstation.config import ConfigError, from_dict
from groundstation.lab import DoctorOrders, run_doctor
from groundstation.lab.doctor import load_restore
from groundstation.runtime import Exit
from groundstation.settings import Config
from links.rf import RfConfig, describe_pulses
from sim.autopilots import GAINS, BetaflightFirmware, configure, describe_settings, pack_pulses
from sim.radio import PtyWire, section
from sim.scenarios import SCENARIOS, with_betaflight

pytestmark = pytest.mark.firmware
IDLE, ARMED = (1500, 1500, 885, 1500, 988), (1500, 1500, 885, 1500, 2012)
WRONG = (
    "set roll_srate = 67",
    "set rc_smoothing = ON",
    "set failsafe_delay = 60",
    "rxfail 4 h",
    "aux 2 1 1 1300 1700 0 0",
    "set i_yaw = 80",
    "set thr_hover = 30",
)
"""A rate, a lag, two of failsafe, ANGLE where our frames are, a gain, a throttle corner."""
WRONGLY = {"roll_srate", "rc_smoothing", "failsafe_delay", "rxfail 4", "aux 2", "i_yaw"}
WRONGLY |= {"thr_hover"}


def told() -> Config:
    """What `serve --autopilot betaflight --link crsf` is told."""
    world = with_betaflight(SCENARIOS["paper"]).world
    link = section("crsf", world, from_dict({}, Config).vehicle, betaflight=True)
    return from_dict({"link": link}, Config)


def recipe(config: Config) -> list[str]:
    assert isinstance(config.link, RfConfig)
    sticks = config.link.map.roll, config.link.map.pitch, config.link.map.yaw
    rates = [one.full_rate_deg_s for one in sticks]
    return [*describe_settings(*describe_pulses(config.link), rates), *GAINS]


class Host:
    """A board that is switched on: its port stays, its firmware restarts."""

    def __init__(self, settings: Sequence[str]) -> None:
        self.eeprom = configure(settings)
        self.pulses: Sequence[int] = IDLE
        self.restarts = 0
        self._cli_port = 0

    @contextlib.asynccontextmanager
    async def on(self) -> AsyncIterator[str]:
        """Switched on; the address of its port."""
        server = await asyncio.start_server(self._relay, "127.0.0.1", 0)
        running = asyncio.create_task(self._run())
        try:
            # It boots for as long as the machine takes.
            while not self._cli_port and not running.done():
                await asyncio.sleep(0.01)
            yield f"127.0.0.1:{server.sockets[0].getsockname()[1]}"
        finally:
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)
            server.close()
            await asyncio.sleep(0.1)  # what was relayed ends with it

    async def _run(self) -> None:
        while True:
            with BetaflightFirmware(self.eeprom) as firmware:
                with contextlib.suppress(EOFError):
                    for step in range(10**9):
                        fresh = pack_pulses(self.pulses) if step > 2000 and step % 20 == 0 else None
                        port = firmware.step(channels=fresh).cli_port
                        if step > 2000:
                            self._cli_port = port
                        if step % 10 == 0:
                            await asyncio.sleep(0.0005)
                self._cli_port, self.restarts = 0, self.restarts + 1
                self.eeprom = firmware.read_settings()

    async def _relay(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        ends = [writer]
        try:
            theirs, there = await asyncio.open_connection("127.0.0.1", self._cli_port)
            ends.append(there)
            ends_of = ((reader, there), (theirs, writer))
            ways = [asyncio.create_task(_pump(*one)) for one in ends_of]
            await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
            for way in ways:
                way.cancel()
            await asyncio.gather(*ways, return_exceptions=True)
        except OSError:
            pass  # it is restarting
        finally:
            for end in ends:
                end.transport.abort()


@contextlib.asynccontextmanager
async def serial(port: str) -> AsyncIterator[str]:
    """A serial port that leads to the board's other port, and stays while the board restarts."""
    host, number = port.split(":")
    wire = PtyWire()

    async def hold() -> None:
        while True:
            reader, writer = await asyncio.open_connection(host, int(number))
            wire.listen(writer.write)
            try:
                while data := await reader.read(4096):
                    wire.sendto(data)
            except OSError:
                pass  # it restarts
            finally:
                writer.transport.abort()
            await asyncio.sleep(0.1)

    holding = asyncio.create_task(hold())
    try:
        yield wire.path
    finally:
        holding.cancel()
        await asyncio.gather(holding, return_exceptions=True)
        wire.close()


async def _pump(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    with contextlib.suppress(OSError):
        while data := await reader.read(4096):
            writer.write(data)
            await writer.drain()


RESTARTS_S = 20.0
"""A board that says that it restarts has done so within this, however busy [s]."""


def visit(
    host: Host, folder: Path, *, by_serial: bool = False, restarts: int = 0, **orders: Any
) -> tuple[int, str]:
    """Its exit code and what was said, once the host has restarted so often in all."""
    said: list[str] = []

    async def main() -> int:
        async with contextlib.AsyncExitStack() as stack:
            port = await stack.enter_async_context(host.on())
            if by_serial:
                port = await stack.enter_async_context(serial(port))
            told_to = DoctorOrders("doctor", folder=folder, board=port, **orders)
            code = await run_doctor(told(), told_to, None, said.append)
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(RESTARTS_S):
                    while host.restarts < restarts:  # the visitor is gone when it hears of it
                        await asyncio.sleep(0.01)
            return code

    return asyncio.run(main()), "\n".join(said)


def wrong_in(said: str) -> dict[str, Any]:
    """Values that must or should change, by their names."""
    findings = json.loads(said)["findings"]
    return {one["name"]: one["value"] for one in findings if one["verdict"] in ("must", "should")}


def test_a_board_that_was_told_the_recipe_has_nothing_to_change(tmp_path: Path) -> None:
    host = Host(recipe(told()))
    code, said = visit(host, tmp_path, restarts=1)
    assert "Nothing to change" in said
    assert code == Exit.DONE
    assert host.restarts == 1
    assert list(tmp_path.iterdir()) == []


def test_each_wrong_setting_is_found_and_nothing_is_changed(tmp_path: Path) -> None:
    host = Host([*recipe(told()), *WRONG])
    before = host.eeprom
    code, said = visit(host, tmp_path, as_json=True)
    assert wrong_in(said).keys() == WRONGLY
    assert json.loads(said)["autopilot"] == "Betaflight"
    assert code == Exit.FAILED
    assert host.eeprom == before
    assert list(tmp_path.iterdir()) == []


def test_a_board_as_it_is_delivered_is_told_what_must_change(tmp_path: Path) -> None:
    code, said = visit(Host([]), tmp_path, as_json=True)
    assert code == Exit.FAILED
    expected = {"aux 0", "min_check", "rc_smoothing", "runaway_takeoff_prevention"}
    expected |= {"i_yaw", "roll_srate"}
    assert expected <= wrong_in(said).keys()


def test_settings_are_set_one_by_one_and_can_be_put_back(tmp_path: Path) -> None:
    host = Host([*recipe(told()), *WRONG])
    code, said = visit(
        host, tmp_path, restarts=len(WRONGLY) + 1, fix=tuple(sorted(WRONGLY)), yes=True
    )
    assert code == Exit.DONE, said
    assert "rc_smoothing: ON became OFF, read back" in said
    assert host.restarts == len(WRONGLY) + 1
    kept = {one.name: one for one in map(load_restore, tmp_path.iterdir())}
    assert {name: one.value for name, one in kept.items()} == {
        "roll_srate": 67.0, "rc_smoothing": "ON", "failsafe_delay": 60.0, "rxfail 4": "h",
        "aux 2": "1 1 1300 1700 0 0",
        "i_yaw": 80.0, "thr_hover": 30.0,
    }  # fmt: skip
    (file,) = tmp_path.glob("*aux_2.json")
    code, said = visit(host, tmp_path, restore=file, yes=True, as_json=True)
    assert code == Exit.FAILED
    assert wrong_in(said) == {"aux 2": "1 1 1300 1700 0 0"}


def test_a_serial_port_leads_to_it_as_well(tmp_path: Path) -> None:
    host = Host([*recipe(told()), WRONG[1]])
    code, said = visit(host, tmp_path, by_serial=True, fix=("rc_smoothing",), yes=True)
    assert code == Exit.DONE, said
    assert "rc_smoothing: ON became OFF, read back" in said


def test_an_armed_board_is_neither_read_nor_changed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    host = Host([*recipe(told()), *WRONG])
    before = host.eeprom

    async def main() -> int:
        async with host.on() as port:
            await asyncio.sleep(6.0)
            host.pulses = ARMED
            await asyncio.sleep(3.0)
            orders = DoctorOrders("doctor", folder=tmp_path, board=port, fix=("i_yaw",), yes=True)
            return await run_doctor(told(), orders, None)

    assert asyncio.run(main()) == Exit.UNHEARD
    assert "the vehicle is armed" in capsys.readouterr().err
    assert (host.restarts, host.eeprom) == (0, before)
    assert list(tmp_path.iterdir()) == []


def test_a_value_that_the_firmware_makes_another_of_is_told_of(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _ = visit(Host(recipe(told())), tmp_path, fix=("failsafe_delay=10.5",), yes=True)
    assert code == Exit.UNHEARD
    assert "failsafe_delay was set to 10.5 but reads back as 10" in capsys.readouterr().err


def test_a_port_where_nobody_is_is_told_of(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    orders = DoctorOrders("doctor", folder=tmp_path, board="127.0.0.1:9")
    assert asyncio.run(run_doctor(told(), orders, None)) == Exit.UNHEARD
    assert "127.0.0.1:9" in capsys.readouterr().err


def test_a_map_that_no_board_can_have_is_told_of(tmp_path: Path) -> None:
    config = from_dict(
        {"link": {"kind": "crsf", "map": {"roll": {"channel": 1, "full_rate_deg_s": 205}}}}, Config
    )
    with pytest.raises(ConfigError, match="whole tens"):
        asyncio.run(
            run_doctor(config, DoctorOrders("doctor", folder=tmp_path, board="127.0.0.1:9"), None)
        )
