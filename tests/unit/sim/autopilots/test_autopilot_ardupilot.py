"""sim/autopilots/dialects.py behaves towards a ground station as ArduCopter does."""

import pytest

from groundstation.core.geometry import so3
from links.mavlink.protocol import MavCommand
from sim.autopilots.dialects import ARMING_DELAY_S, ArduPilotAutopilot, CopterMode
from tests.airframe_double import Brick
from tests.unit.links.mavlink.test_mavlink_autopilot import PERIOD_S, Flight


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
