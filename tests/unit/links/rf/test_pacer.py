"""Frames by the pacer's rules alone: no process, no clock, and a port that writes down."""

import math
from collections.abc import Callable

import pytest
from hypothesis import given, settings, strategies as st

from links.core import Command, Segment
from links.rf import Arm, Channels, CrsfLinkConfig, DsmLinkConfig, End, FramePacer, Give, Stop
from links.rf.channel_map import ArmSwitch, ChannelMap, Sticks

# By their numbers: a limit that the test took from the code would bear out any value.
AFTERLIFE_S = 3.0

CONFIG = DsmLinkConfig(map=ChannelMap(arm=ArmSwitch(channel=5)), arm_low_s=0.2, arm_high_s=0.3)
THRUST_MAX_N = 2.0
PERIOD_S = CONFIG.period_s
DOWN = Segment(0.5, 0.8, (0.0, 0.0, 0.0))


class Notebook:
    """Implements :class:`links.rf.pacer.Port`: keeps what leaves."""

    def __init__(self) -> None:
        self.frames: list[bytes] = []
        self.gone = self.stuck = False
        self.opened = self.tried = 0
        self.comes = b""

    def open(self) -> None:
        self.tried += 1
        if self.gone:
            raise OSError(19, "cannot open it: unplugged")
        self.opened += 1

    def write(self, frame: bytes) -> bool:
        if self.gone:
            raise OSError(5, "Input/output error")
        if not self.stuck:
            self.frames.append(frame)
        return not self.stuck

    def read(self, limit: int) -> bytes:
        if self.gone:
            raise OSError(5, "Input/output error")
        data, self.comes = self.comes[:limit], b""
        return data

    def close(self) -> None:
        pass


class Bench:
    """A pacer whose frames are asked for one by one."""

    def __init__(self, config: DsmLinkConfig | CrsfLinkConfig = CONFIG) -> None:
        self.port = Notebook()
        self.now = 100.0
        self.period = config.period_s
        self.pacer = FramePacer(config, THRUST_MAX_N, self.port, self.now)
        codec = config.codec()
        self._channels = Channels(config.map, count=codec.channels, thrust_max_n=THRUST_MAX_N)
        self._decoder = codec.decoder()

    def frame(self) -> Sticks | None:
        """Let one period pass; what left at its end, or None."""
        self.now += self.period
        before = len(self.port.frames)
        self.pacer.prepare(self.now)
        self.pacer.leave(self.now)
        self.pacer.tidy(self.now)
        if len(self.port.frames) == before:
            return None
        (heard,) = self._decoder.feed(self.port.frames[-1])
        return self._channels.read(heard.positions) if heard.positions is not None else None

    def give(
        self,
        thrust_n: float = 1.0,
        *,
        coast_s: float = 0.25,
        bring_down: tuple[Segment, ...] = (DOWN,),
        arming: int = 1,
    ) -> None:
        command = Command(thrust_n, (0.1, 0.0, 0.0), 1, self.now, self.now + coast_s, bring_down)
        self.pacer.order(Give(arming, command), self.now)

    def arm(self) -> None:
        """Through the whole arming."""
        self.pacer.order(Arm(1, self.now), self.now)
        until = self.now + CONFIG.arm_low_s + CONFIG.arm_high_s
        while self.now < until:
            self.give(0.5)
            self.frame()
        self.give(0.5)

    def flown(self, seconds: float) -> list[Sticks | None]:
        return [self.frame() for _ in range(round(seconds / self.period))]

    def thrusts(self, count: int) -> list[float]:
        """The thrust [N] of each of ``count`` frames."""
        frames = [self.frame() for _ in range(count)]
        return [math.nan if one is None else round(one.thrust_n, 1) for one in frames]

    def end(self, *, orphaned: bool, after_s: float) -> None:
        """Its commander ends, or asks for the end ``after_s`` the bring-down."""
        if orphaned:
            self.pacer.outlive_commander(self.now)
        else:
            self.pacer.order(End(after_s), self.now)


def armed() -> Bench:
    bench = Bench()
    bench.arm()
    return bench


def flying() -> Bench:
    """One that has armed, with a command of 1.5 N that holds for 0.25 s."""
    bench = armed()
    bench.give(1.5)
    return bench


def begun() -> Bench:
    """One that has just been told to arm."""
    bench = Bench()
    bench.pacer.order(Arm(1, bench.now), bench.now)
    return bench


def lifting(sticks: Sticks | None) -> bool:
    return sticks is not None and sticks.armed and sticks.thrust_n > 0.01


def is_disarm(sticks: Sticks | None) -> bool:
    return sticks is not None and not sticks.armed and sticks.thrust_n == 0.0


def test_how_late_frames_left_and_which_were_left_out_is_counted() -> None:
    bench = Bench()
    for late_s, skipped in ((0.0005, 0), (-0.001, 0), (0.0003, 2)):
        bench.frame()
        bench.pacer.count_frame(bench.now + late_s, skipped)
    report = bench.pacer.report(bench.now)
    assert (report.frames, report.lost, report.frame_s) == (3, 2, bench.now)
    assert report.late_us == pytest.approx((300, 500, 500), abs=1)
    assert sum(report.late_octaves) == 3
    bench.port.gone = True
    bench.frame()
    bench.pacer.count_frame(bench.now, 5)
    assert bench.pacer.report(bench.now).lost == 2, "without a port nothing was due"


def test_a_port_that_takes_nothing_is_told_until_it_takes_a_frame_and_then_brings_down() -> None:
    bench = flying()
    bench.port.stuck = True
    bench.flown(0.2)
    assert not bench.pacer.report(bench.now).port
    bench.flown(0.1)
    assert "takes nothing" in bench.pacer.report(bench.now).port
    bench.port.stuck = False
    assert lifting(bench.frame())
    assert not bench.pacer.report(bench.now).port


def test_disarm_frames_leave_from_the_first_frame_on() -> None:
    bench = Bench()
    assert all(map(is_disarm, bench.flown(1.0)))
    bench.give()
    assert all(map(is_disarm, bench.flown(1.0))), "a command without an arming is none"


def test_arming_shows_the_switch_down_then_up_and_the_throttle_down_until_it_is_over() -> None:
    bench = begun()
    seen: list[Sticks | None] = []
    for _ in range(40):
        bench.give(0.5)
        seen.append(bench.frame())
    switch = [sticks.armed for sticks in seen if sticks is not None]
    assert switch == sorted(switch), "up once"
    assert switch.count(False) == pytest.approx(CONFIG.arm_low_s / PERIOD_S, abs=1.1)
    down = [sticks is not None and sticks.thrust_n == 0.0 for sticks in seen]
    assert down == sorted(down, reverse=True), "and then obeys"
    arming_s = CONFIG.arm_low_s + CONFIG.arm_high_s
    assert down.count(True) == pytest.approx(arming_s / PERIOD_S, abs=1.1)


def test_a_command_leaves_until_its_deadline_then_its_bring_down_then_disarm_frames() -> None:
    bench = flying()
    assert bench.thrusts(33) == [1.5] * 11 + [0.8] * 22
    assert all(map(is_disarm, bench.flown(4.0)))
    bench.give(1.5)
    assert all(map(is_disarm, bench.flown(1.0))), "and nothing resumes"
    assert bench.pacer.report(bench.now).refused == 1
    bench.arm()
    assert lifting(bench.frame()), "but after a new arming"


def test_a_controller_that_stops_while_arming_is_never_obeyed() -> None:
    bench = begun()
    bench.give(1.0, coast_s=0.25)
    assert not any(map(lifting, bench.flown(4.0)))


def test_a_command_of_another_arming_is_none() -> None:
    bench = armed()
    bench.pacer.order(Stop(), bench.now)
    bench.pacer.order(Arm(2, bench.now), bench.now)
    for _ in range(40):
        bench.give(1.5)
        assert not lifting(bench.frame())


def test_an_arming_counts_only_once_all_before_is_over() -> None:
    bench = armed()
    bench.pacer.order(Arm(2, bench.now), bench.now)
    assert bench.pacer.report(bench.now).arming == 1
    assert lifting(bench.frame()), "it changes nothing"


def test_a_frame_that_is_late_says_what_is_true_when_it_leaves() -> None:
    bench = armed()
    bench.give(1.5, coast_s=PERIOD_S + 0.002, bring_down=())
    bench.pacer.prepare(bench.now + PERIOD_S)
    bench.pacer.leave(bench.now + PERIOD_S + 0.004)
    (heard,) = bench._decoder.feed(bench.port.frames[-1])
    assert is_disarm(bench._channels.read(heard.positions or ()))


def test_an_unplugged_port_disarms_and_is_opened_again_within_a_tenth_of_a_second() -> None:
    bench = armed()
    bench.port.gone = True
    bench.frame()
    gone = "the module's port is gone (Input/output error): check the module's cable and supply"
    assert bench.pacer.report(bench.now).port == gone
    for _ in range(400):
        bench.give()
        assert bench.frame() is None
    assert (bench.port.opened, bench.port.tried) == (1, 1 + 400 // 5)
    bench.pacer.order(Arm(1, bench.now), bench.now)
    bench.give()
    report = bench.pacer.report(bench.now)
    assert report.over, "nor does an arming count"
    assert report.port == "cannot open it: unplugged"
    assert report.dropped["port_lost"] == 1
    bench.port.gone, back_s = False, bench.now
    while bench.port.opened == 1:
        bench.give()
        bench.frame()
    assert bench.now - back_s <= 0.1 + PERIOD_S
    bench.give()
    assert all(map(is_disarm, bench.flown(1.0)[1:]))
    assert bench.pacer.report(bench.now).port == ""


@pytest.mark.parametrize("orphaned", [True, False])
def test_in_flight_it_ends_only_after_the_bring_down_and_some_disarm_frames(orphaned: bool) -> None:
    bench = flying()
    bench.end(orphaned=orphaned, after_s=1.0)
    frames: list[Sticks | None] = []
    while not bench.pacer.done(bench.now):
        frames.append(bench.frame())
    assert sum(map(lifting, frames)) == 33
    assert all(map(is_disarm, frames[33:]))
    assert len(frames[33:]) * PERIOD_S == pytest.approx(AFTERLIFE_S if orphaned else 1.0, abs=0.05)


def test_on_the_ground_an_orphan_still_disarms_for_a_while() -> None:
    bench = Bench()
    bench.flown(20.0)
    bench.pacer.outlive_commander(bench.now)
    count = 0
    while not bench.pacer.done(bench.now):
        assert is_disarm(bench.frame())
        count += 1
    assert count * PERIOD_S == pytest.approx(AFTERLIFE_S, abs=0.05)


@pytest.mark.parametrize("when_s", [0.05, 0.3])
def test_an_orphan_never_finishes_an_arming(when_s: float) -> None:
    bench = begun()
    bench.give(1.0)
    bench.flown(when_s)
    bench.give(1.0)
    bench.pacer.outlive_commander(bench.now)
    assert all(map(is_disarm, bench.flown(4.0)))


def test_a_command_that_is_no_number_is_counted_and_changes_nothing() -> None:
    bench = armed()
    bench.give(math.nan)
    assert bench.pacer.report(bench.now).dropped == {"bad_command": 1}
    assert lifting(bench.frame())


ORDERS = ("give", "late", "stop", "arm", "end", "wait", "gone", "back")


@settings(max_examples=60)
@given(st.lists(st.sampled_from(ORDERS), max_size=60))
def test_whatever_is_ordered_nothing_lifts_without_an_arming_and_a_fresh_command(
    orders: list[str],
) -> None:
    bench = Bench()
    armed_s = fresh_s = -math.inf
    for order in orders:
        match order:
            case "give":
                bench.give(1.5)
                fresh_s = bench.now
            case "late":
                bench.give(1.9, coast_s=-0.1)
            case "stop":
                bench.pacer.order(Stop(), bench.now)
                armed_s = -math.inf
            case "arm":
                over = bench.pacer.report(bench.now).over
                bench.pacer.order(Arm(1, bench.now), bench.now)
                armed_s = bench.now if over else armed_s
            case "end":
                bench.pacer.order(End(0.5), bench.now)
            case "gone":
                bench.port.gone = True
            case "back":
                bench.port.gone = False
            case "wait":
                bench.flown(0.2)
        sticks = bench.frame()
        if sticks is None:
            armed_s = -math.inf if bench.port.gone else armed_s
        if lifting(sticks):
            assert bench.now >= armed_s + CONFIG.arm_low_s + CONFIG.arm_high_s
            assert bench.now <= fresh_s + 0.25 + 0.5 + 1e-6
            assert sticks is not None and round(sticks.thrust_n, 1) in (1.5, 0.8)


# ---- what comes in time, and what comes after the end


def test_a_command_that_came_in_time_counts_though_it_is_looked_for_only_once_a_frame() -> None:
    bench = armed()
    bench.frame()
    bench.give(1.5, coast_s=1.5 * PERIOD_S)
    bench.frame()
    # Its deadline passes half-way to the next frame; its successor is seen just before that.
    look_s = bench.now + 0.9 * PERIOD_S
    newer = Command(1.2, (0.0, 0.0, 0.0), 2, look_s, look_s + 0.25, (DOWN,))
    bench.pacer.order(Give(1, newer), look_s)
    assert bench.thrusts(1) == [1.2]
    assert bench.pacer.report(bench.now).refused == 0


def test_a_command_that_comes_after_a_frame_of_the_bring_down_is_told_to_be_in_vain() -> None:
    bench = flying()
    bench.flown(0.25 + PERIOD_S)
    assert not bench.pacer.report(bench.now).deaf
    bench.give(1.5)
    assert bench.pacer.has_news(bench.now)
    report = bench.pacer.report(bench.now)
    assert report.deaf and not report.over
    assert all(sticks is not None and sticks.thrust_n < 1.0 for sticks in bench.flown(2.0))
    bench.arm()
    assert not bench.pacer.report(bench.now).deaf


@pytest.mark.parametrize("orphaned", [True, False])
def test_end_means_end_whatever_is_commanded_after_it(orphaned: bool) -> None:
    bench = flying()
    bench.end(orphaned=orphaned, after_s=0.1)
    thrusts: list[float] = []
    for _ in range(50):
        bench.give(1.9)
        bench.pacer.order(Arm(2, bench.now), bench.now)
        thrusts += bench.thrusts(1)
    assert thrusts == [1.5] * 11 + [0.8] * 22 + [0.0] * 17


def test_an_arming_without_any_command_has_failed_when_it_is_over() -> None:
    bench = begun()
    assert not bench.pacer.report(bench.now).over
    assert all(map(is_disarm, bench.flown(CONFIG.arm_low_s + CONFIG.arm_high_s + 2 * PERIOD_S)))
    assert bench.pacer.report(bench.now).over


# ---- whoever takes over


def heir_of(bench: Bench, after_s: float) -> Bench:
    """Whoever takes over ``after_s`` [s] after the newest frame."""
    heir = Bench()
    heir.now = bench.now + after_s
    heir.pacer.inherit(bench.pacer.make_estate(), "the pacer was killed", heir.now)
    return heir


def test_whoever_takes_over_plays_what_was_held_and_nothing_else_ever_again() -> None:
    bench = flying()
    bench.frame()
    heir = heir_of(bench, 3 * PERIOD_S)
    thrusts: list[float] = []
    for _ in range(60):
        heir.give(1.9)
        heir.pacer.order(Arm(2, heir.now), heir.now)
        heir.give(1.9, arming=2)
        sticks = heir.frame()
        assert sticks is not None and sticks.armed is (sticks.thrust_n > 0.1)
        thrusts.append(round(sticks.thrust_n, 1))
    assert thrusts == [1.5] * 7 + [0.8] * 22 + [0.0] * 31
    report = heir.pacer.report(heir.now)
    assert "the pacer was killed; its stand-by has taken over" in report.heir
    assert not report.port


@pytest.mark.parametrize(("after_s", "lifts"), [(0.3, True), (0.8, False)])
def test_one_that_takes_over_late_begins_in_the_midst_of_the_bring_down_or_after_it(
    after_s: float, lifts: bool
) -> None:
    bench = flying()
    bench.frame()
    sticks = heir_of(bench, after_s).frame()
    assert sticks is not None and sticks.armed is lifts
    assert round(sticks.thrust_n, 1) == (0.8 if lifts else 0.0)


def arming() -> Bench:
    """One in the midst of its arming."""
    bench = begun()
    for _ in range(15):
        bench.give(0.5)
        bench.frame()
    return bench


def stopped() -> Bench:
    bench = flying()
    bench.frame()
    bench.pacer.order(Stop(), bench.now)
    bench.frame()
    return bench


@pytest.mark.parametrize("before", [arming, stopped])
def test_one_that_takes_over_in_the_midst_of_an_arming_or_after_a_stop_disarms(
    before: Callable[[], Bench],
) -> None:
    assert all(map(is_disarm, heir_of(before(), PERIOD_S).flown(1.0)))


def test_one_that_takes_over_after_an_end_still_ends() -> None:
    bench = flying()
    bench.frame()
    bench.end(orphaned=False, after_s=0.1)
    heir = heir_of(bench, PERIOD_S)
    while not heir.pacer.done(heir.now):
        heir.frame()
    assert heir.now - bench.now == pytest.approx(0.25 + DOWN.duration_s + 0.1, abs=3 * PERIOD_S)


def test_whoever_takes_over_in_a_bring_down_goes_on_with_it() -> None:
    bench = flying()
    assert bench.thrusts(20) == [1.5] * 11 + [0.8] * 9
    assert heir_of(bench, PERIOD_S).thrusts(20) == [0.8] * 12 + [0.0] * 8
