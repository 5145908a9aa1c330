"""sim/autopilots/dialects.py behaves towards a ground station as PX4 and ArduCopter do."""

from collections.abc import Callable
from typing import Any

import pytest

from groundstation.core.geometry import Vec3, so3
from links.mavlink.protocol import MavCommand, MavlinkCodec
from sim.autopilots import Px4Autopilot, SimulatedAutopilot
from sim.autopilots.dialects import ARMING_DELAY_S, ArduPilotAutopilot, CopterMode, Px4Mode
from tests.airframe_double import Brick

PERIOD_S = 0.02
HOVER = 0.5


class Flight:
    """A ground station's codec, the autopilot, its vehicle, and a clock."""

    def __init__(
        self,
        airframe: Brick | None = None,
        make: Callable[..., SimulatedAutopilot] = Px4Autopilot,
        **options: Any,
    ) -> None:
        self.airframe = airframe or Brick(2.0, held=True)
        self.autopilot: Any = make(
            self.airframe, **{"parameters": {"COM_OF_LOSS_T": 1.0}, **options}
        )
        self.codec = MavlinkCodec(245, 190)
        self.now = 50.0
        self.heard: list[tuple[float, Any]] = []
        self.poll()

    def poll(self) -> None:
        self.take(self.autopilot.poll(self.now))

    def take(self, frames: list[bytes]) -> None:
        for frame in frames:
            self.heard += [(self.now, m) for m in self.codec.feed(frame)]

    def until(self, end_s: float) -> None:
        """Poll whenever something is due."""
        while (due := self.autopilot.next_due_s) <= end_s:
            self.now = max(due, self.now)
            self.poll()
        self.now = end_s

    def wait(self, duration_s: float) -> None:
        self.until(self.now + duration_s)

    def target(self, thrust: float = HOVER, rates: Vec3 = (0.0, 0.0, 0.0)) -> None:
        self.send(self.codec.attitude_target(self.now, 1, 1, thrust, rates))

    def send(self, frame: bytes) -> None:
        self.take(self.autopilot.receive(frame, self.now))

    def stream(
        self, duration_s: float, thrust: float = HOVER, rates: Vec3 = (0.0, 0.0, 0.0)
    ) -> None:
        end = self.now + duration_s
        while self.now < end:
            self.target(thrust, rates)
            self.wait(PERIOD_S)

    def command(self, command: int, *params: float) -> int:
        """The answer's result."""
        before = len(self.heard)
        self.send(self.codec.command(1, 1, command, *params))
        (ack,) = [m for _, m in self.heard[before:] if m.get_type() == "COMMAND_ACK"]
        assert (ack.command, ack.target_system, ack.target_component) == (command, 245, 190)
        return int(ack.result)

    def arm(self) -> "Flight":
        self.stream(1.1)
        assert self.command(MavCommand.DO_SET_MODE, 1.0, 6.0) == 0
        assert self.command(MavCommand.ARM_DISARM, 1.0) == 0
        return self

    def messages(self, name: str) -> list[Any]:
        return [m for _, m in self.heard if m.get_type() == name]

    @property
    def words(self) -> str:
        return "".join(m.text for m in self.messages("STATUSTEXT"))


def test_it_speaks_first_and_sends_a_heartbeat_every_second() -> None:
    flight = Flight()
    flight.wait(3.5)
    beats = [(s, m) for s, m in flight.heard if m.get_type() == "HEARTBEAT"]
    assert [s for s, _ in beats] == pytest.approx([50.0, 51.0, 52.0, 53.0])
    first = beats[0][1]
    told = (first.autopilot, first.type, first.base_mode & 128, first.get_srcSystem())
    assert told == (12, 2, 0, 1)


@pytest.mark.parametrize("make", [Px4Autopilot, ArduPilotAutopilot])
def test_who_asks_for_all_parameters_is_told_each_of_them_once(
    make: Callable[..., SimulatedAutopilot],
) -> None:
    flight = Flight(make=make, parameters={})
    request = flight.codec.dialect.MAVLink_param_request_list_message
    flight.send(flight.codec.pack(request(1, 1)))
    told = flight.messages("PARAM_VALUE")
    names = {one.param_id for one in told}
    assert len(names) == len(told) > 1
    assert {one.param_count for one in told} == {len(names)}


def test_its_health_bit_alone_tells_whether_it_would_arm() -> None:
    prearm = 0x10000000

    def told(flight: Flight) -> tuple[int, int]:
        status = flight.messages("SYS_STATUS")[-1]
        health = status.onboard_control_sensors_health & prearm
        return status.onboard_control_sensors_enabled, health

    flight = Flight()
    assert told(flight) == (0, prearm)
    assert flight.command(MavCommand.DO_SET_MODE, 1.0, 6.0) == 0
    flight.wait(1.1)
    assert told(flight) == (0, 0)  # Px4Mode.OFFBOARD wants a stream first
    flight.stream(2.1)
    assert told(flight) == (0, prearm)
    flight.autopilot.lacks = "Preflight Fail: Compass Sensor 0 missing"
    flight.stream(1.1)
    assert told(flight) == (0, 0)
    assert flight.command(MavCommand.ARM_DISARM, 1.0) != 0
    assert "Compass Sensor 0 missing" in flight.words


@pytest.mark.parametrize(
    ("streams", "mode", "entered", "armed"),
    [
        # OFFBOARD is accepted without set-points, and then arming is denied.
        (False, (1.0, 6.0), 0, 1),
        (True, None, None, 1),
        (True, (1.0, 9.0), 2, 1),
        (True, (1.0, 6.0), 0, 0),
    ],
)
def test_it_arms_only_in_offboard_with_set_points(
    streams: bool, mode: tuple[float, float] | None, entered: int | None, armed: int
) -> None:
    flight = Flight()
    if streams:
        flight.stream(1.1)
    if mode is not None:
        assert flight.command(MavCommand.DO_SET_MODE, *mode) == entered
    assert flight.command(MavCommand.ARM_DISARM, 1.0) == armed
    assert bool(flight.airframe.powered) == (armed == 0)
    assert streams or flight.words == "Arming denied: Resolve system health failures first"


def test_the_first_set_point_after_arming_lets_the_vehicle_go() -> None:
    flight = Flight().arm()
    assert (flight.airframe.powered, flight.airframe.released) == ([(flight.now, True)], [])
    assert flight.airframe.acts == []
    flight.wait(0.3)
    flight.target(0.6, (0.1, -0.2, 0.3))
    assert flight.airframe.released == [flight.now]
    ((when, *told),) = flight.airframe.acts
    assert when == flight.now
    assert told == [pytest.approx(0.6), pytest.approx((0.1, -0.2, 0.3))]


def test_a_set_point_that_is_not_finite_is_not_obeyed() -> None:
    flight = Flight().arm()
    flight.target(float("nan"))
    flight.target(0.5, (0.0, float("inf"), 0.0))
    assert flight.airframe.acts == []


def test_the_last_set_point_is_held_for_a_second_and_then_it_lands_and_disarms() -> None:
    flight = Flight(Brick(1.0, held=True)).arm()
    flight.stream(1.0)
    last = flight.messages("HEARTBEAT")[-1]
    assert (last.custom_mode, last.base_mode & 128) == (6 << 16, 128), "OFFBOARD and armed"
    silent_s = flight.now - PERIOD_S
    acts = len(flight.airframe.acts)
    flight.until(silent_s + 0.999)
    assert (len(flight.airframe.acts), flight.autopilot.mode) == (acts, Px4Mode.OFFBOARD)
    flight.until(silent_s + 1.001)
    assert flight.autopilot.mode == Px4Mode.LAND
    assert "Failsafe activated" in flight.words
    flight.wait(1.5)
    assert flight.messages("HEARTBEAT")[-1].custom_mode == 4 << 16 | 6 << 24
    flight.wait(6.0)
    assert not flight.autopilot.armed
    assert flight.airframe.powered[-1][1] is False
    assert "Disarmed by landing" in flight.words


def test_the_failsafe_levels_out_and_comes_down_slowly() -> None:
    flight = Flight(Brick(9.0, held=True), hover=0.4).arm()
    flight.target(0.55, (0.3, -0.2, 0.1))
    flight.airframe.attitude = so3.from_euler_zyx(0.5, -0.3, 1.0)
    flight.wait(1.02)
    speeds = []
    while not flight.airframe.truth(flight.now).on_ground and flight.now < 80.0:
        flight.wait(0.1)
        speeds.append(flight.airframe.truth(flight.now).velocity_ned[2])
    roll, pitch, _ = so3.euler_zyx(flight.airframe.truth(flight.now).attitude)
    assert (roll, pitch) == pytest.approx((0.0, 0.0), abs=0.01)
    assert speeds[-2] == pytest.approx(0.5, abs=0.15)
    assert flight.now < 80.0


def test_disarming_is_denied_in_the_air_and_until_it_has_stood_for_a_while() -> None:
    flight = Flight(Brick(0.5, held=True)).arm()
    flight.stream(0.1)
    assert flight.command(MavCommand.ARM_DISARM, 0.0) == 1
    assert flight.words.endswith("Disarming denied: not landed")
    flight.stream(1.0, thrust=0.0)
    landed_s = flight.now
    assert flight.airframe.truth(flight.now).on_ground
    while flight.command(MavCommand.ARM_DISARM, 0.0) == 1:
        flight.stream(0.1, thrust=0.0)
        assert flight.now < landed_s + 3.0
    assert flight.now >= landed_s + 0.3
    assert (flight.autopilot.armed, flight.airframe.powered[-1]) == (False, (flight.now, False))


def test_mode_land_on_command_is_not_left_because_set_points_come() -> None:
    flight = Flight(Brick(1.0, held=True)).arm()
    flight.stream(0.2)
    assert flight.command(MavCommand.DO_SET_MODE, 1.0, 4.0, 6.0) == 0
    flight.stream(8.0)
    assert flight.autopilot.mode == Px4Mode.LAND
    assert not flight.autopilot.armed


# ---- ArduCopter


class CopterFlight(Flight):
    """Flight of a simulated ArduCopter."""

    def __init__(self, airframe: Brick | None = None) -> None:
        super().__init__(airframe or Brick(5.0, held=True), ArduPilotAutopilot, parameters={})

    def masked(self, mask: int, thrust: float = 0.5) -> None:
        target = self.codec.dialect.MAVLink_set_attitude_target_message
        self.send(
            self.codec.pack(target(0, 1, 1, mask, (1.0, 0.0, 0.0, 0.0), 0.1, 0.2, 0.3, thrust))
        )

    def arm(self) -> "CopterFlight":
        assert self.command(MavCommand.DO_SET_MODE, 1.0, float(CopterMode.GUIDED)) == 0
        assert self.command(MavCommand.ARM_DISARM, 1.0) == 0
        self.wait(ARMING_DELAY_S)
        return self

    def climb_m_s(self) -> float:
        return -self.airframe.truth(self.now).velocity_ned[2]


def test_it_arms_in_guided_without_a_stream_and_nowhere_else() -> None:
    flight = CopterFlight()
    assert flight.command(MavCommand.ARM_DISARM, 1.0) == 4
    assert "RC not found" in flight.words
    assert flight.command(MavCommand.DO_SET_MODE, 1.0, float(CopterMode.LAND)) == 0
    assert flight.command(MavCommand.ARM_DISARM, 1.0) == 4
    assert "not armable" in flight.words
    flight.arm()


@pytest.mark.parametrize("mask", [128 + 64, 128 + 1, 128 + 6, 128 + 7])
def test_a_set_point_without_thrust_or_some_rates_is_none_and_it_hovers(mask: int) -> None:
    flight = CopterFlight().arm()
    flight.masked(mask, 0.9)
    flight.wait(2.0)
    assert abs(flight.climb_m_s()) < 0.05


def test_set_points_that_stop_are_held_for_three_seconds_then_it_levels_and_says_nothing() -> None:
    flight = CopterFlight(Brick(30.0, held=True)).arm()
    flight.stream(0.2, 0.5, (0.1, 0.0, 0.0))
    flight.heard.clear()
    acts = len(flight.airframe.acts)
    flight.wait(3.0 - 2 * PERIOD_S)
    assert len(flight.airframe.acts) == acts
    flight.wait(4.0)
    roll, pitch, _ = so3.euler_zyx(flight.airframe.truth(flight.now).attitude)
    assert (roll, pitch) == pytest.approx((0.0, 0.0), abs=0.02)
    assert abs(flight.climb_m_s()) < 0.1
    assert flight.words == ""
    beats = flight.messages("HEARTBEAT")
    assert {(m.custom_mode, m.system_status) for m in beats} == {(CopterMode.GUIDED, 4)}
    flight.stream(PERIOD_S, 0.6)
    assert flight.airframe.acts[-1][1] == pytest.approx(0.6)


def test_armed_its_rotors_stand_for_two_seconds_and_then_spool_up_on_the_ground() -> None:
    flight = CopterFlight(Brick(0.0)).arm()
    assert flight.command(MavCommand.ARM_DISARM, 0.0) == 0
    assert flight.command(MavCommand.ARM_DISARM, 1.0) == 0
    flight.stream(ARMING_DELAY_S - 0.1, 0.6)
    flight.stream(0.3, 0.0)
    assert not flight.airframe.acts
    begun_s = flight.now
    flight.stream(1.0, 0.6)
    assert flight.airframe.acts[0][0] == pytest.approx(begun_s + 0.5, abs=PERIOD_S)


def test_after_a_flight_it_refuses_to_disarm_in_guided_and_mode_land_disarms() -> None:
    flight = CopterFlight(Brick(0.5, held=True)).arm()
    flight.stream(1.5, 0.01)
    assert flight.airframe.truth(flight.now).on_ground
    assert flight.command(MavCommand.ARM_DISARM, 0.0) == 4
    assert flight.command(MavCommand.DO_SET_MODE, 1.0, float(CopterMode.LAND)) == 0
    flight.wait(3.0)
    assert not flight.autopilot.armed
    assert flight.airframe.powered[-1][1] is False


def test_the_command_to_land_comes_down_slowly_and_set_points_do_not_stop_it() -> None:
    flight = CopterFlight(Brick(1.0, held=True)).arm()
    flight.stream(0.2)
    assert flight.command(MavCommand.NAV_LAND) == 0
    flight.stream(6.0, 0.9)
    assert not flight.autopilot.armed


def test_it_has_no_odometry_and_sends_nothing_faster_than_250_hz() -> None:
    flight = CopterFlight()
    assert flight.command(MavCommand.SET_MESSAGE_INTERVAL, 331.0, 10_000.0) == 2
    assert flight.command(MavCommand.SET_MESSAGE_INTERVAL, 31.0, 1_000.0) == 0
    assert "250 Hz" in flight.words
    flight.heard.clear()
    flight.wait(1.0)
    assert len(flight.messages("ATTITUDE_QUATERNION")) == pytest.approx(250, abs=1)
