"""``groundstation-sim dev upsets``: large pushes and drawn starts, and the table of both."""

import math
import re
from pathlib import Path

import pytest

from sim.__main__ import main
from sim.scenarios import SCENARIOS
from sim.studies import upsets
from tests.e2e.stations import run_here
from tests.known import known

ROOT = Path(__file__).parents[2]
PAGE = "docs/explanation/upsets.md"
ONE = "step 5"
"""An upset of eight directions."""


def shorten(monkeypatch: pytest.MonkeyPatch, **durations_s: float) -> None:
    """Fly one upset from one direction, with these durations [s]."""
    first = {ONE: upsets.list_upsets()[ONE][:1]}
    monkeypatch.setattr(upsets, "list_upsets", lambda: first)
    for name, duration_s in durations_s.items():
        monkeypatch.setattr(upsets, name, duration_s)


def test_drawn_starts_are_within_their_bounds_and_repeat() -> None:
    world, reference = SCENARIOS["paper"].world, (0.5, -0.5, -1.0)
    drawn = [upsets.draw_start(world, reference, seed) for seed in range(200)]
    away = [math.dist(one.start_ned, reference) for one in drawn]
    speeds = [math.hypot(*one.start_velocity) for one in drawn]
    tilts = [math.hypot(*one.start_turn_deg) for one in drawn]
    limits = (upsets.FARTHEST_START_M, upsets.FASTEST_M_S, upsets.STEEPEST_DEG)
    for values, most in zip((away, speeds, tilts), limits, strict=True):
        assert max(values) <= most
        assert min(values) < 0.1 * most
        assert max(values) > 0.9 * most
    assert drawn[7] == upsets.draw_start(world, reference, 7)


@pytest.mark.tried(1)  # vehicles
@pytest.mark.parametrize("scenario", upsets.VEHICLES)
def test_ours_recovers_from_every_drawn_start(scenario: str) -> None:
    (row,) = upsets.fly_states(scenario, states=8, laws=["adaptive"])
    assert (row.recovered, row.lost) == (1.0, 0.0)
    assert known(row.settle_s) < 4.0
    assert 0.0 < known(row.sink_most_m) < 5.0


def made_up(
    ours_cm: float | None, ours_s: float | None, others: dict[str, float | None]
) -> upsets.UpsetRow:
    return upsets.UpsetRow(
        "paper", "figure", ONE, {"adaptive": ours_cm, **others}, {"adaptive": ours_s, **others}
    )


@pytest.mark.parametrize(
    ("ours", "best", "said", "within"),
    [
        (11.0, 10.0, "1.10", 1),
        (11.2, 10.0, "1.12", 0),
        (5.0, 10.0, "0.50", 1),
        (None, 10.0, "-", 0),
        (5.0, None, "only ours", 1),
        (0.0, 0.0, "1.00", 1),
        (0.3, 0.0, "+0.30 s", 0),
    ],
)
def test_a_row_is_judged_by_the_best_baseline(
    ours: float | None, best: float | None, said: str, within: int
) -> None:
    worse = None if best is None else best + 1.0
    row = made_up(ours, ours, {"geometric": worse, "l1": best, "pid": worse, "indi": worse})
    states = [upsets.StatesRow("paper", law, 10, 0.9, 0.1, 2.0, None, None) for law in upsets.LAWS]
    table = upsets.upsets_table([row], states)
    lines = table.splitlines()
    line = next(one for one in lines if one.startswith("| `paper`, figure: step 5 |"))
    assert line.endswith(f"| {said} | {said} |")
    assert f"{within} of 1 rows are within 1.1" in table
    assert "| `paper`, pid | 90.0 % | 10.0 % | 2.00 | - | - |" in table


def test_the_peaks_in_the_readme_are_those_of_the_page() -> None:
    readme, page = ((ROOT / name).read_text("utf-8") for name in ("README.md", PAGE))
    (laws,), (peaks,) = (
        re.findall(rf"^\| {row} \|.*", page, re.M)
        for row in (r"peak, cm .*?", "`paper`, figure: step 5")
    )
    by_law = dict(zip(laws.split(" | "), peaks.split(" | "), strict=True))
    laws = ("adaptive", "pid", "geometric", "l1", "indi")
    told = " | ".join(by_law[law].split(" (")[0] for law in laws)
    assert f"({PAGE})) | {told} |" in readme


def test_the_command_writes_its_table(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    page = tmp_path / "PAGE.md"
    page.write_text(
        "# Page\n\n<!-- figures:begin -->\nold\n<!-- figures:end -->\n\nlast\n", "utf-8"
    )
    shorten(monkeypatch, UPSET_AT_S=0.5, PUSHED_S=1.0, STATES_S=0.5)
    words = f"dev upsets --scenarios paper --seeds 1 --states 2 --write {page}".split()
    done = run_here(main, *words)
    assert done.returncode == 0
    text = page.read_text("utf-8")
    assert "\nold\n" not in text
    assert text.endswith("<!-- figures:end -->\n\nlast\n")
    assert f"Made by `groundstation-sim {' '.join(map(str, words))}`." in text
    upset = ("`paper`, figure: step 5", "`paper`, hold: step 5")
    for part in (*upset, *(f"`paper`, {law} |" for law in upsets.LAWS)):
        assert part in done.stdout
        assert part in text
