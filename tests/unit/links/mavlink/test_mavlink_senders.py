"""Who sends as the vehicle: two autopilots with one system id, and one autopilot by two ways."""

import asyncio
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from links.core import LinkError
from links.io import make_key, read_key
from links.mavlink import MavlinkLink, MavlinkLinkConfig
from links.mavlink.protocol import PX4, MavCommand, Signer, TargetSenders, load_dialect
from links.mavlink.protocol.senders import hardware_id
from tests.loops import Scene, in_virtual_time, on_stage
from tests.unit.links.mavlink.test_mavlink_link import Endpoint, accept, command

# By their numbers: a limit that the test took from the code would bear out any value.
BOTH_S = 3.0

D = load_dialect()
HERE, THERE, ELSEWHERE = ("10.0.0.5", 14550), ("10.0.0.9", 14550), ("10.0.0.5", 14551)


def version(uid: int = 0, uid2: bytes = bytes(18)) -> Any:
    none = bytes(8)
    return D.MAVLink_autopilot_version_message(0, 0, 0, 0, 0, none, none, none, 0, 0, uid, uid2)


def senders(*heard: tuple[tuple[str, int], int | None]) -> TargetSenders:
    """After the heartbeats at 1 s of these addresses, which have told these hardware ids."""
    seen = TargetSenders(1, lambda address: f"{address[0]}:{address[1]}")
    for address, uid in heard:
        seen.beat(address, 1.0)
        if uid is not None:
            seen.identify(address, version(uid))
    return seen


def test_the_long_hardware_id_counts_before_the_short_one() -> None:
    assert hardware_id(version(0xBEEF)) == "beef"
    assert hardware_id(version(0xBEEF, b"\x12\x34" + bytes(16))) == "1234"
    assert hardware_id(version()) == ""


@pytest.mark.parametrize(
    ("heard", "conflict", "second_path"),
    [
        ([(HERE, None)], "", ""),
        *(
            ([(HERE, first), (THERE, second)], r"at 10\.0\.0\.5:14550.*at 10\.0\.0\.9:14550", "")
            for first, second in ((1, 2), (1, 0), (0, 2), (0, 0), (1, None), (None, None))
        ),
        ([(HERE, 7), (ELSEWHERE, 7)], "", r":14550 and 10\.0\.0\.5:14551: only the first is used"),
        (
            [(HERE, 1), (THERE, 2), (("10.0.0.7", 14550), 3)],
            r"^several autopilots with MAVLink system id 1 are heard: one at 10\.0\.0\.5:14550 .*"
            r"10\.0\.0\.9:14550 \(hardware id 2\) and one at 10\.0\.0\.7:14550 \(hardware id 3\)",
            "",
        ),
    ],
)
def test_senders_conflict_and_are_all_named_unless_they_tell_the_same_hardware_id(
    heard: list[tuple[tuple[str, int], int | None]], conflict: str, second_path: str
) -> None:
    seen = senders(*heard)
    for told, expected in (
        (seen.conflict(HERE, 1.0), conflict),
        (seen.second_path(HERE, 1.0), second_path),
    ):
        assert re.search(expected, told) if expected else told == ""


def test_a_second_sender_counts_until_it_has_been_silent_for_three_seconds() -> None:
    seen = senders((HERE, None), (THERE, None))
    seen.beat(HERE, 4.0)
    assert seen.conflict(HERE, 1.0 + BOTH_S)
    assert seen.conflict(HERE, 1.1 + BOTH_S) == ""


def test_two_hardware_ids_at_one_address_conflict_until_a_silence() -> None:
    seen = senders((HERE, 0xA1), (HERE, 0xB2))
    says = "2 autopilots with MAVLink system id 1 answer from 10.0.0.5:14550 (hardware ids a1, b2)"
    assert says in seen.conflict(HERE, 1.0)
    seen.beat(HERE, 1.1 + BOTH_S)
    assert seen.conflict(HERE, 1.1 + BOTH_S) == ""


def test_another_autopilot_than_the_one_that_was_examined_conflicts() -> None:
    seen = senders((HERE, 7))
    seen.examine(HERE)
    seen.beat(THERE, 9.0)
    says = "10.0.0.9:14550 (which tells no hardware id) is not the one that was checked at 10.0.0.5"
    assert says in seen.conflict(THERE, 9.0)
    seen.identify(THERE, version(7))
    assert seen.conflict(THERE, 9.0) == ""
    seen.beat(HERE, 20.0)  # after a silence, from the same address
    assert seen.conflict(HERE, 20.0) == ""
    seen.identify(HERE, version(8))
    assert "not the one that was checked" in seen.conflict(HERE, 20.0)


# ---- on a link


def tells(uid: int, frames: Callable[[Any], list[Any]] = accept) -> Callable[[Any], list[Any]]:
    """Answers as ``frames`` do, and tells the hardware id ``uid`` where it is asked for."""

    def answer(message: Any) -> list[Any]:
        request = getattr(message, "command", None), getattr(message, "param1", None)
        asked = request == (MavCommand.REQUEST_MESSAGE, 148.0)
        return [*([version(uid)] if asked else []), *frames(message)]

    return answer


def scene(uids: tuple[int, int] = (1, 2)) -> Callable[[Scene], Callable[..., None]]:
    """Make a test of a coroutine with a connected link, its autopilot, and a silent second one."""

    @in_virtual_time
    async def main(play: Scene) -> None:
        vehicle, other = await Endpoint().open(), await Endpoint().open()
        vehicle.answer, other.answer = map(tells, uids)
        link = MavlinkLink(MavlinkLinkConfig(quiet=False), thrust_max_n=2.0)
        beating = asyncio.create_task(vehicle.beating())
        # Its port may be closed.
        beating.add_done_callback(lambda task: task.cancelled() or task.exception())
        try:
            await link.connect()
            await play(link, vehicle, other)
        finally:
            beating.cancel()
            await link.close()

    return on_stage(main, 3)


def port_of(end: Endpoint) -> str:
    host, port = end.transport.get_extra_info("sockname")[:2]
    return f"{host}:{port}"


@scene()
async def test_with_a_second_vehicle_on_the_port_nothing_is_armed_and_both_addresses_are_named(
    link: MavlinkLink, vehicle: Endpoint, other: Endpoint
) -> None:
    beating = asyncio.create_task(other.beating())
    await asyncio.sleep(0.1)
    for end in (vehicle, other):
        assert port_of(end) in link.status.conflict
    with pytest.raises(LinkError, match="arming was abandoned: two autopilots with MAVLink"):
        await link.arm(lambda: command(0.0))
    for end in (vehicle, other):
        assert [m for m in end.of("COMMAND_LONG") if m.command == MavCommand.ARM_DISARM] == []
    assert other.of("SET_ATTITUDE_TARGET") == []
    beating.cancel()
    await asyncio.sleep(BOTH_S + 1.1)
    assert link.status.conflict == ""
    await link.arm(lambda: command(0.0))
    assert other.of("SET_ATTITUDE_TARGET") == []


@scene(uids=(7, 7))
async def test_one_autopilot_by_two_ways_is_warned_of_and_armed_by_the_first(
    link: MavlinkLink, vehicle: Endpoint, other: Endpoint
) -> None:
    beating = asyncio.create_task(other.beating())
    await asyncio.sleep(0.1)
    assert link.status.conflict == ""
    assert f"{port_of(vehicle)} and {port_of(other)}: only the first is used" in link.status.warning
    await link.arm(lambda: command(0.0))
    assert other.of("SET_ATTITUDE_TARGET") == []
    beating.cancel()


@scene()
async def test_two_vehicles_behind_one_radio_are_told_apart_by_their_hardware_ids(
    link: MavlinkLink, vehicle: Endpoint, other: Endpoint
) -> None:
    vehicle.answer = lambda message: [*tells(1)(message), *tells(2, lambda _: [])(message)]
    await link.examine()
    await asyncio.sleep(0.1)
    assert "2 autopilots with MAVLink system id 1 answer from" in link.status.conflict


@scene()
async def test_a_vehicle_that_takes_the_place_of_the_examined_one_is_not_armed(
    link: MavlinkLink, vehicle: Endpoint, other: Endpoint
) -> None:
    await link.examine()
    vehicle.transport.abort()
    await asyncio.sleep(5.0)
    beating = asyncio.create_task(other.beating())
    await asyncio.sleep(1.0)
    assert link.status.state == "connected"
    with pytest.raises(LinkError, match="is not the one that was checked"):
        await link.arm(lambda: command(0.0))
    await link.examine()
    await link.arm(lambda: command(0.0))
    beating.cancel()


@in_virtual_time
async def test_signed_frames_replayed_from_another_port_are_refused_and_no_second_vehicle(
    tmp_path: Path,
) -> None:
    make_key(path := tmp_path / "key")
    link = MavlinkLink(MavlinkLinkConfig(quiet=False, signing_key_file=str(path)), thrust_max_n=2.0)
    vehicle, thief = await Endpoint().open(), await Endpoint().open()
    first = 400_000_000_000_00
    loop = asyncio.get_running_loop()
    vehicle.codec.signer = Signer(read_key(path), lambda: first + int(loop.time() * 1e5))
    vehicle.answer = accept
    beating = asyncio.create_task(vehicle.beating())
    await link.connect()
    caught = vehicle.codec.pack(D.MAVLink_heartbeat_message(2, PX4, 0, 0, 3, 3))
    for end, frame in ((vehicle, caught), (thief, caught), (thief, caught[:-6] + bytes(6))):
        end.transport.sendto(frame, end.remote)
        await asyncio.sleep(0.01)
    assert link.status.conflict == ""
    assert (link.status.dropped["replayed"], link.status.dropped["bad_signature"]) == (1, 1)
    received, kept = link.status.received, int((tmp_path / "key.stamp").read_text())
    await asyncio.sleep(1.0)
    assert link.status.received > received, "the vehicle itself is still heard"
    assert int((tmp_path / "key.stamp").read_text()) > kept, "a crash reuses no stamp"
    beating.cancel()
    await link.close()
