"""sim/studies/gale.py: the wind tunnel gives back flights that were measured in the real one, and not by chance."""

import json
from pathlib import Path

import msgspec
import pytest

from groundstation.core.geometry import FLOATS, so3
from links.core import thrust
from sim.scenarios import SCENARIOS, gale
from sim.studies import gale_command
from sim.studies.gale import LAWS, PublishedFlight, fly_ours, fly_published
from sim.world import AirDrag, Body, TrueState, compute_drag, with_noise
from tests.flown_once import once


def flown(seeds: int = 5, *, aerodynamics: bool = True) -> list[PublishedFlight]:
    return once(("published", seeds, aerodynamics), lambda _: fly_published(seeds, aerodynamics=aerodynamics))


def of(law: str) -> list[PublishedFlight]:
    return [one for one in flown() if one.law == law]


@pytest.mark.matrix  # a study of others' flights; that the tunnel pushes as it is told, other tests of this file hold
def test_thirteen_of_fifteen_published_figures_are_given_back_within_thirty_percent() -> None:
    assert len(flown()) == 15
    assert sum(one.close for one in flown()) >= 13


@pytest.mark.matrix  # as before
def test_without_aerodynamics_at_most_nine_are_so_that_the_test_has_power() -> None:
    assert sum(one.close for one in flown(aerodynamics=False)) <= 9


@pytest.mark.matrix  # as before
def test_the_baselines_height_leads_its_reference() -> None:
    assert all(50.0 <= one.lead_z_ms <= 150.0 for one in of("pid"))


@pytest.mark.matrix  # as before
def test_only_adaptation_by_a_share_stands_off_in_the_wind() -> None:
    strong = [abs(one.offset_x_cm) for one in of("l1")[2:]]
    for found, measured in zip(strong, (9.4, 9.4, 19.0), strict=True):
        assert found == pytest.approx(measured, rel=0.3)
    assert all(abs(one.offset_x_cm) < 3.0 for law in ("pid", "indi") for one in of(law))


def test_the_thrust_curve_has_the_slope_that_was_measured() -> None:
    step = 1e-4
    hover = thrust(gale.HOVER, gale.THRUST_CURVE)
    slope = (thrust(gale.HOVER + step, gale.THRUST_CURVE) - hover) / step * gale.HOVER / hover
    assert slope == pytest.approx(gale.THRUST_SLOPE, abs=0.05)


def test_the_course_has_the_velocity_and_acceleration_that_it_says() -> None:
    h = 1e-5
    for time_s in (1.0, 12.0, 13.0, 40.0):
        before, now, after = (gale.course(time_s + k * h) for k in (-1, 0, 1))
        for axis in range(3):
            assert (after[0][axis] - before[0][axis]) / (2.0 * h) == pytest.approx(now[1][axis], abs=1e-6)
            assert (after[1][axis] - before[1][axis]) / (2.0 * h) == pytest.approx(now[2][axis], abs=1e-6)
    assert gale.course(0.0)[0] == pytest.approx((0.25, 0.0, 2.15))


@pytest.mark.parametrize("name", gale.WINDS)
def test_the_world_of_a_scenario_pushes_as_the_tunnel_does(name: str) -> None:
    """At rest in its trim: nothing but what does not repeat is left."""
    world = msgspec.structs.replace(
        SCENARIOS[name].world, tunnel=msgspec.structs.replace(SCENARIOS[name].world.tunnel, rest_m_s2=(0.0, 0.0, 0.0))
    )
    lean, push = gale.trim(-world.air_velocity[0])
    attitude = so3.from_euler_zyx(0.0, -lean, 0.0)
    drag = AirDrag(world.drag_body_per_s, *world.inflow_drag_per_m, world.inflow_lift_per_m, world.air_velocity)
    body = Body(world.start_ned, (0.0, 0.0, 0.0), attitude, 0.0, (0.0, 0.0, 0.0))
    north, _, down = compute_drag(FLOATS, body, drag)
    x, _, z = so3.third_column(attitude)
    force = push * world.gravity
    assert north + world.wind_mean[0] - force * x == pytest.approx(0.0, abs=1e-6)
    assert down + world.gravity - force * z == pytest.approx(0.0, abs=1e-6)


def test_stamps_that_are_off_show_a_moving_vehicle_elsewhere_along_its_way() -> None:
    world = msgspec.structs.replace(SCENARIOS["gale_0"].world, pose_jitter_s=1e-3)
    truth = TrueState(0.0, (0.0, 0.0, 0.0), (2.0, 0.0, -1.0), so3.IDENTITY, (0.0, 0.0, 0.0), 1.0, False)
    seen = with_noise(truth, world, (0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    assert seen.position_ned == pytest.approx((2e-3, 0.0, -1e-3))


@pytest.mark.matrix  # a study of others' flights; test_alarms.py flies in bad air, and no guard answers
@pytest.mark.parametrize(
    ("told", "wind"),
    [
        ("told right", "gale_12"),
        ("lags and delay told 20 ms too short", "gale_0"),
        ("lags and delay told 20 ms too long", "gale_8"),
    ],
)
def test_ours_flies_within_the_share_of_what_was_measured_and_no_guard_answers(told: str, wind: str) -> None:
    """Told wrong, the winds in which it is nearest to its marks."""
    flown = fly_ours(told, wind, 1)
    assert flown.lost == []
    assert flown.rms_cm is not None
    assert flown.rms_cm <= flown.most_cm


def test_the_command_says_it_and_writes_it_between_markers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def published(_: int = 5, *, aerodynamics: bool = True) -> list[PublishedFlight]:
        off = 1.0 if aerodynamics else 2.0
        return [
            PublishedFlight(
                law=law, wind=wind, rms_cm=off * facts.measured_cm[law], measured_cm=facts.measured_cm[law],
                offset_x_cm=0.0, lead_z_ms=100.0,
            )
            for law in LAWS for wind, facts in gale.WINDS.items()
        ]  # fmt: skip

    monkeypatch.setattr("sim.studies.gale.fly_published", published)
    assert gale_command(None, 5, 0, as_json=True) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["of"] == 15 == len(facts["flights"])
    assert facts["null_close"] < facts["close"]
    page = tmp_path / "page.md"
    page.write_text("above\n<!-- gale:begin -->\nold\n<!-- gale:end -->\nbelow\n", "utf-8")
    gale_command(page, 5, 0, as_json=False)
    text = page.read_text("utf-8")
    assert text.startswith("above\n") and text.endswith("below\n") and "old" not in text
    assert "| INDI |" in text
