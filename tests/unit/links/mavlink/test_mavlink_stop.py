"""End of a MAVLink flight: by force, by mode LAND, by bring-down. And a network without room."""

import asyncio
import time  # noqa: TID251  # to stand still
from collections.abc import Callable
from typing import Any
from unittest.mock import Mock

import pytest

from links.core import Command, Deadman, LinkError, LinkLost, LinkMisuse, LinkRejected, Segment
from links.io import Datagrams
from links.mavlink import MavlinkLink, MavlinkLinkConfig
from links.mavlink.link import Transmitter
from links.mavlink.protocol import ARDUPILOT, PX4, ForwardConfig, MavCommand, MavlinkCodec
from tests.loops import in_real_time, in_virtual_time
from tests.unit.links.mavlink.test_mavlink_link import (
    D,
    Endpoint,
    accept,
    ack,
    command,
    play_scene,
    scene,
)

PARTS = (Segment(1.0, 0.8, (0.2, 0.0, 0.0)), Segment(0.2, 0.0, (0.0, 0.0, 0.0)))


def idle() -> Command:
    return command(0.0)


def flown() -> Command:
    now = asyncio.get_running_loop().time()
    return Command(1.0, (0.0, 0.0, 0.0), 1, now, now + 0.25, PARTS)


def is_kill(message: Any) -> bool:
    if message.get_type() != "COMMAND_LONG":
        return False
    return (message.command, message.param1, message.param2) == (
        MavCommand.ARM_DISARM,
        0.0,
        21196.0,
    )


def modes(autopilot: Endpoint) -> list[tuple[float, float]]:
    """Modes that were asked for: MAV_CMD_DO_SET_MODE's second and third parameter."""
    asked = [m for m in autopilot.of("COMMAND_LONG") if m.command == MavCommand.DO_SET_MODE]
    return [(m.param2, m.param3) for m in asked]


def arms(message: Any) -> list[Any]:
    """Accept, with the parameters by which ArduPilot is armed."""
    if message.get_type() == "PARAM_REQUEST_READ":
        right = {"GUID_OPTIONS": 8.0, "ATC_ANGLE_BOOST": 0.0}[message.param_id]
        return [D.MAVLink_param_value_message(message.param_id.encode(), right, 9, 1, 0)]
    return accept(message)


@scene()
async def test_a_kill_is_repeated_until_it_is_acknowledged_and_the_stream_ends_before_it(
    link: MavlinkLink, autopilot: Endpoint
) -> None:
    await link.arm(idle)
    link.send(flown())
    await asyncio.sleep(0.1)
    autopilot.heard.clear()
    heard: list[Any] = []

    def answer(message: Any) -> list[Any]:
        heard.append(message)
        obeys = is_kill(message) and sum(map(is_kill, heard)) > 20
        return [ack(MavCommand.ARM_DISARM)] if obeys else []

    autopilot.answer = answer
    await link.kill()
    kills = [m for m in heard if is_kill(m)]
    assert len(kills) in (22, 23)
    assert [m.confirmation for m in kills[:3]] == [0, 1, 2]
    assert heard.index(kills[0]) <= 1  # one set-point may have been under way
    assert not [m for m in heard[heard.index(kills[0]) :] if m.get_type() == "SET_ATTITUDE_TARGET"]
    assert link.status.state == "connected"
    await asyncio.sleep(3.0)
    assert not link.send(flown())
    assert len([m for m in heard if is_kill(m)]) == len(kills)


@scene()
async def test_one_acknowledgement_alone_may_belong_to_an_order_to_arm(
    link: MavlinkLink, autopilot: Endpoint
) -> None:
    autopilot.answer = lambda message: []
    killing = asyncio.create_task(link.kill())
    await asyncio.sleep(0.01)
    autopilot.say(ack(MavCommand.ARM_DISARM))
    await asyncio.sleep(1.0)
    assert sum(map(is_kill, (m for _, m in autopilot.heard))) > 15
    autopilot.say(ack(MavCommand.ARM_DISARM))
    await killing


@pytest.mark.parametrize(("result", "error"), [(None, LinkLost), (2, LinkRejected)])
@scene()
async def test_a_kill_that_nobody_obeys_says_what_to_do(
    link: MavlinkLink, autopilot: Endpoint, result: int | None, error: type[LinkError]
) -> None:
    autopilot.answer = lambda m: (
        [ack(MavCommand.ARM_DISARM, result)] if result is not None and is_kill(m) else []
    )
    with pytest.raises(error, match="kill switch"):
        await link.kill()


@scene()
async def test_a_kill_while_arming_ends_that_and_nobody_arms_after_it(
    link: MavlinkLink, autopilot: Endpoint
) -> None:
    autopilot.answer = lambda m: (
        accept(m) if getattr(m, "command", None) != MavCommand.ARM_DISARM or is_kill(m) else []
    )
    arming = asyncio.create_task(link.arm(idle))
    await asyncio.sleep(1.4)  # the order to arm has left
    killing = asyncio.create_task(link.kill())
    await asyncio.sleep(0)
    with pytest.raises(LinkMisuse, match=r"killed|streams"):
        await link.arm(idle)
    with pytest.raises(LinkError, match="killed"):
        await arming
    await killing
    orders = [m for m in autopilot.of("COMMAND_LONG") if m.command == MavCommand.ARM_DISARM]
    first = next(i for i, m in enumerate(orders) if is_kill(m))
    assert first > 0
    assert all(m.param1 == 0.0 for m in orders[first:])
    assert not link.send(flown())


@scene()
async def test_a_kill_works_on_a_link_that_is_lost_or_brings_down_and_waits_for_no_handshake(
    link: MavlinkLink, autopilot: Endpoint
) -> None:
    await link.arm(idle)
    link.send(flown())
    await asyncio.sleep(0.5)
    assert link.status.phase == "bring_down"
    autopilot.answer = lambda m: [ack(MavCommand.ARM_DISARM)] if is_kill(m) else []
    disarming = asyncio.create_task(link.disarm())  # holds the queue of hand-shakes
    await asyncio.sleep(0.01)
    await link.kill()
    assert link.status.phase == "over"
    with pytest.raises(LinkError):
        await disarming


@in_virtual_time
async def test_a_closed_link_cannot_kill_and_says_so() -> None:
    with pytest.raises(LinkLost, match="kill switch"):
        await MavlinkLink(MavlinkLinkConfig(), thrust_max_n=2.0).kill()


@pytest.mark.parametrize(("kind", "mode"), [(PX4, (4.0, 6.0)), (ARDUPILOT, (9.0, 0.0))])
def test_land_is_asked_for_beside_the_rates_which_end_when_it_is_accepted(
    kind: int, mode: tuple[float, float]
) -> None:
    async def play(link: MavlinkLink, autopilot: Endpoint) -> None:
        lands: list[float] = []

        def answer(message: Any) -> list[Any]:
            command = getattr(message, "command", None)
            if command == MavCommand.DO_SET_MODE and (message.param2, message.param3) == mode:
                lands.append(asyncio.get_running_loop().time())
                return [] if len(lands) == 1 else accept(message)  # the first got lost
            if command == MavCommand.REQUEST_MESSAGE:
                autopilot.beat()
            return arms(message)

        autopilot.answer = answer
        autopilot.armed = True
        await link.arm(idle)
        link.send(flown())
        await asyncio.sleep(0.26)
        autopilot.heard.clear()
        await link.silent()
        assert len(lands) == 2
        frames = [
            (t, m.thrust) for t, m in autopilot.heard if m.get_type() == "SET_ATTITUDE_TARGET"
        ]
        assert len(frames) > 15  # the rates went on until it was accepted
        assert {round(thrust, 3) for _, thrust in frames} == {0.4}
        assert frames[-1][0] <= lands[-1] + 0.03
        assert not link.send(flown())

    play_scene(play, kind=kind, bring_down="land")


@pytest.mark.parametrize("loses", [0, 2])
@scene(bring_down="land")
async def test_an_autopilot_that_a_pilot_has_just_taken_over_is_asked_for_its_mode_and_not_to_land(
    link: MavlinkLink, autopilot: Endpoint, loses: int
) -> None:
    asked: list[float] = []

    def answer(message: Any) -> list[Any]:
        if getattr(message, "command", None) != MavCommand.REQUEST_MESSAGE:
            return accept(message)
        assert message.param1 == D.MAVLINK_MSG_ID_HEARTBEAT
        asked.append(asyncio.get_running_loop().time())
        posctl = D.MAVLink_heartbeat_message(2, PX4, 128, 3 << 16, 3, 3)
        return [] if len(asked) <= loses else [posctl, *accept(message)]

    autopilot.answer = answer
    await link.arm(idle)
    autopilot.armed = True
    link.send(flown())
    await asyncio.sleep(0.26)
    autopilot.heard.clear()
    await link.silent()
    assert len(asked) == loses + 1
    assert modes(autopilot) == []
    assert link.status.taken == "POSCTL"
    assert all(m.thrust > 0.0 for m in autopilot.of("SET_ATTITUDE_TARGET")), "not to its end"


KNOWN, STILL, GPS_JUMPS, SITS = 831, 167, 831 | 1024, 831 | 128
"""Flags of real autopilots, in flight and on the ground without GPS, and two with a fault."""


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
@pytest.mark.parametrize(
    ("flags", "ago_s", "lands"),
    [
        (KNOWN, 0.5, True),
        (KNOWN, 3.0, False),
        (STILL, 0.5, False),
        (GPS_JUMPS, 0.5, False),
        (SITS, 0.5, False),
    ],
)
def test_unless_told_otherwise_land_is_asked_of_an_autopilot_that_says_that_it_knows_where_it_is(
    kind: int, flags: int, ago_s: float, lands: bool
) -> None:
    async def play(link: MavlinkLink, autopilot: Endpoint) -> None:
        autopilot.answer = arms
        await link.arm(idle)
        autopilot.armed = True
        if kind == PX4:
            autopilot.say(D.MAVLink_estimator_status_message(0, flags, *[0.1] * 8))
        else:
            autopilot.say(D.MAVLink_ekf_status_report_message(flags, *[0.1] * 5))
        for _ in range(round((ago_s - 0.25) / 0.05) + 1):
            link.send(flown())
            await asyncio.sleep(0.05)
        autopilot.heard.clear()
        await link.silent()
        assert modes(autopilot) == ([(4.0, 6.0) if kind == PX4 else (9.0, 0.0)] if lands else [])
        last = autopilot.of("SET_ATTITUDE_TARGET")[-1]
        assert (last.thrust > 0.0) == lands, "the rates ended early, or at their end"

    play_scene(play, kind=kind)


def bridge(name: str) -> Callable[[MavlinkLink, Endpoint], None]:
    """Somebody else behind the same router, who tells the autopilot where it is."""

    def say(_: MavlinkLink, autopilot: Endpoint) -> None:
        other = MavlinkCodec(1, 197)
        told = {
            "vision": D.MAVLink_vision_position_estimate_message(1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
            "mocap": D.MAVLink_att_pos_mocap_message(1, (1.0, 0.0, 0.0, 0.0), 0.0, 0.0, 0.0),
            "battery": D.MAVLink_sys_status_message(0, 0, 0, 0, 0, 0, -1, 0, 0, 0, 0, 0, 0),
        }[name]
        autopilot.transport.sendto(other.pack(told), autopilot.remote)

    return say


def shares(link: MavlinkLink, _: Endpoint) -> None:
    link.shares_poses = True


def nothing(_link: MavlinkLink, _autopilot: Endpoint) -> None:
    pass


FORWARDS = ForwardConfig(enabled=True)


@pytest.mark.parametrize(
    ("settings", "happens", "lands"),
    [
        ({}, nothing, True),
        ({}, bridge("battery"), True),
        ({}, bridge("vision"), False),
        ({}, bridge("mocap"), False),
        ({}, shares, False),
        ({"forward": FORWARDS}, nothing, False),
        ({"forward": FORWARDS, "own_position": True}, bridge("vision"), True),
        ({"forward": FORWARDS, "bring_down": "land"}, shares, True),
        ({"bring_down": "rates"}, nothing, False),
    ],
)
@pytest.mark.parametrize("distrusted", [True, False])
def test_after_poses_were_wrong_land_is_asked_only_where_it_can_not_rest_on_them(
    settings: dict[str, Any],
    happens: Callable[[MavlinkLink, Endpoint], None],
    lands: bool,
    distrusted: bool,
) -> None:
    async def play(link: MavlinkLink, autopilot: Endpoint) -> None:
        autopilot.answer = accept
        await link.arm(idle)
        autopilot.armed = True
        autopilot.say(D.MAVLink_estimator_status_message(0, KNOWN, *[0.1] * 8))
        happens(link, autopilot)
        await asyncio.sleep(0.05)
        link.send(flown())
        if distrusted:
            link.distrust()
        autopilot.heard.clear()
        await link.silent()
        asked = lands or (not distrusted and settings.get("bring_down") != "rates")
        assert bool(modes(autopilot)) == asked

    play_scene(play, **settings)


@scene(bring_down="land")
async def test_a_land_that_is_refused_leaves_the_rates_to_their_end(
    link: MavlinkLink, autopilot: Endpoint
) -> None:
    await link.arm(idle)
    autopilot.armed = True
    autopilot.answer = lambda m: [ack(m.command, 2)] if m.get_type() == "COMMAND_LONG" else []
    link.send(flown())
    await link.silent()
    assert autopilot.of("SET_ATTITUDE_TARGET")[-1].thrust == 0.0


@scene()
async def test_an_autopilot_that_somebody_disarmed_is_not_flown_when_somebody_arms_it_again(
    link: MavlinkLink, autopilot: Endpoint
) -> None:
    await link.arm(idle)
    autopilot.armed = True
    for _ in range(60):
        link.send(flown())
        await asyncio.sleep(0.02)
    autopilot.armed = False
    autopilot.beat()
    await asyncio.sleep(0.01)
    assert not link.send(flown())
    autopilot.armed = True
    autopilot.beat()
    await asyncio.sleep(0.01)
    assert link.status.state == "armed"
    autopilot.heard.clear()
    assert not link.send(flown())
    await asyncio.sleep(3.0)
    assert autopilot.of("SET_ATTITUDE_TARGET") == []


@pytest.mark.parametrize("peername", [None, ("127.0.0.1", 1)])
def test_a_datagram_that_the_kernel_has_no_room_for_is_dropped_not_kept_for_later(
    peername: Any,
) -> None:
    full = Mock(send=Mock(side_effect=BlockingIOError), sendto=Mock(side_effect=BlockingIOError))
    full.dup.return_value = full
    transport = Mock(get_extra_info={"socket": full, "peername": peername}.get)
    datagrams = Datagrams(transport)
    peer = ("127.0.0.1", 1) if peername is None else None
    assert datagrams.send(b"stale soon", peer) == "congested"
    assert peername is not None or datagrams.send(b"", None) == "no_peer"
    transport.sendto.assert_not_called()
    datagrams.abort()
    full.close.assert_called_once()


@pytest.mark.parametrize("commanded", [True, False], ids=["commanded", "left alone"])
@scene(heartbeat_timeout_s=2.0)
async def test_an_autopilot_that_is_back_takes_newer_commands_only_if_commanded_meanwhile(
    link: MavlinkLink, autopilot: Endpoint, commanded: bool
) -> None:
    autopilot.armed = True
    await link.arm(idle)
    autopilot.beats.cancel()
    autopilot.beat()
    states = []
    for _ in range(150):  # it still obeys, its heartbeats get lost
        assert link.send(flown())
        await asyncio.sleep(0.02)
        states.append(link.status.state)
    assert 0.02 * states.index("lost") == pytest.approx(2.0, abs=0.03)
    if not commanded:
        await asyncio.sleep(0.3)  # the bring-down has begun
    assert link.status.state == "lost"
    assert link.status.text.startswith("the link is lost: no HEARTBEAT of the autopilot for")
    autopilot.heard.clear()
    autopilot.beat()
    await asyncio.sleep(0.01)
    assert link.status.state == "armed"
    assert link.send(flown()) is commanded
    await link.silent()
    thrusts = [round(m.thrust, 2) for m in autopilot.of("SET_ATTITUDE_TARGET")]
    assert list(dict.fromkeys(thrusts)) == ([0.5, 0.4, 0.0] if commanded else [0.4, 0.0])
    await link.arm(idle)
    assert link.send(flown())
    await link.kill()


@in_real_time
async def test_a_program_that_stood_still_reads_what_waits_before_its_bring_down() -> None:
    """Each turn of the event loop reads one datagram, of which the last ends the link's control."""
    left: list[Command | Segment] = []
    waiting, read = 5, 0
    loop, deadman = asyncio.get_running_loop(), Deadman()
    transmitter = Transmitter(deadman, 0.02, lambda what, now_s: left.append(what), lambda: read)

    def take_message() -> None:
        nonlocal read
        read += 1
        if read < waiting:
            loop.call_soon(take_message)
        else:
            deadman.stop()

    def stand_still() -> None:
        loop.call_soon(take_message)
        time.sleep(0.4)

    transmitter.start()
    assert deadman.take(flown(), loop.time())
    loop.call_soon(stand_still)
    await transmitter.silent()
    assert read == waiting
    assert left == []
