"""Trajectories with exact derivatives, and their demands on a vehicle."""

from groundstation.core.trajectory.feasibility import (
    Demand,
    FeasibilityReport,
    check_feasibility,
)
from groundstation.core.trajectory.port import (
    Blend,
    Chain,
    Hold,
    Limits,
    Reference,
    Trajectory,
    blend,
    run_in,
    stop,
)
from groundstation.core.trajectory.shapes import (
    ExcitationConfig,
    LemniscateConfig,
    OwnTrajectoryConfig,
    TrajectoryConfig,
)
from groundstation.core.trajectory.waypoints import parse_course
