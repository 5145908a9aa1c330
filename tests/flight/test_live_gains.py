"""Gains changed in a whole flight: recorded, replayed to the last bit, and never too large."""

import asyncio
from pathlib import Path

from groundstation.analysis.replay import replay_facts
from groundstation.core.control import CALM, HOLD, Gains, calm_gains, hold_gains
from groundstation.core.mission import State
from groundstation.flight import Flight
from groundstation.recording import Recording
from sim.runs import MissionResult, Stage, from_floor
from sim.scenarios import SCENARIOS, prepare
from tests.flight.flights import SHORT
from tests.loops import until
from tests.recordings import record_mission


def flown(folder: Path, key: str, value: float) -> tuple[MissionResult, Path, list[str]]:
    """A mission with one change of a gain on the trajectory; its recording, and what it told."""
    world, config = from_floor(*prepare(SCENARIOS["paper"], list(SHORT)), 30.0)
    replies = []

    async def script(flight: Flight, _: Stage) -> None:
        await until(lambda: flight.state is State.TRACKING)
        await asyncio.sleep(14.0)
        replies.append(flight.set_gain(key, value))

    mission, path = record_mission(folder, world, config, script)
    assert [reply.done for reply in replies] == [True], replies
    told = [entry.value()["text"] for entry in Recording(path).entries(("/mission",))]
    return mission, path, told


def test_a_gain_changed_in_flight_is_recorded_and_flown_again_to_the_last_bit(
    tmp_path: Path,
) -> None:
    mission, path, told = flown(tmp_path, "controller.k2", 3.0)
    assert mission.landed, mission.why
    assert "controller.k2 goes from 2 to 3 within 2 s" in told
    assert "controller.k2 stays at 3: the flight is as good as before" in told
    facts = replay_facts(path)
    assert facts["first_difference"] is None
    assert facts["identical"] is True
    switched = [entry.value()["what"] for entry in Recording(path).entries(("/switch",))]
    assert switched.count("gain k2") > 50


def test_only_the_figure_is_flown_with_the_gains_of_a_figure(tmp_path: Path) -> None:
    world, config = from_floor(*prepare(SCENARIOS["paper"], list(SHORT)), 5.0)
    _, path = record_mission(tmp_path, world, config)
    told = [entry.value() for entry in Recording(path).entries(("/switch",))]
    eased = [switch["values"] for switch in told if switch["what"] == "ease"]
    assert eased == [
        [1.0, 1.0, 1.0], [1.0, 1.0, 0.0], [0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [1.0, 1.0, 1.0],
    ]  # fmt: skip
    facts = replay_facts(path)
    assert (facts["first_difference"], facts["identical"]) == (None, True)


def test_gains_off_the_figure_are_never_larger_than_those_told() -> None:
    for limited, most in ((calm_gains(Gains()), CALM), (hold_gains(Gains()), HOLD)):
        assert {name: getattr(limited, name) for name in most} == most
    gentle = Gains(
        k2=0.5, k3_down=2.0, sigma_slope=1.0, rho_slope=0.4, sigma_bound=2.0, rho_bound=1.5
    )
    assert calm_gains(gentle) == hold_gains(gentle) == gentle
