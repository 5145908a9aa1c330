"""Whatever a true motion is like, and however the two that see it differ, the second witness does not doubt it."""

from hypothesis import given, settings
from hypothesis import strategies as st

from tests.witness_scenes import ARMED_S, Motion, Scene, largest

ANGLE, HZ = st.floats(0.0, 20.0), st.floats(0.05, 1.0)
ASKEW = st.floats(-4.0, 4.0)


@settings(max_examples=15, deadline=None)
@given(
    motion=st.builds(Motion, st.tuples(ANGLE, ANGLE, st.floats(0.0, 40.0)), st.tuples(HZ, HZ, HZ)),
    seed=st.integers(0, 1000),
    pose_hz=st.floats(30.0, 240.0),
    pose_late_s=st.floats(0.0, 0.1),
    noise_deg=st.floats(0.0, 0.5),
    askew_deg=st.tuples(ASKEW, ASKEW, st.floats(-8.0, 8.0)),
    heading_deg=st.floats(-180.0, 180.0),
    told_late_s=st.floats(0.0, 0.1),
    told_jitter_s=st.floats(0.0, 0.1),
    told_loss=st.floats(0.0, 0.3),
    clocks_apart_s=st.floats(-0.08, 0.08),
    slow_error_deg=st.floats(0.0, 1.0),
    pulled_upright=st.floats(0.0, 0.1),
    vibration_deg_s=st.floats(0.0, 10.0),
    reset=st.tuples(st.floats(ARMED_S, 20.0), st.floats(-180.0, 180.0)),
    dropout=st.tuples(st.floats(2.0, 20.0), st.floats(0.0, 0.5)),
)
def test_true_poses_are_not_doubted(reset: tuple[float, float], dropout: tuple[float, float], **scene: object) -> None:
    begin, lasts = dropout
    assert largest(Scene(**scene, resets=(reset,), dropouts=((begin, begin + lasts),))) < 1.0  # type: ignore[arg-type]
