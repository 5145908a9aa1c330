"""Excitation beyond what every trajectory must keep (tests/contract/test_trajectories.py)."""

import numpy as np
import pytest

from groundstation.core.trajectory import ExcitationConfig
from groundstation.core.trajectory.shapes import Excitation
from groundstation.flight.preflight import examine_trajectory
from groundstation.settings import Config

CONFIG = ExcitationConfig()


def sampled() -> "np.ndarray[tuple[int, ...], np.dtype[np.float64]]":
    """Accelerations over one period, (4096, 3)."""
    motion = Excitation(CONFIG)
    times = CONFIG.period_s * np.arange(4096) / 4096
    return np.array([motion.at(t).acceleration_ned for t in times.tolist()])


def test_its_largest_acceleration_is_what_was_asked_for() -> None:
    peak = np.linalg.norm(sampled(), axis=1).max()
    assert peak == pytest.approx(CONFIG.acceleration_m_s2, rel=0.02)


def test_no_two_axes_share_a_frequency_and_all_lie_within_the_band() -> None:
    lines = [
        set(np.flatnonzero(np.abs(axis) > 1e-6 * np.abs(axis).max()).tolist())
        for axis in np.fft.rfft(sampled(), axis=0).T
    ]
    assert all(len(axis) >= 5 for axis in lines)
    assert lines[0].isdisjoint(lines[1])
    assert lines[0].isdisjoint(lines[2])
    assert lines[1].isdisjoint(lines[2])
    band = [line / CONFIG.period_s for axis in lines for line in axis]
    assert CONFIG.lowest_hz <= min(band)
    assert max(band) <= CONFIG.highest_hz


def test_it_begins_and_ends_at_rest_and_stays_close() -> None:
    flown = CONFIG.build()
    assert flown.duration_s == CONFIG.laps * CONFIG.period_s + CONFIG.ramp_s
    for time_s in (0.0, flown.duration_s):
        assert flown.at(time_s).velocity_ned == (0.0, 0.0, 0.0)
    report = examine_trajectory(Config(trajectory=CONFIG))
    assert all(abs(low + high - 2.0 * middle) < 0.4 and high - low < 0.4 for low, high, middle in zip(
        report.lowest_ned, report.highest_ned, CONFIG.position_ned, strict=True
    ))  # fmt: skip
